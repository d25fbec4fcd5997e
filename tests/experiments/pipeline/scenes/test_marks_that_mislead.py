"""Tables of marks that mislead: what a track does with them and says of them."""

from pathlib import Path

import numpy as np
import pytest

from estimators import Status
from experiments.formats.marks.rows import MarkRow
from experiments.formats.recording import Recording, read_recording, write_frames_csv, write_marks_csv
from experiments.formats.scenario import read_scenario
from experiments.formats.scene.scene import write_scene
from experiments.pipeline.identify import marks_in
from experiments.pipeline.line import FILTER
from experiments.pipeline.track import summary, track
from experiments.simulation.simulate import scene_of

SCENE = scene_of(read_scenario("webcam"))
INTERVAL_S = 0.1


def recording(folder: Path, n_frames: int, changed=lambda _k, places: places) -> Recording:
    """Marks as drawn, to 1 mm, ten frames a second, with their places changed [m], (n_marks, 2)."""
    rng = np.random.default_rng(11)
    drawn = SCENE.network.positions[[SCENE.network.index(node) for node in SCENE.measured_nodes]]
    cov = np.array([[1e-6, 3e-7], [3e-7, 2e-6]])
    marks = []
    for k in range(n_frames):
        places = changed(k, drawn + rng.multivariate_normal(np.zeros(2), cov, len(drawn)))
        marks.append([MarkRow.of_cov(node, at, cov) for node, at in zip(SCENE.measured_nodes, places, strict=True)])
    write_scene(SCENE, folder / "scene.toml")
    write_frames_csv(folder / "frames.csv", INTERVAL_S * np.arange(n_frames))
    write_marks_csv(folder / "marks.csv", INTERVAL_S * np.arange(n_frames), marks, dim=2)
    return read_recording(folder)


def frozen(first: int, last: int):
    """Changes places so that those of frame `first` are there until frame `last`."""
    held: list[np.ndarray] = []

    def changed(k: int, places: np.ndarray) -> np.ndarray:
        held[:] = [places] if k <= first or k > last else held
        return held[0]

    return changed


def test_values_that_freeze_are_no_marks(tmp_path, caplog) -> None:
    """Frames 10 to 24 repeat frame 9: COASTING from the first on, LOST after a second, then it starts again."""
    opened = recording(tmp_path, 30, frozen(9, 24))
    done = track(opened)
    statuses = [estimate.status for estimate in done.estimates(FILTER)]
    assert set(statuses[10:20]) == {Status.COASTING}
    assert set(statuses[20:25]) == {Status.LOST}
    assert Status.COASTING not in statuses[25:]
    assert Status.LOST not in statuses[25:]
    assert [len(step.marks) for step in done.steps] == [3] * 10 + [0] * 15 + [3] * 5
    assert [len(marks) for _, marks in marks_in(opened)] == [3] * 10 + [0] * 15 + [3] * 5
    assert [len(marks) for marks in opened.marks or ()] == [3] * 30  # the recording itself is as it was
    ours = summary(done)[FILTER]
    assert ours["frames_frozen"] == 15
    assert "15 frames frozen" in ours["verdict"]
    said = [record.message for record in caplog.records if "marks.csv: " in record.message]
    assert [text.partition("marks.csv: ")[2].split(", ")[0] for text in said] == [
        "1.10 s: FROZEN: 2 times the same values",
        "2.50 s: RESUMED: new values after 1.60 s",
    ]


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        (lambda _k, p: p * [1.0, -1.0], "y mirrored: (x, -y) for (x, y)"),
        (lambda _k, p: np.round(1e-3 * p, 6), "lengths in m instead of mm"),
    ],
    ids=["y down", "in m"],
)
def test_a_mirrored_world_is_said_by_the_verdict(tmp_path, caplog, changed, words) -> None:
    done = track(recording(tmp_path, 6, changed))
    assert words in summary(done)[FILTER]["verdict"]
    assert any(words in record.message and record.levelname == "WARNING" for record in caplog.records)


def test_marks_that_lie_as_drawn_are_nothing_to_speak_of(tmp_path, caplog) -> None:
    done = track(recording(tmp_path, 6))
    assert done.counts["frames_frozen"] == 0
    assert "drawn" not in summary(done)[FILTER]["verdict"]
    assert not [record for record in caplog.records if record.levelname == "WARNING"]


def test_a_table_is_not_asked_for_its_hues(tmp_path) -> None:
    verdict = summary(track(recording(tmp_path, 1)))[FILTER]["verdict"]
    assert "hue" not in verdict
    assert "(do times, positions and nodes of the table fit the scene?)" in verdict


def test_the_filter_gets_the_covariance_of_the_table(tmp_path) -> None:
    ((_, marks),) = marks_in(recording(tmp_path, 1))
    for mark in marks:
        np.testing.assert_allclose(mark.cov, [[1e-6, 3e-7], [3e-7, 2e-6]], rtol=1e-8)
