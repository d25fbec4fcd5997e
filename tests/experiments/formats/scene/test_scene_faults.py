"""Every fault of a scene.toml is reported in one line: file, key, expected, found."""

import re
from pathlib import Path

import pytest

from experiments.formats.scene.scene import read_scene
from tests.experiments.rows import complaint, rows, spoilt

GOOD = (Path(__file__).parents[2] / "good_scene.toml").read_text(encoding="utf-8")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "scene.toml"


BAD = r"""
version = 1 | version =  | line 1: expected TOML, found invalid value at column 11
version = 1 | version = true | version: expected 1, found true
version = 1 |  | version: expected 1, found none
[target] | [aim] | aim: expected one of version, network, mesh, uncertainty, filter, mark, target, reference, camera,
    provenance, found
mass_kg = 0.25\n |  | network.node[1].mass_kg: expected this key for a free node, found none
[target]\nnode = "M2"\nradius_mm = 5.0\n |  | target: expected this key, found none
stiffness_N_m = 80.0 | stiffness_N_m = 80.0\ngroup = "" | network.spring[0].group: expected a name, found ""
mass_kg = 0.25 | mass_kg = true | network.node[1].mass_kg: expected a number, found true
measured = false | measured = 0 | mark[1].measured: expected true or false, found 0
name = "M2" | name = 2 | network.node[1].name: expected text in quotes, found 2
[640, 480] | [640.5, 480] | camera[0].size_px[0]: expected a whole number, found 640.5
[640, 480] | [0, 480] | camera[0].size_px[0]: expected more than 0, found 0
[[camera]] | [camera] | camera: expected a list, found a table
[target] | [[target]] | target: expected a table, found [
[0.0, 200.0] | [0.0, -inf] | network.node[1].position_mm[1]: expected a finite number, found -inf
mass_kg = 0.25 | mass_kg = 0.0 | network.node[1].mass_kg: expected more than 0, found 0
fixed = true | fixed = true\nmass_kg = -0.1 | network.node[2].mass_kg: expected 0 or more, found -0.1
drag_N_s_m = 0.3 | drag_N_s_m = -0.3 | network.node[0].drag_N_s_m: expected 0 or more, found -0.3
friction_N = 0.02 | friction_N = -0.02 | network.node[1].friction_N: expected 0 or more
rest_length_mm = 210.0 | rest_length_mm = 0 | network.spring[1].rest_length_mm: expected more than 0, found 0
stiffness_N_m = 80.0 | stiffness_N_m = 0.0 | network.spring[0].stiffness_N_m: expected more than 0, found 0
damping_N_s_m = 0.6 | damping_N_s_m = -0.6 | network.spring[0].damping_N_s_m: expected 0 or more
[-200, 200.0] | [0.0, 200.0] | network.spring[0].between: expected nodes at different places, found both at [0.0,
    200.0] mm
["M1", "M2"] | ["M2", "In1"] | network.node[0]: expected one or more springs to "M1", found none
name = "M2" | name = "M1" | network.node[1].name: expected a unique name, found "M1", that of network.node[0]
["M2", "In1"] | ["M2", "M9"] | network.spring[1].between: no node named "M9"
["M1", "M2"] | ["M1", "M2", "In1"] | network.spring[0].between: expected 2 entries or fewer, found 3
node = "M1"\nhue | node = "M9"\nhue | mark[0].node: no node named "M9"
node = "M2"\nhue | node = "M1"\nhue | mark[1].node: expected one mark for a node, found a second one on "M1", after
    mark[0]
node = "M2"\nhue | node = "In1"\nhue | mark[1].node: expected a free node (marks belong on free nodes), found the
    anchor "In1"
node = "M2"\nradius | node = "In1"\nradius | target.node: expected a free node (a hidden target), found the anchor
    "In1"
node = "M2"\nradius | node = "M2"\noffset_mm = [0.0, 0.0, 1.0]\nradius | target.offset_mm: expected 2 numbers,
    because the body is in the plane, found 3
["M2", "In1"] | ["M2", "M1"] | network.node[0]: expected springs that lead to an anchor
diameter_mm = 30.0 | diameter_mm = 30.0\nmeasured = false | mark: expected one or more measured marks, found none
radius_mm = 5.0 | radius_mm = 0.0 | target.radius_mm: expected more than 0, found 0
[0.0, 200.0] | [0.0, 200.0, 1.0] | network.node[1].position_mm: expected 2 numbers, because the body is in the
    plane, found 3
[0.0, -9.81] | [-9.81] | network.gravity_m_s2: expected 2 or more entries, found 1
name = "In1" | name = "" | network.node[2].name: expected a name, found ""
[[0.8, 0.0, 319.5], [0.0, -0.8, 391.5], [0.0, 0.0, 1.0]] | [[0,0,0],[0,0,0],[0,0,0]] | camera[0].plane_to_px:
    expected a matrix that can be inverted
[0.8, 0.0, 319.5] | [0.8, 319.5] | camera[0].plane_to_px[0]: expected 3 or more entries, found 2
[0.0, 0.0, 1.0]] | [0.01, 0.0, 1.0]] | camera[0].plane_to_px: expected every node before the camera's horizon, found
    "M1" beyond
["M1", "M2"] | ["M1", "M1"] | network.spring[0].between: expected two different nodes, found ["M1", "M1"]
hue_deg = 120.0 | hue_deg = 400.0 | mark[0].hue_deg: expected less than 360, found 400.0
[[camera]] | [[provenance]]\nstep = "guess"\n[[camera]] | provenance[0].step: expected 'simulate', 'at-rest',
    'identify', 'tune' or 'register', found "guess"
calibration_sd_px = 0.2 | translation_mm = [0, 0, 900] | camera[0]: translation_mm: expected no such key beside
    plane_to_px, found one
"""
CAMERA = GOOD[GOOD.index("[[camera]]") :]
OTHERS = [
    ("version = 1", f"version = {'[' * 5000}", "expected TOML, found lists nested too deeply"),
    ("mass_kg = 0.25", f"mass_kg = 1{'0' * 400}", "network.node[1].mass_kg: expected "),
    (
        GOOD,
        re.sub(r"mass_kg = 0\.25?\n", "fixed = true\n", GOOD),
        "network.node: expected one or more free nodes, found",
    ),
    (
        GOOD,
        GOOD.replace('"In1"', '"In\\n1"'),
        r'network.node[2].name: expected a name that prints on one line, found "In\n1"',
    ),
    (CAMERA, 2 * CAMERA, "camera[1].name: expected a unique name, found that of camera[0]"),
]


@pytest.mark.parametrize(("old", "new", "message"), [*rows(BAD), *OTHERS])
def test_a_fault_is_reported_in_one_line_with_file_key_expected_found(path: Path, old: str, new: str, message: str):
    reported = spoilt(read_scene, path, GOOD, old, new)
    assert reported.startswith(message)
    assert len(reported) < 200


def test_a_plane_camera_before_a_scene_in_space_is_refused(path: Path):
    in_space = (
        GOOD.replace("[0.0, -9.81]", "[0.0, -9.81, 0.0]")
        .replace("[-200, 200.0]", "[-200, 200.0, 0.0]")
        .replace("position_mm = [0.0, 200.0]", "position_mm = [0.0, 200.0, 5.0]")
        .replace("position_mm = [0.0, 0.0]", "position_mm = [0.0, 0.0, 0.0]")
    )
    path.write_text(in_space, encoding="utf-8")
    assert "camera[0].plane_to_px: expected a flat scene, found a network in space" in complaint(read_scene, path)
    path.write_text(in_space[: in_space.index("[[camera]]")], encoding="utf-8")
    assert read_scene(path).network.dim == 3


def test_files_that_cannot_be_read_are_named(tmp_path: Path):
    assert complaint(read_scene, tmp_path / "none.toml").endswith("none.toml: expected a file, found none")
    assert complaint(read_scene, tmp_path).endswith("expected a file, found a folder")
    latin = tmp_path / "latin.toml"
    latin.write_bytes(GOOD.replace('"M2"', '"Mü"', 1).encode("latin-1"))
    assert complaint(read_scene, latin).endswith("latin.toml: line 10: expected UTF-8 text, found byte 0xfc")
    empty = tmp_path / "empty.toml"
    empty.touch()
    assert complaint(read_scene, empty).endswith("empty.toml: version: expected 1, found none")
