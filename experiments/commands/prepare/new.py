"""`softaim new`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from experiments.commands.options import Force
from experiments.commands.run import Answer, Run

OF_MESH = ("--unit", "--size-mm", "--fixed", "--driven", "--marks", "--target", "--target-sd-mm", "--field", "--region")


def new(
    run: Run,
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of the project; new or empty.")],
    kind: Annotated[
        Literal["plane", "breast", "mesh"],
        typer.Option("--kind", help="plane: flat phantom; breast: soft hemisphere on a wall; mesh: your own body."),
    ] = "plane",
    masses: Annotated[
        int | None, typer.Option("--masses", help="Number of masses; default: 5 for plane, 10 for breast.")
    ] = None,
    young_kpa: Annotated[
        float | None, typer.Option("--young-kpa", min=0.01, help="Young's modulus of breast or mesh [kPa]; default 5.")
    ] = None,
    nodes: Annotated[
        Path | None,
        typer.Option(
            "--nodes", help="CSV of a spring network's nodes: name,x_mm,y_mm[,z_mm,mass_kg,fixed,hue_deg,target]."
        ),
    ] = None,
    springs: Annotated[
        Path | None, typer.Option("--springs", help="CSV of springs: from,to[,stiffness_N_m,damping_N_s_m,group].")
    ] = None,
    mesh: Annotated[
        Path | None,
        typer.Option(
            "--mesh", help="Tetrahedra or a closed surface: VTK, VTU, Gmsh, STL, OBJ, PLY; needs the extra `mesh`."
        ),
    ] = None,
    unit: Annotated[
        Literal["mm", "cm", "m"] | None, typer.Option("--unit", help="With --mesh: length unit of the file; required.")
    ] = None,
    size_mm: Annotated[
        float | None, typer.Option("--size-mm", min=0.1, help="With --mesh: edge length of new tetrahedra [mm].")
    ] = None,
    fixed: Annotated[
        str | None,
        typer.Option("--fixed", help='With --mesh: fixed nodes, e.g. "y<6" [mm], "faces 2" or "region 1"; required.'),
    ] = None,
    driven: Annotated[bool, typer.Option("--driven", help="With --fixed: these nodes are a moving wall.")] = False,
    marks: Annotated[
        str | None,
        typer.Option("--marks", help="With --mesh: number of marks, or a CSV file: name,x_mm,y_mm,z_mm; default: 40."),
    ] = None,
    target: Annotated[
        str | None, typer.Option("--target", help="With --mesh: x,y,z of the target [mm]; default: middle of the body.")
    ] = None,
    target_sd_mm: Annotated[
        float | None,
        typer.Option("--target-sd-mm", min=0.0, help="With --mesh: SD of target position per axis [mm]; default: 0."),
    ] = None,
    field: Annotated[
        str | None,
        typer.Option("--field", help="With --mesh: field with gland shares (0 to 1), or with labels for --region."),
    ] = None,
    region: Annotated[
        list[str] | None,
        typer.Option("--region", help="With --mesh: LABEL=TISSUE (repeat); fat, gland, fibrous, skin, fascia, muscle."),
    ] = None,
    seed: Annotated[
        int, typer.Option("--seed", min=0, help="Seed of the simulated tissue's random deviations from the scene.")
    ] = 0,
    force: Force = False,
) -> Answer:
    """Create a project: a scene to adapt, simulated tissue for practice, a needle, and a list of steps."""
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
            driven,
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
