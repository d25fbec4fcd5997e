"""User meshes: the network equals the files, and faults are reported by file, row and column."""

from pathlib import Path

import numpy as np
import pytest

from dynamics import rest_shape
from experiments.formats.scene.scene import read_scene
from experiments.projects.mesh_file import read_mesh
from tests.experiments.command import softaim
from tests.experiments.commands.good_files import NODES as PLANE
from tests.experiments.rows import complaint, rows

SPACE = """name,x_mm,y_mm,z_mm,fixed
A,0,0,0,yes
B,60,0,0,yes
C,0,60,0,yes
D,60,60,0,yes
E,0,0,50,
F,60,0,50,
G,0,60,50,
H,60,60,50,
I,30,30,20,
"""
TINY = """name,x_mm,y_mm,fixed
A,0,0,yes
B,0.1,0,yes
C,0,0.06,
D,0.1,0.06,
E,0.05,0.03,
"""
SPRINGS = """from,to,stiffness_N_m,damping_N_s_m,group
A,C,150,0.3,side
B,D,150,0.3,side
A,E,120,0.2,inner
B,E,120,0.2,inner
C,E,120,0.2,inner
D,E,120,0.2,inner
C,D,100,0.2,side
"""


def mesh_of(folder: Path, nodes: str, springs: str | None = None, young: float = 5e3):
    (folder / "nodes.csv").write_text(nodes)
    if springs is not None:
        (folder / "springs.csv").write_text(springs)
    return read_mesh(folder / "nodes.csv", None if springs is None else folder / "springs.csv", young)


def test_a_flat_mesh_with_its_own_springs(tmp_path) -> None:
    phantom, hues = mesh_of(tmp_path, PLANE, SPRINGS)
    network = phantom.network
    assert network.names == ("A", "B", "C", "D", "E")
    assert network.fixed.tolist() == [True, True, False, False, False]
    np.testing.assert_allclose(network.masses[2:], [0.005, 0.005, 0.008])
    np.testing.assert_allclose(network.stiffness, [150, 150, 120, 120, 120, 120, 100])
    np.testing.assert_allclose(network.damping, [0.3, 0.3, 0.2, 0.2, 0.2, 0.2, 0.2])
    assert phantom.groups == ("side", "side", "inner", "inner", "inner", "inner", "side")
    assert (phantom.target, phantom.outer, hues) == ("E", ("C", "D"), {"C": 0.0, "D": 120.0})
    np.testing.assert_allclose(rest_shape(network), network.positions, atol=1e-9)


def test_a_mesh_in_space_is_joined_marked_and_aimed_at_by_the_program(tmp_path) -> None:
    """Without springs, hues and target: triangulated, marks on corners of the hull, the node in the middle meant."""
    phantom, hues = mesh_of(tmp_path, SPACE)
    assert phantom.target == "I"
    assert phantom.outer == ("E", "F", "G", "H")
    assert hues == {}
    pairs = {tuple(pair) for pair in phantom.network.springs.tolist()}
    assert (4, 8) in pairs
    assert not any(j < 4 for _, j in pairs)
    stiffer = mesh_of(tmp_path, SPACE, young=1e4)[0].network
    np.testing.assert_allclose(stiffer.stiffness, 2.0 * phantom.network.stiffness)


def test_a_project_of_a_mesh(tmp_path) -> None:
    (tmp_path / "nodes.csv").write_text(PLANE)
    assert softaim("new", tmp_path / "made", "--kind", "mesh", "--nodes", tmp_path / "nodes.csv") == 0
    scene = read_scene(tmp_path / "made" / "scene.toml")
    hues = {mark.node: (mark.hue_deg, mark.measured) for mark in scene.marks}
    assert hues["C"] == (0.0, True)
    assert hues["D"] == (120.0, True)
    assert not hues["E"][1]
    assert scene.target.node == "E"


def test_a_body_of_a_millimetre_has_marks_and_a_camera(tmp_path) -> None:
    (tmp_path / "nodes.csv").write_text(PLANE.replace("00,", ",").replace("60", "1").replace("50,30", ".5,.5"))
    words = ("--kind", "mesh", "--nodes", tmp_path / "nodes.csv", "--young-kpa", 1e4)
    assert softaim("new", tmp_path / "made", *words) == 0
    scene = read_scene(tmp_path / "made" / "scene.toml")
    assert {mark.diameter_m for mark in scene.marks} == {1e-4}
    assert scene.cameras[0].mm_per_px(scene.network.positions[4]) == pytest.approx((0.01, 0.01))


NODE_FAULTS = """
C,0,60 | A,0,60 | nodes.csv: row 4: name: expected a unique name, found "A"
B,100 | ,100 | nodes.csv: row 3: name: expected a name, found ""
C,0 | C ,0 | row 4: name: expected a name that prints on one line, found
0.005,,0, | -1,,0, | nodes.csv: row 4: mass_kg: expected more than 0, found -1
0.005,,0, | 0.005,,red, | nodes.csv: row 4: hue_deg: expected 0 or more and less than 360
0,yes,, | 0,yes,5, | nodes.csv: row 2: hue_deg: expected no entry for an anchor
0,yes,, | 0,no,, | nodes.csv: row 2: fixed: expected yes or no entry, found "no"
120, | 120,yes | nodes.csv: row 6: target: expected one target, found a second one
60,0.005,,0, | 60,5.0,,0, | nodes.csv: rest_length A-C: expected to rest
"""
SPRING_FAULTS = r"""
from,to\nA,Q\n | springs.csv: row 2: to: no node named "Q"
from,to\nC,C\n | springs.csv: row 2: to: expected another node than in from, found
from,to\nA,C\nC,A\n | springs.csv: row 3: to: expected each pair once, found
from,to\nA,C\n | springs.csv: node "D": expected at least one spring, found none
from,to\n | springs.csv: expected a row for each spring, found none
from,to,stiffness_N_m\nA,C,0\n | springs.csv: row 2: stiffness_N_m: expected more than 0, found 0
from,to,damping_N_s_m\nA,C,-1\n | springs.csv: row 2: damping_N_s_m: expected 0 or more, found -1
"""
LINE = "name,x_mm,y_mm,mass_kg,fixed\nA,0,0,1,yes\nB,0,-50,0.01,\nC,0,-90,0.01,\n"
LINE_SPRINGS = "from,to,stiffness_N_m,damping_N_s_m\nA,B,99,0.1\nB,C,99,0.1\n"
FAULTS = [
    *((PLANE.replace(old, new, 1), None, message) for old, new, message in rows(NODE_FAULTS)),
    *((PLANE, springs, message) for springs, message in rows(SPRING_FAULTS)),
    (PLANE.replace("8,,,yes", "8,,,").replace("0,yes,,", "0,yes,,yes", 1), None, "target: expected no entry for an"),
    (PLANE.replace("005,,120", "005,yes,").replace("005,,0", "005,yes,"), None, "expected two or more free nodes"),
    ("name,x_mm\nA,1\n", None, "nodes.csv: row 1: expected one column y_mm, found none"),
    ("", None, "nodes.csv: expected columns x_mm, y_mm, name, found an empty file"),
    (TINY, None, "springs of 0.4 mm or more"),
    (PLANE.replace("100,", "0,").replace("50,", "0,"), None, "nodes.csv: nodes: expected them not all in a line"),
    (SPACE.replace(",50,", ",0,").replace(",20,", ",0,"), None, "nodes.csv: nodes: expected them not all in a line"),
    (LINE, LINE_SPRINGS, "nodes.csv: nodes: expected them not all in a line or plane, found a body without volume"),
]


@pytest.mark.parametrize(("nodes", "springs", "message"), FAULTS)
def test_faults_are_reported_by_file_row_and_column(nodes, springs, message, tmp_path) -> None:
    assert message in complaint(mesh_of, tmp_path, nodes, springs)
