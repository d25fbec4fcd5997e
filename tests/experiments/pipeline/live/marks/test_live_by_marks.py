"""The live loop on marks from elsewhere: the estimates of `softaim track`, advice; real pipes, sockets and files."""

import json
import os
import threading
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from experiments.formats.needle_file import read_needle
from experiments.formats.recording import Recording, read_recording
from experiments.pipeline.line import FILTER
from experiments.pipeline.live.following import follow
from experiments.pipeline.live.marks.opening import is_mark_source
from experiments.pipeline.live.marks.replay import MarksReplay
from experiments.pipeline.live.session import Session
from experiments.pipeline.track import track
from tests.experiments.command import softaim
from tests.experiments.pipeline.live.marks.test_replay import Hand
from tests.experiments.simulation.test_simulate_scenes import HANGING, SCENARIO

NEEDLE = "version = 1\nentry_mm = [0.0, -50.0, 60.0]\ndirection = [0.0, 0.0, -1.0]\nspeed_mm_s = 200.0\n"
NEEDLE += "[lesion]\nradius_mm = 8.0\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Two masses that hang in space, pulled aside and let go: a scene without a camera, and a second of marks."""
    folder = tmp_path_factory.mktemp("swing")
    (folder / "hanging.toml").write_text(HANGING)
    (folder / "swing.toml").write_text(SCENARIO.replace("seed = 5\n", ""))
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


def test_a_replay_gives_the_estimates_of_track(tmp_path, recording, folder) -> None:
    """Frame by frame, to the rounding of times; the first frame is at its own time zero."""
    plan = read_needle(folder / "needle.toml", 0.004, 3)
    hand, out = Hand(), tmp_path / "estimates.csv"
    source = MarksReplay(recording.exposures_s, recording.marks, clock=lambda: hand.now, sleep=hand.sleep)
    session = Session(recording.scene, out, lambda _text: None, needle=plan, clock=lambda: hand.now)
    session.integrity.tested_s = -np.inf
    follow(session, source, np.inf, clock=lambda: hand.now)
    session.close()
    rows = pd.read_csv(out)
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


def test_which_names_are_sources_of_marks(tmp_path, folder) -> None:
    for name in ("-", "stdin", "udp://:5005", str(folder / "rec"), str(folder / "rec" / "marks.csv")):
        assert is_mark_source(name), name
    for name in ("0", "film.mp4", "phantom", "film+udp://127.0.0.1:5005", "rtsp://camera/1", str(tmp_path)):
        assert not is_mark_source(name), name


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
    assert "TRACKING" in set(pd.read_csv(out / "estimates.csv")["status"])
    printed, reported = capfd.readouterr()
    assert "malformed" in printed
    assert 'REFUSED: 1 malformed: expected a line of JSON, found "nonsense"' in reported
    assert "Traceback" not in reported
