"""Names that were exchanged, from marks on the line to the report."""

import json
from dataclasses import replace

import numpy as np
import pytest

from dynamics import OUTER
from estimators import IdentitySwap, MarkMeasurement
from experiments.formats.recording import Fix
from experiments.formats.scenario import read_scenario
from experiments.pipeline.line import FILTER, OPEN_LOOP, Line
from experiments.pipeline.live.session import Session
from experiments.simulation.simulate import scene_of
from tests.experiments.command import softaim
from tests.experiments.pipeline.tables import write_recording
from vision import Frame

FRAMES, FROM = 30, 20
TIMES_S = np.arange(FRAMES) / 30.0
NOISE_M = 1e-3


@pytest.fixture(scope="module")
def scene():
    return scene_of(read_scenario("webcam"))


@pytest.fixture(scope="module")
def places(scene):
    """The outer masses at rest, seen with noise [m], (n_frames, 3, 2)."""
    network = scene.network
    at = network.positions[[network.index(node) for node in OUTER]]
    return at + np.random.default_rng(0).normal(0.0, NOISE_M, (FRAMES, *at.shape))


def marks(places, k, *, since=FRAMES):
    """The marks of a frame; M3 and M4 exchanged since a frame."""
    names = ("M1", "M4", "M3") if k >= since else OUTER
    return [MarkMeasurement(n, x, NOISE_M**2 * np.eye(2)) for n, x in zip(names, places[k], strict=True)]


def test_every_method_gets_the_marks_by_their_right_names(scene, places):
    """Fixes and the check of each mark, too: to the last bit what comes of no exchange."""
    target = scene.network.positions[scene.network.index(scene.target.node)]
    fixes = [Fix(0.5, target, 1e-3), Fix(0.8, target, 1e-3)]
    lines = [Line(scene, fixes=fixes, check=True) for _ in range(2)]
    for k, time_s in enumerate(TIMES_S):
        right = lines[0].take(time_s, marks(places, k))
        reported = lines[1].take(time_s, marks(places, k, since=FROM))
        assert right.swap is None
        assert (reported.swap is not None) == (k == FROM)
        assert {m.node: tuple(m.position) for m in reported.marks} == {m.node: tuple(m.position) for m in right.marks}
        for method in (FILTER, OPEN_LOOP):
            np.testing.assert_array_equal(reported.estimates[method].mean, right.estimates[method].mean)
        np.testing.assert_array_equal(reported.estimates[FILTER].cov, right.estimates[FILTER].cov)


def test_a_fix_while_names_are_in_doubt_is_not_lost(scene, places):
    """Wrong from the start, and the target sighted before the second frame: in the end as if never wrong."""
    target = scene.network.positions[scene.network.index(scene.target.node)] + 0.002
    lines = [Line(scene, baseline=False, fixes=[Fix(0.01, target, 1e-3)]) for _ in range(2)]
    for k, time_s in enumerate(TIMES_S[:8]):
        right = lines[0].take(time_s, marks(places, k))
        reported = lines[1].take(time_s, marks(places, k, since=0))
    assert len(lines[1].identity.swaps) == 1
    np.testing.assert_array_equal(reported.estimates[FILTER].mean, right.estimates[FILTER].mean)


def test_marks_of_two_hues_are_not_alike(scene):
    """M3 in blue: only M1 and M4 can be taken for each other; the target's own mark, for scoring, is no name."""
    hues = tuple(replace(m, hue_deg=240.0) if m.node == "M3" else m for m in scene.marks)
    assert sorted(map(sorted, replace(scene, marks=hues).nodes_alike)) == [["M1", "M4"], ["M3"]]
    assert Line(replace(scene, marks=hues), baseline=False).identity.interchangeable.nodes == ("M1", "M4")
    assert [sorted(group) for group in scene.nodes_alike] == [sorted(OUTER)]


@pytest.mark.usefixtures("without_pictures")
def test_track_tells_swaps_and_counts_them(scene, places, tmp_path, capsys):
    frames = [(TIMES_S[k], [(m.node, m.position) for m in marks(places, k, since=FROM)]) for k in range(FRAMES)]
    recording = write_recording(tmp_path / "rec", scene, frames, 1e3 * NOISE_M)
    assert softaim("track", recording, "--out", tmp_path / "out") == 0
    *_, reported = capsys.readouterr().err.splitlines(keepends=True)
    assert reported == "softaim: 0.67 s: swap: M3 and M4 had exchanged names since 0.67 s; corrected\n"
    assert json.loads((tmp_path / "out" / "summary.json").read_text())[FILTER]["swaps_undone"] == 1


@pytest.mark.usefixtures("without_pictures")
def test_track_counts_refused_fixes(scene, places, tmp_path, capsys):
    """A single fix 0.5 m off."""
    frames = [(TIMES_S[k], [(m.node, m.position) for m in marks(places, k, since=FRAMES)]) for k in range(FRAMES)]
    recording = write_recording(tmp_path / "rec", scene, frames, 1e3 * NOISE_M)
    (recording / "fixes.csv").write_text(f"time_s,x_mm,y_mm,sd_mm\n{TIMES_S[5]},500,188,1\n", encoding="utf-8")
    assert softaim("track", recording, "--out", tmp_path / "out") == 0
    assert "marks refused: 0, fixes refused: 1" in capsys.readouterr().out
    assert json.loads((tmp_path / "out" / "summary.json").read_text())[FILTER]["fixes_refused"] == 1


def test_live_tells_a_swap(scene, places, tmp_path, monkeypatch, capsys):
    session = Session(scene, tmp_path / "estimates.csv", lambda _text: None)
    made = Line(scene, baseline=False).take(3.2, marks(places, 0))
    swapped = replace(made, swap=IdentitySwap(3.2, 2.1, ("M1", "M3", "M4")))
    monkeypatch.setattr(session.line, "see", lambda _time_s, _image: swapped)
    width, height = scene.cameras[0].size_px
    session.take(Frame(0, 3.2, np.zeros((height, width, 3), dtype=np.uint8)))
    session.close()
    said = "3.20 s: swap: M1, M3 and M4 had exchanged names since 2.10 s; corrected"
    assert capsys.readouterr().err == f"softaim: {said}\n"
