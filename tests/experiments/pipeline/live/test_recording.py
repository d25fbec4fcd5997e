"""A live run is recorded while it goes on, and replayed: the same estimates, bit for bit."""

import csv
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import vision
from experiments.errors import InputError
from experiments.formats.needle_file import read_needle
from experiments.formats.recording import read_recording
from experiments.formats.scenario import read_scenario
from experiments.pipeline.live.control import Control
from experiments.pipeline.live.following import as_written, follow
from experiments.pipeline.live.journal import HEADER, JOURNAL, Act, read_journal
from experiments.pipeline.live.marks.receiver import MarksFrame
from experiments.pipeline.live.recorder_thread import RecorderThread
from experiments.pipeline.live.recording import WAITING, LiveRecording
from experiments.pipeline.live.replaying import Replayed, replay
from experiments.pipeline.live.session import Session
from experiments.simulation.film import draw
from experiments.simulation.simulate import scene_of
from tests.experiments.pipeline.live.test_session import INTERVAL, Clocked
from tests.experiments.pipeline.tables import measured
from tests.experiments.webcam import coarse_webcam
from vision import Frame

NEEDLE = Path("tests/experiments/needle.toml")
SCENE = scene_of(coarse_webcam())


def swinging(n_frames: int, gap: range = range(0)) -> Clocked:
    """A phantom that swings, drawn at each exposure; frames 20 ms later, with a gap."""
    frames, rng = [], np.random.default_rng(5)
    for k in (k for k in range(n_frames) if k not in gap):
        places = SCENE.network.positions.copy()
        places[SCENE.network.free] += [0.006 * np.sin(0.3 * k), 0.004 * np.cos(0.2 * k) - 0.004]
        exposure_s = 100.0 + k * INTERVAL
        frame = Frame(k, exposure_s, draw(SCENE, places, vision.Lighting(), rng, strays=[]))
        frames.append((exposure_s + 0.02, frame))
    return Clocked(frames)


def recorded(folder: Path, source: Clocked, asked: dict[int, object] | None = None, record_at: int = 0) -> Path:
    """The folder of a recording of a run with advice, in which things were asked for at turns of the loop."""
    scene = as_written(SCENE)
    plan = read_needle(NEEDLE, scene.target.radius_m, scene.network.dim)
    session = Session(scene, folder / "estimates.csv", lambda _text: None, needle=plan, clock=lambda: source.now)
    control = Control(session, folder, source="a test", needle=NEEDLE.read_bytes())
    turns = 0

    def attend() -> None:
        nonlocal turns
        if turns == record_at:
            control.record(True)
        if asked and turns in asked:
            asked[turns](control)  # type: ignore[operator]
        turns += 1

    follow(session, source, np.inf, clock=lambda: source.now, attend=attend)
    (found,) = control.finish()
    session.close()
    return found


def again(folder: Path) -> Replayed:
    """What a replay finds; its tables are in `again` beside the recording."""
    out = folder.parent / "again"
    out.mkdir()
    return replay(folder, out)


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_a_replay_gives_the_same_estimates_and_advice_bit_for_bit(tmp_path):
    """Through a gap, a sighting of the target, a new colour of a mark, a pause, a fresh start, a needle drawn out."""
    source = swinging(50, gap=range(11, 16))
    mark = SCENE.marks[0]
    at_px = SCENE.cameras[0].project(SCENE.network.positions[[SCENE.network.index(mark.node)]])[0]
    asked = {
        5: lambda control: control.session.fix(np.array([0.0, 0.19]), 0.002),
        7: lambda control: control.colour_at(mark.node, at_px),
        8: lambda control: control.session.needle_at(np.array([0.0, 0.15]), np.array([0.0, 1.0])),
        9: lambda control: control.session.needle_unseen(),
        10: lambda control: control.session.needle_at(np.array([0.0, 0.15]), np.array([0.0, 1.0])),
        12: lambda control: control.session.pause(True),
        13: lambda control: control.session.reset(),
        14: lambda control: control.session.pause(False),
        16: lambda control: control.session.reset(),
        20: lambda control: control.session.needle_at(np.array([0.0, 0.3]), np.array([0.0, -1.0])),
    }
    folder = recorded(tmp_path, source, asked)
    acts = {done.act for done in read_journal(folder / JOURNAL)}
    assert acts >= {Act.BEGIN, Act.FRAME, Act.COAST, Act.FIX, Act.HUE, Act.NEEDLE, Act.PAUSE, Act.RESET}
    done = again(folder)
    assert done.begun
    assert not done.different
    assert done.rows["estimates.csv"] == len(rows(tmp_path / "estimates.csv")) > 40
    for name in ("estimates.csv", "advice.csv"):
        assert (tmp_path / "again" / name).read_bytes() == (tmp_path / name).read_bytes()
        assert (folder / name).read_bytes() == (tmp_path / name).read_bytes()
    assert {row["advice"] for row in rows(tmp_path / "advice.csv")} > {"ABORT"}


@pytest.fixture(scope="module")
def twelve(tmp_path_factory):
    """A recording of twelve frames, to be read only."""
    return recorded(tmp_path_factory.mktemp("twelve"), swinging(12))


def test_a_replay_that_differs_says_where(twelve, tmp_path):
    folder = shutil.copytree(twelve, tmp_path / "rec")
    table = folder / "estimates.csv"
    lines = table.read_text(encoding="utf-8").splitlines(keepends=True)
    lines[5] = lines[5].replace("0", "1", 1)
    table.write_text("".join(lines), encoding="utf-8")
    assert again(folder).different == {"estimates.csv": 5}


def test_what_a_kill_leaves_is_replayed_up_to_its_last_picture(twelve, tmp_path):
    """A journal that is ahead of the film, and a last row without an end."""
    folder = shutil.copytree(twelve, tmp_path / "rec")
    journal = folder / JOURNAL
    with journal.open("a", encoding="utf-8", newline="") as file:
        file.write("frame,101.0,101.02,[]\r\nframe,101.0333,101.05,[]\r\nfra")
    done = again(folder)
    assert (done.frames, done.lacking, done.different) == (12, 2, {})


def test_a_recording_that_begins_in_the_middle_says_so(tmp_path):
    folder = recorded(tmp_path, swinging(20), record_at=8)
    done = again(folder)
    assert not done.begun
    assert done.frames == 12
    assert rows(folder / "estimates.csv") == rows(tmp_path / "estimates.csv")[8:]


def test_a_recording_that_begins_after_a_reset_begins_in_the_middle(tmp_path):
    assert not again(recorded(tmp_path, swinging(20), {7: lambda control: control.session.reset()}, record_at=8)).begun


def test_marks_of_another_tracker_are_recorded_to_the_last_bit(tmp_path):
    scene = as_written(scene_of(read_scenario("webcam")))
    now = [100.0]
    session = Session(scene, tmp_path / "estimates.csv", lambda _text: None, clock=lambda: now[0])
    control = Control(session, tmp_path, source="a test")
    control.record(True)
    rng, cov = np.random.default_rng(3), 1e-6 * np.array([[1.0, 0.4], [0.4, 2.0]])
    for k in range(15):  # and none in the seventh frame
        now[0] = 100.0 + k / 30.0 + 0.01
        places = scene.network.positions + rng.normal(0.0, 1e-3, scene.network.positions.shape)
        marks = tuple(replace(one, cov=cov) for one in measured(scene, scene.measured_nodes, 1e-3, places))
        session.take(MarksFrame(k, 100.0 + k / 30.0, marks if k != 7 else ()))
    (folder,) = control.finish()
    session.close()
    assert not again(folder).different
    assert (tmp_path / "again" / "estimates.csv").read_bytes() == (tmp_path / "estimates.csv").read_bytes()
    read = read_recording(folder)
    assert len(read.exposures_s) == 15
    covs = [row.cov for rows in read.marks or () for row in rows]
    np.testing.assert_allclose(covs, [cov] * 42, rtol=1e-12)


def test_a_recording_that_ended_takes_nothing_more(tmp_path):
    one = LiveRecording(tmp_path / "r", scene_of(read_scenario("webcam")), needle=None, source="a test", begun=True)
    one.frame(MarksFrame(0, 1.0, ()), 1.0, 1.0, fits=True)
    one.fail(InputError("the disk is full"))
    one.frame(MarksFrame(1, 2.0, ()), 2.0, 2.0, fits=True)
    one.finish()
    assert one.n_frames == 1
    assert [done.act for done in read_journal(one.folder / JOURNAL)] == [Act.BEGIN, Act.MARKS]
    assert (one.folder / "frames.csv").read_text(encoding="utf-8").split() == ["frame,exposure_s", "0,1.000000000"]


def test_a_recording_that_cannot_keep_up_ends_and_the_run_goes_on(tmp_path, monkeypatch, capfd):
    """A thread that never comes to write: after as many pictures as may wait it is said, once."""
    monkeypatch.setattr(RecorderThread, "_work", lambda self: None)
    one = LiveRecording(tmp_path / "r", scene_of(read_scenario("webcam")), needle=None, source="a test", begun=True)
    frame = Frame(0, 0.0, np.zeros((4, 4, 3), np.uint8))
    for k in range(WAITING + 5):
        one.frame(frame, k / 30.0, k / 30.0, fits=True)
    one.finish()
    assert one.n_frames == WAITING
    assert not one.going
    assert capfd.readouterr().err.count("the run continues") == 1
    assert sum(done.act is Act.FRAME for done in read_journal(one.folder / JOURNAL)) == WAITING


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("a,b\n", "header"),
        *[(f"{','.join(HEADER)}\n{row}\n", "row 2") for row in ("frame,1.0", "jump,1.0,1.0,[]", "frame,soon,1.0,[]")],
        (",".join(HEADER) + "\nframe,1.0,1.0,[\n", "row 2"),
        (None, "the journal of a live run, found none"),
    ],
)
def test_a_journal_that_is_none_is_refused_in_one_line(tmp_path, text, found):
    path = tmp_path / JOURNAL
    if text is not None:
        path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=found):
        list(read_journal(path))
