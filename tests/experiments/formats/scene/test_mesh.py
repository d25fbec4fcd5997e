"""Scenes of a mesh: read as a network of its points, written back with their mesh, and one line for each fault."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from experiments.formats.mesh.body import tetrahedra
from experiments.formats.mesh.project_file import ProjectMesh, mesh_content
from experiments.formats.scene.mesh import with_line
from experiments.formats.scene.scene import (
    network_digest,
    read_scene,
    scene_digest,
    scene_text,
    usable_scene,
    write_scene,
)
from tests.experiments.formats.mesh.shapes import box
from tests.experiments.rows import complaint, rows

pytestmark = pytest.mark.usefixtures("mesh_cache")

NODES, ELEMENTS = box((4, 3, 3), 0.01)

SCENE = """\
version = 1

[mesh]
file = "mesh.npz"
fixed = "x < 5"

[[mesh.tissue]]
name = "fat"
region = 4
young_kpa = 3.25
poisson = 0.4
density_kg_m3 = 911.0
damping_s = 0.01

[[mesh.tissue]]
name = "gland"
region = 7
young_kpa = 6.5
poisson = 0.4
density_kg_m3 = 1041.0
damping_s = 0.02

[[mesh.point]]
name = "M1"
position_mm = [40.0, 12.0, 13.0]

[[mesh.point]]
name = "M2"
position_mm = [22.0, 30.0, 17.0]

[[mesh.point]]
name = "T"
position_mm = [23.0, 14.0, 12.0]

[[mark]]
node = "M1"
hue_deg = 0.0
diameter_mm = 2.0

[[mark]]
node = "M2"
hue_deg = 120.0
diameter_mm = 2.0

[target]
node = "T"
radius_mm = 5.0
position_sd_mm = 2.0
"""


def folder(path: Path, text: str = SCENE) -> Path:
    regions = np.where(NODES[ELEMENTS].mean(axis=1)[:, 0] < 0.02, 4, 7)
    mesh = replace(tetrahedra(path, NODES, ELEMENTS), regions=regions)
    (path / "mesh.npz").write_bytes(mesh_content(ProjectMesh(mesh, np.empty(0, dtype=np.int64))))
    (path / "scene.toml").write_text(text, encoding="utf-8")
    return path / "scene.toml"


def test_points_are_the_free_nodes_and_the_wall_is_fixed(tmp_path: Path) -> None:
    scene = usable_scene(folder(tmp_path))
    network = scene.network
    assert [network.names[i] for i in network.free] == ["M1", "M2", "T"]
    np.testing.assert_allclose(network.positions[network.index("T")], [0.023, 0.014, 0.012], atol=1e-9)
    np.testing.assert_allclose(network.positions[network.index("M1")], [0.04, 0.012, 0.013], atol=1e-9)
    assert network.fixed.sum() >= 3
    assert (network.positions[network.fixed, 0] == 0.0).all()
    assert network.continuum.tissues == ("fat", "gland")
    # half of the layer at the wall is held
    assert network.continuum.mass == pytest.approx(13.5e-6 * 911.0 + 18e-6 * 1041.0, rel=1e-9)
    assert scene.measured_nodes == ("M1", "M2")
    assert scene.target.position_sd_m == 0.002


def test_a_driven_wall_is_read_and_written(tmp_path: Path) -> None:
    still = read_scene(folder(tmp_path, SCENE.replace('"x < 5"', '"x < 5"\ndriven = false')))
    scene = read_scene(folder(tmp_path))
    assert still.network.is_held
    assert not scene.network.is_held
    assert network_digest(scene) != network_digest(still)
    write_scene(scene, tmp_path / "again.toml")
    again = read_scene(tmp_path / "again.toml")
    assert scene_digest(again) == scene_digest(scene)
    np.testing.assert_array_equal(again.network.continuum.shapes, scene.network.continuum.shapes)
    text = scene_text(scene) + '\n[[reference.mark]]\nname = "wall 1"\nnode = "wall 1"\n'
    (tmp_path / "marked.toml").write_text(text, encoding="utf-8")
    assert "reference.mark[0].node: expected position_mm on the rig" in complaint(read_scene, tmp_path / "marked.toml")


def test_a_scaled_tissue_is_written_with_its_stiffness(tmp_path: Path) -> None:
    """As identification scales it: 1.5 times as stiff a gland is one of 9.75 kPa."""
    scene = read_scene(folder(tmp_path))
    stiffer = replace(scene.network, continuum=scene.network.continuum.scaled(np.array([1.0, 1.5])))
    changed = replace(scene, network=stiffer)
    assert network_digest(changed) != network_digest(scene)
    write_scene(changed, tmp_path / "changed.toml")
    again = read_scene(tmp_path / "changed.toml")
    np.testing.assert_allclose([tissue.young_pa for tissue in again.mesh.tissues], [3250.0, 9750.0], rtol=1e-9)


def test_a_tissue_that_is_fixed_keeps_its_constants(tmp_path: Path) -> None:
    """Region 4 does not deform, so its stiffness, scaled or not, is 0. The other tissue is written as it was scaled."""
    scene = read_scene(folder(tmp_path, SCENE.replace('"x < 5"', '"region 4"')))
    scaled = replace(scene.network, continuum=scene.network.continuum.scaled(np.array([1.5, 1.5])))
    write_scene(replace(scene, network=scaled), tmp_path / "changed.toml")
    tissues = read_scene(tmp_path / "changed.toml").mesh.tissues
    np.testing.assert_allclose([tissue.young_pa for tissue in tissues], [3250.0, 9750.0], rtol=1e-9)
    assert tissues[0] == scene.mesh.tissues[0]


FAULTS = r"""
file = "mesh.npz" | file = "none.npz" | {folder}/none.npz: expected the file of the scene's mesh, found no
file = "mesh.npz" | file = "mesh.npz"\nsha256 = "0" | {folder}/mesh.npz: expected the mesh of SHA-256 0…, as
"x < 5" | "x < -5" | mesh.fixed: expected 3 nodes or more, and not all, found 0 of 80; x is 0 to 40 mm
fixed = "x < 5" | driven = true | mesh.driven: expected the wall that moves in mesh.fixed, found none
fixed = "x < 5" | fixed = "x < 5"\ndriven = 1 | mesh.driven: expected true or false, found 1
region = 7 | region = 4 | mesh.tissue[1].region: expected a unique region, found that of mesh.tissue[0]
region = 7 | region = 8 | mesh.tissue[1].region: expected a region of the mesh, 4, 7, found 8
region = 7 | region = 7.5 | mesh.tissue[1].region: expected a whole number, found 7.5
name = "gland" | name = "fat" | mesh.tissue[1].name: expected a unique name
poisson = 0.4 | poisson = 0.5 | mesh.tissue[0].poisson: expected 0.495 or less, found 0.5
name = "M2" | name = "M1" | mesh.point[1].name: expected a unique name
name = "M2" | name = "wall 2" | mesh.point[1].name: expected a name that no anchor has
[23.0, 14.0, 12.0] | [40.004, 12.0, 13.0] | mesh.point[2].position_mm: expected a unique position, found "T" at that of
    "M1"
[23.0, 14.0, 12.0] | [23.0, 44.0, 12.0] | mesh.point[2].position_mm: expected a place inside the mesh
[target]\nnode = "T" | [target]\nnode = "U" | target.node: no node named "U"
[mesh] | [filter]\nled_nodes = ["M1"]\n\n[mesh] | filter.led_nodes: expected no such key for a mesh
[mesh] | [filter]\npoke_lasting_s = 1.0\n\n[mesh] | filter.poke_lasting_s: expected no such key
[mesh] | [network]\ngravity_m_s2 = [0.0, 0.0]\nnode = []\nspring = []\n\n[mesh] | mesh: expected network or mesh, found
    both
"""


GLAND = SCENE[SCENE.index('[[mesh.tissue]]\nname = "gland"') : SCENE.index("[[mesh.point]]")]
BODY = SCENE[SCENE.index("[mesh]") : SCENE.index("[target]")]
OTHERS = [
    (GLAND, "", "mesh.tissue: expected a tissue for region 7, found none"),
    (BODY, "", "network: expected this key, or mesh in its place, found none"),
]


@pytest.mark.parametrize(("old", "new", "expected"), [*rows(FAULTS), *OTHERS])
def test_faults_are_one_line(tmp_path: Path, old: str, new: str, expected: str) -> None:
    assert old in SCENE
    path = folder(tmp_path, SCENE.replace(old, new, 1))
    said = complaint(read_scene, path)
    assert said.removeprefix(f"{path}: ").startswith(expected.replace("{folder}", str(tmp_path)))


def test_the_mesh_of_another_scene_is_not_overwritten(tmp_path: Path) -> None:
    scene = read_scene(folder(tmp_path))
    other = tmp_path / "other"
    other.mkdir()
    (other / "mesh.npz").write_bytes(b"of another body")
    assert "mesh.npz: expected no file, or the mesh of this scene, found another" in complaint(
        write_scene, scene, other / "scene.toml"
    )
    assert [path.name for path in other.iterdir()] == ["mesh.npz"]


def test_points_on_a_line_are_those_inside(tmp_path: Path) -> None:
    """From the face at z = 30 mm to 15 mm below that at 0; the others and the constants stay as they are."""
    scene = read_scene(folder(tmp_path))
    line = np.array([[0.012, 0.006, 0.03], [0.012, 0.006, -0.015]])
    mesh, network = with_line(scene.mesh, scene.network, line)
    assert [name for name, _ in mesh.points][:3] == ["M1", "M2", "T"]
    own = [k for k, name in enumerate(network.names) if name.startswith("needle ")]
    assert len(own) == 2
    assert not network.fixed[own].any()
    z = network.positions[own, 2]
    np.testing.assert_allclose(network.positions[own, :2], np.tile(line[0, :2], (len(own), 1)), atol=1e-6)
    assert (np.diff(z) < -1e-3).all()
    assert (z > -1e-9).all()
    np.testing.assert_allclose(network.masses, scene.network.masses[0])
    longer, own_ = (np.linalg.inv(one.continuum.stiffness) for one in (network, scene.network))
    np.testing.assert_allclose(longer[:9, :9], own_, atol=1e-6 * own_.max())


def test_a_line_that_reaches_the_wall_ends_before_it(tmp_path: Path) -> None:
    """The line meets two layers of nodes at x = 0 and 10 mm; those with x < 15 mm are fixed."""
    scene = read_scene(folder(tmp_path, SCENE.replace('"x < 5"', '"x < 15"')))
    line = np.array([[0.035, 0.006, 0.006], [-1e-6, 0.006, 0.006]])
    _, network = with_line(scene.mesh, scene.network, line)
    own = [k for k, name in enumerate(network.names) if name.startswith("needle ")]
    assert own
    assert (network.positions[own, 0] > 0.01).all()
    none = with_line(scene.mesh, scene.network, np.array([[0.008, 0.006, 0.006], [0.0, 0.006, 0.006]]))[1]
    assert none.names == scene.network.names


@pytest.mark.parametrize("beside_m", [0.0, 1e-6, 5e-3])
def test_a_named_point_serves_on_a_line_near_it(tmp_path: Path, beside_m: float) -> None:
    """At T, within the half of 15 mm or more, no further point; the names that the mesh has are left to it."""
    scene = read_scene(folder(tmp_path, SCENE.replace('"M1"', '"needle 1"')))
    start = np.array([0.023, 0.014 + beside_m, 0.012])
    mesh, network = with_line(scene.mesh, scene.network, start + np.outer([0.0, 1.0], [-0.02, 0.01, 0.016]))
    assert [name for name, _ in mesh.points] == ["needle 1", "M2", "T", "needle 2"]
    assert np.linalg.norm(network.positions[3] - start) > 0.015
    assert np.linalg.cond(network.continuum.stiffness) < 1e4


def test_in_all_responses_it_has_the_stiffness_of_its_network(tmp_path: Path) -> None:
    """More modes than the filter's, tissues as scaled: a gland twice as stiff."""
    scene = read_scene(folder(tmp_path))
    stiffer = replace(scene.network, continuum=scene.network.continuum.scaled(np.array([1.0, 2.0])))
    whole = scene.mesh.in_all_responses(stiffer)
    assert whole.names == scene.network.names
    assert whole.is_held
    assert len(whole.continuum.rates) > np.isfinite(scene.network.continuum.masses).sum()
    write_scene(replace(scene, network=stiffer), tmp_path / "stiffer.toml")
    exact = read_scene(tmp_path / "stiffer.toml").network.continuum
    np.testing.assert_allclose(whole.continuum.stiffness, exact.stiffness, rtol=1e-6, atol=1e-6 * exact.stiffness.max())
    assert np.abs(whole.continuum.residual).max() < np.abs(exact.residual).max()
