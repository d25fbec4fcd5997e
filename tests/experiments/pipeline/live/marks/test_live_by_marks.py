"""The live loop on marks from elsewhere: the estimates of `softaim track`, advice; real pipes, sockets and files."""

import csv
import json
import os
import socket
import threading
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from experiments.formats.needle_file import NeedlePlan, read_needle
from experiments.formats.recording import Recording, read_recording
from experiments.formats.scene.scene import Scene
from experiments.pipeline.line import FILTER
from experiments.pipeline.live.following import follow
from experiments.pipeline.live.marks.opening import is_mark_source
from experiments.pipeline.live.marks.replay import MarksReplay
from experiments.pipeline.live.session import Session
from experiments.pipeline.track import track
from tests.experiments.command import softaim
from tests.experiments.pipeline.live.marks.test_replay import Hand
from tests.experiments.pipeline.live.test_preparing import times_of

ROOT = Path(__file__).parents[5]
SCENARIO = """version = 1
scene = "hanging.toml"
duration_s = 1.0
[release]
node = "a"
force_n = [0.2, 0.0, 0.3]
[marks]
sd_mm = 0.2
"""
NEEDLE = "version = 1\nentry_mm = [0.0, -50.0, 60.0]\ndirection = [0.0, 0.0, -1.0]\nspeed_mm_s = 200.0\n"
NEEDLE += "[lesion]\nradius_mm = 8.0\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Two masses that hang in space, pulled aside and let go: a scene without a camera, and a second of marks."""
    folder = tmp_path_factory.mktemp("swing")
    (folder / "hanging.toml").write_text((ROOT / "tests/experiments/hanging.toml").read_text())
    (folder / "swing.toml").write_text(SCENARIO)
    (folder / "needle.toml").write_text(NEEDLE)
    assert softaim("simulate", folder / "swing.toml", "--out", folder / "rec") == 0
    return folder


@pytest.fixture(scope="module")
def recording(folder) -> Recording:
    return read_recording(folder / "rec")


def line(time_s: float, recording: Recording, k: int) -> bytes:
    """Frame k of a recording as another tracker sends it, at a time by its clock [s]."""
    marks = [
        {"node": mark.node, **dict(zip(("x_mm", "y_mm", "z_mm"), 1e3 * mark.position_m, strict=True)), "sd_mm": 0.2}
        for mark in recording.marks[k]
    ]
    return json.dumps({"time_s": time_s, "marks": marks}).encode() + b"\n"


def replayed(scene: Scene, out: Path, times_s, marks, plan: NeedlePlan | None = None) -> tuple[Session, pd.DataFrame]:
    """The session of a replay by a clock of the test's own, its forces tested, and its rows."""
    hand = Hand()
    source = MarksReplay(times_s, marks, clock=lambda: hand.now, sleep=hand.sleep)
    session = Session(scene, out / "estimates.csv", lambda _text: None, needle=plan, clock=lambda: hand.now)
    session.integrity.tested_s = -np.inf
    follow(session, source, np.inf, clock=lambda: hand.now)
    session.close()
    return session, pd.read_csv(out / "estimates.csv")


def test_a_replay_gives_the_estimates_of_track(tmp_path, recording, folder) -> None:
    """Frame by frame, to the rounding of times; the first frame is at its own time zero."""
    plan = read_needle(folder / "needle.toml", 0.004, 3)
    session, rows = replayed(recording.scene, tmp_path, recording.exposures_s, recording.marks, plan)
    expected = track(recording).estimates(FILTER)
    assert session.counters.frames == len(rows) == len(expected) == len(recording.exposures_s)
    assert list(rows["status"]) == [str(one.status) for one in expected]
    assert Counter(rows["status"])["TRACKING"] > 20
    np.testing.assert_allclose(
        rows[["x_mm", "y_mm", "z_mm"]], 1e3 * np.array([one.mean for one in expected]), rtol=0, atol=1e-6
    )
    advice = pd.read_csv(tmp_path / "advice.csv")
    assert len(advice) == len(rows)
    assert {"GO", "WAIT", "REALIGN"} & set(advice["advice"])


def test_frames_without_marks_coast_as_those_of_a_camera_do(tmp_path, recording) -> None:
    """Half a second of marks, then frames without: COASTING, and LOST a second after the last mark."""
    n, times = 15, np.arange(60) / 30.0
    marks = [*recording.marks[:n], *((),) * (len(times) - n)]
    session, rows = replayed(recording.scene, tmp_path, times, marks)
    since = rows["time_s"] - rows["time_s"].iloc[n - 1]
    assert set(rows["status"][(since > 0.0) & (since < 0.99)]) == {"COASTING"}
    assert set(rows["status"][since > 1.01]) == {"LOST"}
    assert session.counters.without_frame == 0


def test_marks_that_are_not_played_yet_tell_their_own_time(tmp_path, folder) -> None:
    times = times_of(folder / "rec", tmp_path / "out")
    assert set(times.before) == {0.0}
    assert 0.0 <= min(times.then) <= max(times.then) < 3.0


def test_which_names_are_sources_of_marks(tmp_path, folder) -> None:
    for name in ("-", "stdin", "udp://:5005", str(folder / "rec"), str(folder / "rec" / "marks.csv")):
        assert is_mark_source(name), name
    for name in ("0", "film.mp4", "phantom", "film+udp://127.0.0.1:5005", "rtsp://camera/1", str(tmp_path)):
        assert not is_mark_source(name), name


@pytest.mark.slow
def test_a_file_of_marks_is_followed_by_the_command(tmp_path, folder, capsys) -> None:
    out, marks = tmp_path / "out", folder / "rec" / "marks.csv"
    assert softaim("live", "--source", marks, "--out", out, "--needle", folder / "needle.toml", "--no-page") == 0
    rows = pd.read_csv(out / "estimates.csv")
    assert rows["status"].iloc[-1] == "TRACKING"
    assert len(pd.read_csv(out / "advice.csv")) >= len(rows) > 3
    assert "ENDED: after the last frame" in capsys.readouterr().err


@pytest.fixture
def pipe() -> Iterator[int]:
    """The writing end of a pipe that is this process's standard input."""
    before, (theirs, mine) = os.dup(0), os.pipe()
    os.dup2(theirs, 0)
    os.close(theirs)
    yield mine
    os.dup2(before, 0)
    os.close(before)


@pytest.mark.slow
def test_lines_through_a_pipe_are_followed_and_garbage_stops_nothing(tmp_path, folder, recording, pipe, capfd) -> None:
    """Frames at their pace until a second of them is followed, with garbage between; the end of the pipe ends it."""
    out = tmp_path / "out"

    def send() -> None:
        with os.fdopen(pipe, "wb", buffering=0) as lines:
            lines.write(b"nonsense\n")
            for k in range(3000):
                lines.write(line(0.04 * k, recording, k % len(recording.marks)) + b"[1, 2]\n" * (k % 7 == 0))
                time.sleep(0.04)
                if (out / "estimates.csv").exists() and (out / "estimates.csv").read_bytes().count(b"\n") > 25:
                    return

    sending = threading.Thread(target=send)
    sending.start()
    assert softaim("live", "--source", "-", "--scene", folder / "hanging.toml", "--out", out, "--no-page") == 0
    sending.join()
    with (out / "estimates.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert any(row["status"] == "TRACKING" for row in rows)
    printed, reported = capfd.readouterr()
    assert "malformed" in printed
    assert 'REFUSED: 1 malformed: expected a line of JSON, found "nonsense"' in reported
    assert "Traceback" not in reported


@pytest.mark.slow
def test_datagrams_are_followed_for_a_while(tmp_path, folder, recording, capsys) -> None:
    """Each frame is sent twice: the second is refused."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    over = threading.Event()

    def send() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            k = 0
            while not over.wait(0.03):
                k += 1
                for _ in range(2):
                    sender.sendto(line(0.03 * k, recording, k % len(recording.marks)), ("127.0.0.1", port))

    sending = threading.Thread(target=send)
    sending.start()
    words = "--source", f"udp://:{port}", "--scene", folder / "hanging.toml", "--out", tmp_path / "out"
    code = softaim("live", *words, "--duration", 1.5, "--json", "--no-page")
    over.set()
    sending.join()
    assert code == 0
    printed = capsys.readouterr()
    counted = json.loads(printed.out)
    assert counted["frames"] > 3
    assert counted["statuses"]["TRACKING"] > 0
    assert counted["refused"]["out of order"] > 3
    assert "REFUSED: 1 out of order: time_s: expected more than" in printed.err
