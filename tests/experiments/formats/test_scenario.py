"""Scenario files: what ships, and every fault reported in one line with file, key, expected, found."""

from pathlib import Path

import pytest

from experiments.errors import InputError
from experiments.formats.scenario import read_scenario, shipped
from tests.experiments.rows import complaint, rows

GOOD = """version = 1
title = "a"
phantom = "four-mass"
seed = 4
duration_s = 2.0
frame_interval_s = 0.1
[tremor]
acceleration_m_s2_sqrt_hz = 0.05
[release]
node = "M3"
force_n = [2.0, 0.5]
[pokes]
nodes = ["M1"]
acceleration_m_s2 = 10.0
shortest_s = 0.1
longest_s = 0.4
pause_s = 1.5
[camera]
size_px = [640, 480]
mm_per_px = [1.25, 1.5]
"""

HANGING = Path(__file__).parents[1] / "hanging.toml"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "mine.toml"


def test_the_shipped_scenarios():
    assert shipped() == ["breathing", "paper-camera", "poked", "quiet", "shoved", "webcam"]
    quiet, poked, paper, webcam = (read_scenario(name) for name in ("quiet", "poked", "paper-camera", "webcam"))
    assert quiet.pokes is None
    assert all(s.pokes is not None and s.pokes.nodes == ["M1", "M3", "M4"] for s in (poked, paper, webcam))
    for s in (quiet, poked, paper):
        assert (s.camera.size_px, s.camera.mm_per_px, s.camera.light) == ([640, 480], [4.24, 4.56], "paper")
    assert [s.frame_interval_s for s in (quiet, poked, webcam)] == pytest.approx([1 / 30] * 3, rel=1e-12)
    assert paper.frame_interval_s == 1.09


BARE = 'version = 1\nscene = "body.toml"\n'


@pytest.fixture
def body(tmp_path: Path) -> Path:
    """A scene file beside the scenario: a mass on a spring in space, its mark measured; another hidden."""
    scene = tmp_path / "body.toml"
    scene.write_text(HANGING.read_text())
    return scene


def test_a_scene_needs_no_more_than_its_name(path: Path, body: Path):
    """Paths are from the scenario file; nothing acts; marks to half a millimetre, the phantom's to the paper's 4.14."""
    path.write_text(BARE)
    read = read_scenario(str(path))
    assert (read.scene, read.title, read.seed, read.duration_s) == (str(body), "", 0, 20.0)
    assert read.frame_interval_s == pytest.approx(1 / 30, rel=1e-12)
    assert (read.tremor, read.release, read.pokes, read.breathing) == (None, None, None, None)
    assert (read.seen.sd_mm, read.seen.lost, read.seen.outliers) == (0.5, 0.0, 0.0)
    assert read_scenario("poked").seen.sd_mm == 4.14


def test_forces_are_on_the_measured_nodes_where_none_are_named(path: Path, body: Path):
    times = "acceleration_m_s2 = 1.0\nshortest_s = 1.0\nlongest_s = 2.0\n"
    path.write_text(f"{BARE}[pokes]\npause_s = 1.0\n{times}[breathing]\n{times}[marks]\nsd_mm = 2.0\n")
    read = read_scenario(str(path))
    assert read.pokes.nodes == ["a"]
    assert read.breathing.nodes == ["a"]
    assert read.seen.sd_mm == 2.0


UNFIT = r"""
[marks]\nhue_deg = 1.0\n | marks.hue_deg: expected this key in mark with scene, found it here
[release]\nnode = 'a'\nforce_n = [1.0, 0.0]\n | release.force_n: expected 3 numbers, as the scene has, found 2
[breathing]\nacceleration_m_s2 = 1.0\nshortest_s = 1.0\nlongest_s = 2.0\ndirection = [1.0, 0.0]\n |
    breathing.direction: expected 3 numbers, as the scene has, found 2
"""


@pytest.mark.parametrize(("added", "reported"), rows(UNFIT))
def test_what_does_not_fit_the_scene_is_reported(path: Path, body: Path, added: str, reported: str):
    path.write_text(BARE + added)
    assert complaint(read_scenario, str(path)) == f"{path}: {reported}"


FAULTS = r"""
seed = 4 | sead = 4 | sead: expected one of version, title, scene, phantom
pause_s | pauze_s | pokes.pauze_s: expected one of nodes
seed = 4 | seed = "4" | seed: expected a whole number, found
seed = 4 | seed = -1 | seed: expected 0 or more, found -1
duration_s = 2.0 | duration_s = nan | duration_s: expected a finite number, found nan
duration_s = 2.0 | duration_s = 0.0 | duration_s: expected more than 0, found 0.0
duration_s = 2.0 | duration_s = 1e12 | frame_interval_s: expected duration_s / 1000000 or more
hz = 0.05 | hz = 0.05\ninterval_s = 1e-9 | tremor.interval_s: expected duration_s / 1000000 or more
pause_s = 1.5 | pause_s = 1e-9 | pokes.pause_s: expected duration_s / 1000000 or more
nodes = ["M1"] | nodes = [] | pokes.nodes: expected 1 or more entries, found 0
[1.25, 1.5] | [1.25] | camera.mm_per_px: expected 2 or more entries, found 1
[1.25, 1.5] | [1e-9, 1.5] | camera.mm_per_px[0]: expected 0.01 or more, found 1e-09
phantom = "four-mass"\n |  | expected either scene or phantom, found none
[camera] | [video]\ndistractors = 2\n[camera] | video.distractors: expected this key in camera with phantom
node = "M3" | node = "In2" | release.node: expected a free node, found the anchor "In2"
[2.0, 0.5] | [2.0, 0.5, 1.0] | release.force_n: expected 2 numbers, as the scene has, found 3
[640, 480] | [640, 6] | camera.size_px[1]: expected 64 or more, found 6
nodes = ["M1"] | nodes = ["M9"] | pokes.nodes[0]: no node named "M9"; nodes: M1, M2, M3, M4, In1, …
nodes = ["M1"] | nodes = ["M1"]\ntogether = 1 | pokes.together: expected true or false, found 1
duration_s = 2.0 | duration_s = 0.05 | duration_s: expected more than frame_interval_s, found 0.05
phantom = "four-mass" | phantom = "five-mass" | phantom: expected 'four-mass', found "five-mass"
phantom = "four-mass" | scene = "none.toml" | camera: expected no such table beside scene, whose own camera is used
phantom | scene = "scene.toml"\nphantom | expected either scene or phantom, found both
longest_s = 0.4 | longest_s = 0.01 | pokes: expected longest_s of at least shortest_s (0.1), found 0.01
[camera] | [marks]\nsd_mm = -1\n[camera] | marks.sd_mm: expected more than 0, found -1
version = 1 | version = 2 | version: expected 1, found 2
version = 1 | version 1 | line 1: expected TOML
"""


@pytest.mark.parametrize(("old", "new", "reported"), rows(FAULTS))
def test_a_fault_is_reported_in_one_line(path: Path, old: str, new: str, reported: str):
    assert GOOD.count(old) == 1
    path.write_text(GOOD.replace(old, new))
    assert complaint(read_scenario, str(path)).startswith(f"{path}: {reported}")


def test_a_name_that_is_neither_lists_what_there_is(tmp_path: Path):
    for name in ("quite", str(tmp_path)):
        with pytest.raises(
            InputError, match="expected one of breathing, paper-camera, poked, quiet, shoved, webcam or a scenario file"
        ):
            read_scenario(name)
