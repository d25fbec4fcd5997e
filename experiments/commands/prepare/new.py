"""`softaim new`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from experiments.commands.options import Force
from experiments.commands.run import Answer, Run


def new(
    run: Run,
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of the project; new or empty.")],
    kind: Annotated[
        Literal["plane", "breast", "mesh"],
        typer.Option("--kind", help="plane: a flat phantom; breast: a soft hemisphere on a wall; mesh: your own."),
    ] = "plane",
    masses: Annotated[
        int | None, typer.Option("--masses", help="Number of masses; default: 5 in the plane, 10 for a breast.")
    ] = None,
    young_kpa: Annotated[
        float | None, typer.Option("--young-kpa", min=0.01, help="Young's modulus of a breast or mesh; default 5.")
    ] = None,
    nodes: Annotated[
        Path | None,
        typer.Option("--nodes", help="Nodes of a mesh: name,x_mm,y_mm[,z_mm,mass_kg,fixed,hue_deg,target]."),
    ] = None,
    springs: Annotated[
        Path | None, typer.Option("--springs", help="Springs of a mesh: from,to[,stiffness_N_m,damping_N_s_m,group].")
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the differences of the simulated tissue.")] = 0,
    force: Force = False,
) -> Answer:
    """Make a project: a scene to adapt, simulated tissue for practice, a needle, and a page of steps."""
    from experiments.projects.project import Kind, project, write_project

    made = project(Kind(kind), masses=masses, young_kpa=young_kpa, nodes=nodes, springs=springs, seed=seed)
    with run.folder(folder, force=force, inputs=[nodes, springs]) as work:
        write_project(made, work, seed=seed)

    def show() -> None:
        target = made.assumed.target.node
        print(f"{made.title}, target {target}, in {folder}")
        print(f"Next: cd {folder}; softaim check scene.toml --out check; STEPS.md has all steps")

    return Answer({"out": folder, "title": made.title, "target": made.assumed.target.node}, show)
