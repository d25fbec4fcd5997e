"""New projects, as by `softaim new`: the template of the chosen kind, and the project's files."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path

import numpy as np

from dynamics import NetworkError, breast_phantom, planar_phantom
from dynamics.phantoms.breast import YOUNG_PA
from experiments.errors import InputError, placed
from experiments.formats.outputs import write_together, write_whole
from experiments.formats.scene.scene import mesh_beside
from experiments.projects.mesh_body import MeshChoice, mesh_template
from experiments.projects.mesh_file import read_mesh
from experiments.projects.pages import UNTUNED, needle_page, scenario_page, scene_page, steps_page
from experiments.projects.steps_text import READ_TRUTH
from experiments.projects.template import Template, template

N_MASSES = {"plane": 5, "breast": 10}

UP, FROM_THE_FRONT = (0.3, 1.0), (0.4, 0.3, 1.0)
"""Directions from the target to the needle's entry, in the plane and in space."""

STILL_S, CALIBRATION_S, SCORED_S, BREATHING_S = 2.0, 20.0, 10.0, 20.0
"""Durations of the recordings [s]: at rest, for calibration, for scoring without breathing, for scoring with breathing.
With breathing there are five breaths. The breathing model predicts after two."""


class Kind(StrEnum):
    """Kinds of projects."""

    PLANE = "plane"
    BREAST = "breast"
    MESH = "mesh"


def project(
    kind: Kind,
    *,
    masses: int | None = None,
    young_kpa: float | None = None,
    nodes: Path | None = None,
    springs: Path | None = None,
    mesh: MeshChoice | None = None,
    seed: int = 0,
) -> Template:
    """The template of a project of this kind; raises InputError for options that belong to another kind.

    masses: number of masses of a phantom; young_kpa: Young's modulus [kPa] of an elastic body
    nodes, springs: files of a spring mesh; mesh: options for a body of tetrahedra; seed: seed of the simulated tissue
    """
    belongs = {
        "--masses": (masses, kind in (Kind.PLANE, Kind.BREAST)),
        "--young-kpa": (young_kpa, kind in (Kind.BREAST, Kind.MESH)),
        "--nodes": (nodes, kind is Kind.MESH),
        "--springs": (springs, kind is Kind.MESH),
        "--mesh": (None if mesh is None else mesh.path, kind is Kind.MESH),
    }
    for option, (value, known) in belongs.items():
        if value is not None and not known:
            raise InputError.at(f"--kind {kind}", f"no {option}", str(value))
    young = YOUNG_PA if young_kpa is None else 1e3 * young_kpa
    with placed(f"--kind {kind}", NetworkError):
        if mesh is not None:
            return mesh_template(mesh, young_pa=young if young_kpa is not None else None, seed=seed)
        if kind is Kind.MESH:
            if nodes is None:
                raise InputError.at(f"--kind {kind}", "--mesh FILE or --nodes NODES.csv", "none")
            phantom, hues = read_mesh(nodes, springs, young)
            way = np.array(UP if phantom.network.dim == 2 else FROM_THE_FRONT)
            return template(f"A mesh from {nodes.name}", phantom, hues, way, seed=seed)
        n_masses = N_MASSES[kind] if masses is None else masses
        if kind is Kind.PLANE:
            phantom, way = planar_phantom(n_masses), np.array(UP)
            return template(f"A flat phantom of {n_masses} masses", phantom, {}, way, seed=seed)
        phantom = breast_phantom(n_masses, young)
        way = np.array(FROM_THE_FRONT)
        return template(f"A soft breast of {n_masses} masses", phantom, {}, way, seed=seed)


def write_project(of: Template, folder: Path, *, seed: int = 0) -> None:
    """Write the files of a project to an existing folder. Its recordings use the seeds `seed + 1` to `seed + 3`."""
    scenes = {
        "scene.toml": (of.assumed, f"{of.title}: the assumptions.\ndocs/recording.md has all keys.", UNTUNED),
        "truth/scene.toml": (of.truth, f"The simulated tissue. {READ_TRUTH}", ""),
        "truth/all_marks.toml": (
            of.truth_all_seen,
            f"The simulated tissue with every mark measured. {READ_TRUTH}",
            "",
        ),
    }
    (folder / "truth").mkdir()
    for name, (scene, heading, after) in scenes.items():
        path = folder / name
        write_together({**mesh_beside(scene, path), path: scene_page(scene, heading, after=after)})
    scored_s = SCORED_S if of.assumed.network.continuum is None else BREATHING_S
    recordings = {
        "still.toml": ("At rest, every mark seen", "truth/all_marks.toml", STILL_S, False),
        "calibration.toml": ("With pushes, every mark seen", "truth/all_marks.toml", CALIBRATION_S, True),
        "scenario.toml": ("With pushes, the inside hidden", "truth/scene.toml", scored_s, True),
    }
    for k, (name, (what, tissue, seconds, pokes)) in enumerate(recordings.items(), start=1):
        text = scenario_page(of, what=what, scene=tissue, seed=seed + k, seconds=seconds, pokes=pokes)
        write_whole(folder / name, text)
    write_whole(folder / "needle.toml", needle_page(of))
    write_whole(folder / "STEPS.md", steps_page(of))
