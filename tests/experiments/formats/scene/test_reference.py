"""`[reference]`: what is read and written, what is said of faults, and the names that tables and lines may have."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from experiments.formats.recording import read_marks
from experiments.formats.scene.marks import Mark
from experiments.formats.scene.reference import Reference, ReferenceMark, reference_places
from experiments.formats.scene.scene import Scene, read_scene, scene_digest, write_scene
from experiments.pipeline.live.marks.lines import read_line
from tests.experiments.rows import complaint, rows

GOOD = (Path(__file__).parents[2] / "good_scene.toml").read_text(encoding="utf-8")

MARKS = """
[reference]
drift_sd_mm = 1.5
position_sd_mm = 0.5

[[reference.mark]]
name = "R1"
node = "In1"
hue_deg = 300.0
diameter_mm = 30.0

[[reference.mark]]
name = "R2"
position_mm = [150.0, 20.0]
hue_deg = 300.0
diameter_mm = 20.0
ball = true
"""


def scene_of(text: str, folder: Path) -> Scene:
    path = folder / "scene.toml"
    path.write_text(text, encoding="utf-8")
    return read_scene(path)


def test_reads_every_key_in_si_units(tmp_path):
    scene = scene_of(GOOD + MARKS, tmp_path)
    first = ReferenceMark("R1", "In1", (), Mark("R1", 300.0, 0.03))
    second = ReferenceMark("R2", None, (0.15, 0.02), Mark("R2", 300.0, 0.02, ball=True))
    assert scene.reference == Reference((first, second), 1.5e-3, 5e-4)
    places = reference_places(scene.reference, scene.network)
    np.testing.assert_allclose([places["R1"], places["R2"]], [[0.0, 0.0], [0.15, 0.02]], atol=1e-15)
    assert scene.mark_names == ("M1", "M2", "R1", "R2")
    assert scene.n_calibration == scene.cameras[0].n_calibration + 3


@pytest.mark.parametrize("text", [MARKS, "\n[reference]\ndrift_sd_mm = 0.0\n", MARKS.replace("drift_sd_mm = 1.5", "")])
def test_what_is_written_is_read_and_counts_in_the_digest(tmp_path, text):
    scene = scene_of(GOOD + text, tmp_path)
    write_scene(scene, tmp_path / "again.toml")
    again = read_scene(tmp_path / "again.toml")
    assert again.reference == scene.reference
    assert scene_digest(again) == scene_digest(scene)
    assert scene_digest(replace(scene, reference=Reference())) != scene_digest(scene)


FAULTS = r"""
position_sd_mm = 0.5 | position_sd_mm = -0.5 | reference.position_sd_mm: expected 0 or more
drift_sd_mm = 1.5 | drift_sd_mm = -1.5 | reference.drift_sd_mm: expected 0 or more
node = "In1" |  | reference.mark[0]: expected node or position_mm, found neither
node = "In1" | node = "In1"\nposition_mm = [0.0, 1.0] | expected node or position_mm, found both
node = "In1" | node = "In9" | reference.mark[0].node: no node named
node = "In1" | node = "M2" | reference.mark[0].node: expected an anchor, which is fixed, found
[150.0, 20.0] | [1.0, 2.0, 3.0] | reference.mark[1].position_mm: expected 2 numbers
"R2" | "R1" | reference.mark[1].name: expected a unique name, found that of
"R2" | "M1" | reference.mark[1].name: expected its own node's name or a new one, found
"R2" | "In1" | reference.mark[1].name: expected its own node's name or a new one
hue_deg = 300.0\ndiameter_mm = 30.0 |  | reference.mark[0]: expected hue_deg and diameter_mm, which
diameter_mm = 30.0 |  | expected hue_deg and diameter_mm together, found one of them
300.0\ndiameter_mm = 30.0 | 125.0\ndiameter_mm = 30.0 | reference.mark[0].hue_deg
"""


@pytest.mark.parametrize(("old", "new", "words"), rows(FAULTS))
def test_a_fault_is_one_line_that_names_the_key(tmp_path, old, new, words):
    assert MARKS.count(old) >= 1
    said = complaint(scene_of, GOOD + MARKS.replace(old, new, 1), tmp_path)
    assert words in said
    assert "scene.toml: " in said


def test_an_anchor_may_lend_its_name_to_its_mark(tmp_path):
    scene = scene_of(GOOD + MARKS.replace('"R1"', '"In1"'), tmp_path)
    assert scene.mark_names == ("M1", "M2", "In1", "R2")


def test_without_a_camera_no_look_is_needed(tmp_path):
    scene = scene_of(GOOD + MARKS, tmp_path)
    bare = tuple(replace(mark, look=None) for mark in scene.reference.marks)
    write_scene(replace(scene, cameras=(), reference=Reference(bare)), tmp_path / "bare.toml")
    assert read_scene(tmp_path / "bare.toml").reference.marks == bare


def test_rows_of_a_table_and_lines_carry_a_reference_marks_name(tmp_path):
    scene = scene_of(GOOD + MARKS, tmp_path)
    (tmp_path / "marks.csv").write_text("time_s,node,x_mm,y_mm,sd_mm\n0,M1,1,2,1\n0,R1,3,4,1\n0,R2,5,6,1\n", "utf-8")
    _, (frame,) = read_marks(tmp_path / "marks.csv", scene, None)
    assert [mark.node for mark in frame] == ["M1", "R1", "R2"]
    sent = {"time_s": 0.0, "marks": [{"node": "R2", "x_mm": 5.0, "y_mm": 6.0, "sd_mm": 1.0}]}
    assert read_line(json.dumps(sent).encode(), scene).marks[0].node == "R2"
    plain = replace(scene, reference=Reference())
    assert "R1" in complaint(read_marks, tmp_path / "marks.csv", plain, None)
    assert "R2" in complaint(read_line, json.dumps(sent).encode(), plain)
