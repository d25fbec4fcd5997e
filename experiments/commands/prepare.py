"""Subcommands for preparation of a scene: projects, checks, simulations, registration."""

from __future__ import annotations

import json
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated, Literal

from typer import Argument, Option

from experiments.commands.options import Force, Out, Replace, ScenarioName, Vector
from experiments.commands.run import Answer, Run
from experiments.errors import InputError, shown

OF_MESH = ("--unit", "--size-mm", "--fixed", "--still", "--marks", "--target", "--target-sd-mm", "--field", "--region")


def new(
    run: Run,
    folder: Annotated[Path, Argument(metavar="DIR", help="Folder of the project; new or empty.")],
    kind: Annotated[
        Literal["plane", "breast", "mesh"],
        Option(help="plane: flat phantom; breast: soft hemisphere on a wall; mesh: your own body."),
    ] = "plane",
    masses: Annotated[int | None, Option(help="Number of masses; default: 5 for plane, 10 for breast.")] = None,
    young_kpa: Annotated[
        float | None, Option(min=0.01, help="Young's modulus of breast or mesh [kPa]; default 5.")
    ] = None,
    nodes: Annotated[
        Path | None, Option(help="CSV of a spring network's nodes: name,x_mm,y_mm[,z_mm,mass_kg,fixed,hue_deg,target].")
    ] = None,
    springs: Annotated[Path | None, Option(help="CSV of springs: from,to[,stiffness_N_m,damping_N_s_m,group].")] = None,
    mesh: Annotated[
        Path | None,
        Option(help="Tetrahedra or a closed surface: VTK, VTU, Gmsh, STL, OBJ, PLY; needs the extra `mesh`."),
    ] = None,
    unit: Annotated[
        Literal["mm", "cm", "m"] | None, Option(help="With --mesh: length unit of the file; required.")
    ] = None,
    size_mm: Annotated[float | None, Option(min=0.1, help="With --mesh: edge length of new tetrahedra [mm].")] = None,
    fixed: Annotated[
        str | None, Option(help='With --mesh: fixed nodes, e.g. "y<6" [mm], "faces 2" or "region 1"; required.')
    ] = None,
    still: Annotated[bool, Option("--still", help="With --fixed: the wall of these nodes does not move.")] = False,
    marks: Annotated[
        str | None, Option(help="With --mesh: number of marks, or a CSV file: name,x_mm,y_mm,z_mm; default: 40.")
    ] = None,
    target: Annotated[
        str | None, Option(help="With --mesh: x,y,z of the target [mm]; default: middle of the body.")
    ] = None,
    target_sd_mm: Annotated[
        float | None,
        Option(
            min=0.0, help="With --mesh: standard deviation of the target's position per axis [mm]; default: 0 (exact)."
        ),
    ] = None,
    field: Annotated[
        str | None,
        Option(help="With --mesh: data field with the share of gland (0 to 1), or with labels for --region."),
    ] = None,
    region: Annotated[
        list[str] | None,
        Option(
            help="With --mesh: LABEL=TISSUE; repeat for several. Tissues: fat, gland, fibrous, skin, fascia, muscle."
        ),
    ] = None,
    seed: Annotated[int, Option(min=0, help="Seed of the simulated tissue's random deviations from the scene.")] = 0,
    force: Force = False,
) -> Answer:
    """Create a project folder with a scene, simulated tissue for practice, a needle, and a list of steps."""
    from experiments.projects.mesh_body import N_MARKS, MeshChoice
    from experiments.projects.project import Kind, project, write_project

    run.only_with("--mesh", *OF_MESH)
    run.not_with("--mesh", "--nodes", "--springs")
    choice = None
    if mesh is not None:
        choice = MeshChoice(
            mesh,
            unit,
            size_mm,
            fixed,
            str(N_MARKS) if marks is None else marks,
            target,
            target_sd_mm,
            field,
            tuple(region or ()),
            not still,
        )
    with run.folder(folder, force=force, inputs=[nodes, springs, mesh]) as work:
        made = project(
            Kind(kind), masses=masses, young_kpa=young_kpa, nodes=nodes, springs=springs, mesh=choice, seed=seed
        )
        write_project(made, work, seed=seed)
    node = made.assumed.target.node
    lines = [
        f"{made.title}, target {node}, in {folder}",
        f"Next: cd {folder}; softaim check scene.toml --out check; STEPS.md has all steps",
    ]
    return Answer({"out": folder, "title": made.title, "target": node}, lines)


def check(
    run: Run,
    scene: Annotated[Path, Argument(help="Scene file, or folder of a recording.")],
    out: Annotated[Path | None, Option(help="Folder for check.png and check.json.")] = None,
    fps: Annotated[
        float | None, Option(min=0.1, max=1e5, help="Frame rate [frames/s]; default: from the recording, else 30.")
    ] = None,
    sd_mm: Annotated[
        float | None,
        Option(
            min=1e-6, max=1e3, help="Standard deviation of marks per axis [mm]; default: from the recording or camera."
        ),
    ] = None,
    vector: Vector = None,
    force: Force = False,
) -> Answer:
    """Check a scene: rest shape, motion, best possible accuracy of the target, and missing steps."""
    run.only_with("--out", "--vector", "--force")
    from experiments.commands.console import lines_table
    from experiments.plots.check import check_figure
    from experiments.plots.style import write_picture
    from experiments.projects.check import checked
    from experiments.projects.report import check_lines, check_report

    with nullcontext() if out is None else run.folder(out, force=force, inputs=[scene]) as folder:
        done = checked(scene, frames_per_s=fps, sd_mm=sd_mm, advance=run.stage("check"))
        if folder is not None:
            write_picture(check_figure(done), folder / "check.png", vector)
        report, lines = check_report(done), check_lines(done)
        if folder is not None:
            (folder / "check.json").write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    picture = [] if out is None else [f"Picture in {out / 'check.png'}"]
    return Answer({"out": out, **report}, [lines_table(lines), *picture])


def simulate(
    run: Run,
    scenario: ScenarioName,
    out: Out,
    seed: Annotated[int | None, Option(min=0, help="Seed; replaces the seed of the scenario.")] = None,
    runs: Annotated[int | None, Option(min=1, help="Number of recordings OUT/seed-N, with successive seeds.")] = None,
    film: Annotated[bool, Option("--film/--no-film", help="Write a film; with --no-film only marks.csv.")] = True,
    force: Force = False,
) -> Answer:
    """Simulate a scenario's tissue; write a recording (film or marks) and true positions."""
    from experiments.formats.scenario import STEPS, read_scenario, scenario_file, scene_file
    from experiments.simulation.simulate import scene_of
    from experiments.simulation.simulate import simulate as write_recording

    read = read_scenario(scenario)
    given = scene_of(read)
    if "--film" in run.given and not (given.cameras or given.space_cameras):
        raise InputError.at("--film", "a scene with a camera", "none")
    first = read.seed if seed is None else seed
    names = [""] if runs is None else [f"seed-{first + k}" for k in range(runs)]
    with run.folder(out, force=force, inputs=[scenario_file(scenario), scene_file(read)]) as folder:
        run.use(scene_of(read), before="simulate")
        advance = run.stage("simulate")
        for k, name in enumerate(names):
            write_recording(
                read.model_copy(update={"seed": first + k}),
                folder / name,
                filmed=film,
                advance=lambda share, done=k: advance((done + share) / len(names)),  # type: ignore[misc]
            )
    own = scenario_file(scenario)
    steps = None if own is None else own.with_name(STEPS)
    page = steps.read_text("utf-8", "replace") if steps is not None and steps.is_file() else ""
    if own is not None and f"simulate {own.name} " in page:  # in a project each recording has its own next step
        line = f"Recording{'s' if runs else ''} in {out}; next: the following step in {steps}"
    else:
        where = out if runs is None else f"{out}/{names[0]}"
        written = f"Recording in {out}" if runs is None else f"{runs} recordings in {where} ..."
        assumed = f" --scene {steps.with_name('scene.toml')}" if steps is not None and page else ""
        line = f"{written}; next: softaim track {where}{assumed} --out {out}-track"
    return Answer({"out": out, "recordings": [out / name for name in names]}, [line])


def register(
    run: Run,
    scene: Annotated[Path, Argument(help="Scene file.")],
    points: Annotated[Path, Option(help="marks.csv, or a recording that has one.")],
    out: Annotated[
        Path, Option(help="Scene file to write; a mesh is written into the same folder.", show_default=False)
    ],
    seconds: Annotated[float, Option(min=0.0, help="Average the points over this initial time [s].")] = 1.0,
    force: Replace = False,
) -> Answer:
    """Register a scene's body rigidly to points measured on it, and report the error at the target."""
    from experiments.commands.console import registration_table
    from experiments.formats.outputs import check_new
    from experiments.formats.scene.scene import usable_scene
    from experiments.pipeline.register import registered, registration_lines, registration_report

    if out.suffix != ".toml":
        raise InputError.at("--out", "a name that ends in .toml", shown(str(out)))
    drawn, mesh = usable_scene(scene), out.with_suffix(".npz")
    check_new(out, force)
    if drawn.mesh is not None:
        check_new(mesh, force)
        is_read = mesh.exists() and mesh.samefile(scene.parent / drawn.mesh.file)
        if is_read and not (out.exists() and out.samefile(scene)):
            raise InputError.at(mesh, f"another file than the mesh of {scene}", "the same")
    run.use(drawn)
    done = registered(drawn, points, seconds, mesh)
    run.write_scene(done.scene, out, "register", recording=points, inputs=[scene], force=force)
    report = registration_report(done)
    line = f"Scene in {out}{f', its mesh in {mesh}' if drawn.mesh else ''}; next: softaim check {out}"
    return Answer({"out": out, **report}, [registration_table(report), *registration_lines(done), line])
