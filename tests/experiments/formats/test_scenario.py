"""Scenario files: what ships, and every fault told in one line with file, key, expected, found."""

from pathlib import Path

import pytest

from experiments.errors import InputError
from experiments.formats.scenario import read_scenario, shipped

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


def test_a_file_is_read_with_its_defaults(path: Path):
    path.write_text(GOOD)
    read = read_scenario(str(path))
    assert (read.seed, read.duration_s, read.camera.mm_per_px) == (4, 2.0, [1.25, 1.5])
    assert read.tremor is not None
    assert read.tremor.interval_s == 1 / 120
    assert (read.camera.light, read.camera.distractors, read.video.codec, read.video.quality) == (
        "webcam",
        0,
        "MJPG",
        95,
    )


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("seed = 4", "sead = 4", "sead: expected one of version, title, phantom"),
        ("pause_s", "pauze_s", "pokes.pauze_s: expected one of nodes"),
        ("seed = 4", 'seed = "4"', "seed: expected a whole number, found "),
        ("seed = 4", "seed = -1", "seed: expected 0 or more, found -1"),
        ("seed = 4\n", "", "seed: expected this key, found none"),
        ("duration_s = 2.0", "duration_s = nan", "duration_s: expected a finite number, found nan"),
        ("duration_s = 2.0", "duration_s = 0.0", "duration_s: expected more than 0, found 0.0"),
        ("duration_s = 2.0", "duration_s = 0.1", "duration_s: expected more than frame_interval_s, found 0.1"),
        ("duration_s = 2.0", "duration_s = 1e12", "frame_interval_s: expected at most 1000000 of them in duration_s"),
        ("hz = 0.05", "hz = 0.05\ninterval_s = 1e-9", "tremor.interval_s: expected at most 1000000 of them"),
        ("pause_s = 1.5", "pause_s = 1e-9", "pokes.pause_s: expected at most 1000000 of them"),
        ("longest_s = 0.4", "longest_s = 0.05", "pokes: expected longest_s of at least shortest_s (0.1), found 0.05"),
        ('nodes = ["M1"]', "nodes = []", "pokes.nodes: expected 1 or more entries, found 0"),
        ('"four-mass"', '"five-mass"', "phantom: expected 'four-mass', found \"five-mass\""),
        ("[1.25, 1.5]", "[1.25]", "camera.mm_per_px: expected 2 or more entries, found 1"),
        ("[1.25, 1.5]", "[1e-9, 1.5]", "camera.mm_per_px[0]: expected 0.01 or more, found 1e-09"),
        ("[640, 480]", "[640, 16]", "camera.size_px[1]: expected 64 or more, found 16"),
        ("version = 1", "version = 2", "version: expected 1, found 2"),
        ("version = 1", "version 1", "line 1: expected TOML"),
    ],
)
def test_a_fault_is_told_in_one_line(path: Path, old: str, new: str, told: str):
    assert GOOD.count(old) == 1
    path.write_text(GOOD.replace(old, new))
    with pytest.raises(InputError) as fault:
        read_scenario(str(path))
    assert str(fault.value).startswith(f"{path}: {told}")
    assert "\n" not in str(fault.value)


def test_a_name_that_is_neither_lists_what_there_is(tmp_path: Path):
    for name in ("quite", str(tmp_path)):
        with pytest.raises(
            InputError, match="expected one of breathing, paper-camera, poked, quiet, shoved, webcam or a scenario file"
        ):
            read_scenario(name)
