"""The needle and the pokes of a new project: on a slab held at one end, and in a box with a cyst above the target."""

from collections.abc import Callable
from pathlib import Path

import meshio
import numpy as np
import pytest

from estimators import Insertion
from experiments.formats.needle_file import NeedlePlan, read_needle
from experiments.formats.scenario import read_scenario
from experiments.formats.scene.scene import Scene, read_scene
from experiments.projects.pages import POKED_M
from tests.experiments.command import softaim
from tests.experiments.formats.mesh.shapes import box

TARGET_MM = np.array([41.0, 15.0, 5.5])


def project(folder: Path, cells: tuple[int, int, int], target_mm: str, young_kpa: float, hole: Callable | None) -> Path:
    """A body of cubes of 5 mm without those in the hole, held at x = 0."""
    nodes, elements = box(cells, 5.0)
    if hole is not None:
        elements = elements[~hole(*nodes[elements].mean(axis=1).T)]
        used = np.unique(elements)
        nodes, elements = nodes[used], np.searchsorted(used, elements)
    meshio.write_points_cells(folder / "body.vtu", nodes, [("tetra", elements)])
    words = ("--unit", "mm", "--fixed", "x<1", "--marks", 10, "--young-kpa", young_kpa, "--target", target_mm)
    assert softaim("new", folder / "made", "--kind", "mesh", "--mesh", folder / "body.vtu", *words) == 0
    return folder / "made"


@pytest.fixture(scope="module")
def slab(tmp_path_factory) -> Path:
    """60 x 30 x 10 mm."""
    folder = tmp_path_factory.mktemp("slab")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
        return project(folder, (12, 6, 2), ",".join(map(str, TARGET_MM)), 100.0, None)


def plan_of(slab: Path) -> tuple[Scene, NeedlePlan]:
    scene = read_scene(slab / "scene.toml")
    return scene, read_needle(slab / "needle.toml", scene.target.radius_m, 3)


def test_the_needle_enters_where_it_bends_the_body_little(slab: Path) -> None:
    """The skin nearest to the target, 4.5 mm above, gives way twice as far or more."""
    scene, plan = plan_of(slab)
    push, above = plan.push_on(scene.network, scene.target.point), 1e-3 * TARGET_MM + [0.0, 0.0, 4.5e-3]
    own = np.linalg.norm(push.shift(plan.insertion))
    assert own < 0.5 * np.linalg.norm(push.shift(Insertion(above, [0.0, 0.0, -1.0], 1.0)))
    assert abs(plan.insertion.axis[2]) < 0.5
    assert 1e3 * plan.insertion.entry[0] >= TARGET_MM[0]  # not from the wall at x = 0


def test_the_needle_enters_from_outside(tmp_path: Path, monkeypatch) -> None:
    """A stiff box of 40 x 30 x 30 mm: the nearest surface is that of a cyst, 4 mm above the target."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))

    def cyst(x, y, z):
        return (x > 10.0) & (x < 35.0) & (np.abs(y - 15.0) < 10.0) & (z > 15.0) & (z < 20.0)

    made = project(tmp_path, (8, 6, 6), "25,15,11", 1e4, cyst)
    entry = 1e3 * plan_of(made)[1].insertion.entry
    assert entry[2] == pytest.approx(0.0, abs=0.1)
    assert np.abs(entry[:2] - [25.0, 15.0]).max() < 5.0


def test_the_strongest_poke_moves_the_softest_mark_as_far_as_a_probe(slab: Path) -> None:
    scene, _ = plan_of(slab)
    network, acceleration = scene.network, read_scenario(str(slab / "scenario.toml")).pokes.acceleration_m_s2
    force_N = acceleration * network.masses[network.free[0]]
    moved = []
    for node in scene.measured_nodes:
        at = network.coordinates(node)
        forces = np.zeros((3, len(network.continuum.stiffness)))
        forces[:, at] = force_N * np.eye(3)
        moved.append(np.linalg.svd(np.linalg.solve(network.continuum.stiffness, forces.T)[at])[1][0])
    assert max(moved) == pytest.approx(POKED_M, rel=0.02)  # the file has tenths
