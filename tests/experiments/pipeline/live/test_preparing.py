"""While a run is prepared its frames are shown and counted, not used; what is not compiled another process compiles."""

import importlib
import logging
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import nullcontext
from functools import partial
from unittest.mock import Mock

import numpy as np
import pytest

from estimators import Advice
from experiments.formats.needle_file import read_needle
from experiments.log import LOG
from experiments.pipeline.live import preparing
from experiments.pipeline.live.following import live
from experiments.pipeline.live.preparing import NICENESS, PREPARING, prepared
from experiments.servers.publisher import Shows
from experiments.simulation.simulate import scene_of, simulate
from tests.experiments.servers.test_publisher import NEEDLE, Link
from tests.experiments.webcam import coarse_webcam
from vision import Frame

KERNELS = """
import os
from pathlib import Path
from unittest.mock import Mock
from numba import njit

@njit(cache=True)
def twice(x):
    return 2.0 * x

def rehearse(path):
    Path(path).write_text(f"{os.getpid()} {os.nice(0)}")
    twice(1.0)
"""


class Frames:
    """A source that gives a frame whenever it is asked, and leaves others the processor before. State: how many."""

    ended = False

    def __init__(self) -> None:
        self.n = 0

    def next(self, timeout_s: float) -> Frame:
        time.sleep(timeout_s)
        self.n += 1
        return Frame(self.n, self.n / 30.0, np.full((48, 64, 3), 7, np.uint8))


class Shown:
    """What was shown, and whether so much was. State: it."""

    def __init__(self, enough: int = 3) -> None:
        self.frames: list[tuple[Frame | None, int]] = []
        self._n, self.enough = enough, threading.Event()

    def __call__(self, frame: Frame | None, n_shown: int) -> None:
        self.frames.append((frame, n_shown))
        if len(self.frames) >= self._n:
            self.enough.set()

    def wait(self) -> bool:
        """Until so much was shown; whether it was."""
        return self.enough.wait(60.0)


@pytest.fixture
def kernels(tmp_path, monkeypatch):
    """A module of a kernel that was never compiled, with a cache of its own."""
    name = f"kernels_{tmp_path.name}"
    (tmp_path / f"{name}.py").write_text(KERNELS)
    monkeypatch.syspath_prepend(tmp_path)
    yield importlib.import_module(name)
    del sys.modules[name]


LOADED = """
import sys, experiments.servers.opening, experiments.simulation.phantom_process
print(*sys.modules)
import experiments.pipeline.live.following, experiments.servers.publisher
print(*sys.modules)
"""


def test_a_run_loads_nothing_that_it_has_no_use_for():
    """Those that serve and draw load little, so that they begin first; a run loads what its first picture needs."""
    done = subprocess.run([sys.executable, "-c", LOADED], capture_output=True, text=True, check=True)
    others, run = (set(line.split()) for line in done.stdout.splitlines())
    assert not others & {"numba", "scipy", "pydantic", "estimators"}
    assert not run & {"pandas", "matplotlib", "scipy.signal"}
    assert "experiments.pipeline.live.following" in run


def no_process() -> Callable[[], None]:
    """What cannot be sent to another process."""
    return lambda: None


def test_frames_are_shown_until_all_is_made_which_takes_as_long_as_it_likes():
    shown = Shown(5)
    made, n_shown = prepared(shown.wait, no_process(), Frames(), shown)
    assert made is True
    assert n_shown == len(shown.frames) >= 5
    assert [n for _, n in shown.frames] == list(range(1, n_shown + 1))


def test_no_frame_of_a_film_is_taken_and_that_the_run_lives_is_shown():
    shown = Shown()
    assert prepared(shown.wait, no_process(), None, shown) == (True, 0)
    assert set(shown.frames) == {(None, 0)}


def test_what_cannot_be_made_is_raised():
    def fails() -> None:
        raise ValueError("no such kernel")

    with pytest.raises(ValueError, match="no such kernel"):
        prepared(fails, no_process(), Frames(), Shown())


@pytest.mark.slow
def test_what_is_not_compiled_another_process_compiles_meanwhile_and_behind_all_others(kernels, tmp_path):
    """Then this one loads it."""
    shown, path = Shown(), tmp_path / "process"
    made, n_shown = prepared(partial(kernels.twice, 3.0), partial(kernels.rehearse, path), Frames(), shown)
    assert made == 6.0
    assert n_shown > 3
    pid, niceness = map(int, path.read_text().split())
    assert pid != os.getpid()
    assert niceness == min(os.nice(0) + NICENESS, 19)
    assert (sum(kernels.twice.stats.cache_hits.values()), sum(kernels.twice.stats.cache_misses.values())) == (1, 1)


def test_what_is_in_the_cache_needs_no_other_process(kernels):
    kernels.twice(3.0)
    again = importlib.reload(kernels)
    assert prepared(partial(again.twice, 3.0), no_process(), Frames(), Shown())[0] == 6.0
    assert sum(again.twice.stats.cache_hits.values()) == 1


@pytest.mark.slow
def test_where_that_process_is_killed_this_one_compiles(kernels, caplog):
    caplog.set_level(logging.WARNING, LOG.name)
    killed = partial(signal.raise_signal, signal.SIGKILL)
    assert prepared(partial(kernels.twice, 3.0), killed, Frames(), Shown())[0] == 6.0
    assert [f"ended with exit code {-signal.SIGKILL}," in line for line in caplog.messages] == [True]


def test_others_may_compile_while_a_run_is_prepared(kernels):
    shown, doubled = Shown(), []

    def show(frame: Frame | None, n_shown: int) -> None:
        doubled.append(kernels.twice(1.0))
        shown(frame, n_shown)

    assert prepared(shown.wait, no_process(), Frames(), show)[0] is True
    assert set(doubled) == {2.0}


def test_a_film_that_has_not_begun_tells_its_own_time(tmp_path, monkeypatch):
    """Nought, from which its states go on: a client that ties times to its own clock by the first keeps that tie."""
    simulate(coarse_webcam().model_copy(update={"duration_s": 0.2}), tmp_path / "rec")
    viewer, is_shown = Mock(), threading.Event()
    viewer.prepare.side_effect = lambda *_args: is_shown.set()
    monkeypatch.setattr(preparing, "_from_cache", lambda make: is_shown.wait() and make())
    live([str(tmp_path / "rec")], None, lambda _scene: nullcontext(tmp_path), attendant=lambda _scene, _plan: viewer)
    before = {time_s for _frame, _n_shown, time_s in (call.args for call in viewer.prepare.call_args_list)}
    then = [shown.estimate.time_s for shown, _line in (call.args for call in viewer.publish.call_args_list)]
    assert before == {0.0}
    assert 0.0 <= min(then) <= max(then) < 2.0


def test_viewers_see_the_picture_why_there_is_nothing_else_and_no_guidance():
    scene = scene_of(coarse_webcam())
    plan, link = read_needle(NEEDLE, scene.target.radius_m, 2), Link()
    with Shows(link, scene, plan, "a test") as shows:  # type: ignore[arg-type]
        frame = Frames().next(0.0)
        shows.prepare(None, 0, 0.0)
        assert not link.reported
        shows.prepare(frame, 1, frame.exposure_s)
    before, state = link.states
    assert (before["time_s"], state["time_s"]) == (0.0, frame.exposure_s)
    assert before["utc_s"] == pytest.approx(time.time(), abs=10.0)
    assert state["utc_s"] == pytest.approx(time.time() - time.monotonic() + frame.exposure_s, abs=10.0)
    assert link.reported
    assert link.pictures == [None, frame.image]
    assert (state["status"], state["fault"]) == ("INITIALISING", PREPARING)
    assert state["target_mm"] is state["cov_mm2"] is None
    assert state["advice"]["advice"] == Advice.NO_GUIDANCE
    assert (state["counters"]["frames"], state["counters"]["not_used"]) == (0, 1)
