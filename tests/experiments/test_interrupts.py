"""Ctrl-C while a kernel is called is an interrupt, and no fault of the program."""

import ctypes
import os
import signal
import sys
import threading
import time
from contextlib import nullcontext

import numpy as np
import pytest
from numba import njit

from experiments.commands import app
from experiments.interrupts import as_interrupts
from experiments.pipeline.live.following import live
from experiments.pipeline.live.session import Session
from experiments.simulation.simulate import simulate
from tests.experiments.webcam import coarse_webcam

POSIX = pytest.mark.skipif(sys.platform == "win32", reason="a signal to itself")


@njit(nogil=True)
def copied(x, P):  # type: ignore[no-untyped-def]
    return x.copy(), P.copy()


def called_until_interrupted(by: signal.Signals = signal.SIGINT) -> None:
    """Call a kernel again and again, for a minute at most; the signal comes after a moment."""
    x, P = np.zeros(10), np.eye(10)
    copied(x, P)
    threading.Timer(0.05, os.kill, (os.getpid(), by)).start()
    until_s = time.monotonic() + 60.0
    while time.monotonic() < until_s:
        copied(x, P)


@POSIX
def test_an_interrupt_of_a_kernel_is_one():
    with pytest.raises(KeyboardInterrupt), as_interrupts():
        called_until_interrupted()


@POSIX
def test_an_interrupt_of_a_callback_from_c_is_not_lost(capfd):
    """The compiler's cache is such a callback: a run went on for two minutes, and ended with code 0."""
    callback = ctypes.CFUNCTYPE(None)(lambda: os.kill(os.getpid(), signal.SIGINT))
    hook = sys.unraisablehook
    with pytest.raises(KeyboardInterrupt), as_interrupts():
        [callback(), *map(time.sleep, [0.01] * 1000)]
    assert sys.unraisablehook is hook
    assert capfd.readouterr().err == ""


def test_another_fault_of_the_system_stays():
    with pytest.raises(SystemError, match="another"), as_interrupts():
        raise SystemError("another")


@POSIX
def test_a_live_run_ends_well_by_it(tmp_path, monkeypatch):
    """After a frame: earlier estimates are reported."""
    simulate(coarse_webcam().model_copy(update={"duration_s": 1.0}), tmp_path / "rec")
    takes, out = Session.take, tmp_path / "out"
    out.mkdir()

    def take(session: Session, frame, waited_s: float = 0.0) -> bool:
        if session.counters.frames == 1:
            called_until_interrupted()
        return takes(session, frame, waited_s)

    monkeypatch.setattr(Session, "take", take)
    done = live([str(tmp_path / "rec")], None, lambda _scene: nullcontext(out))
    assert (done["frames"], done["fault"]) == (1, None)


@POSIX
@pytest.mark.parametrize("by", [signal.SIGINT, signal.SIGTERM])
def test_any_command_says_that_it_was_interrupted(monkeypatch, capsys, by):
    monkeypatch.setattr(app, "app", lambda **_kwargs: called_until_interrupted(by))
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(SystemExit) as ended:
        app.main()
    assert signal.getsignal(signal.SIGTERM) is before
    assert ended.value.code == app.INTERRUPTED == 130
    assert capsys.readouterr().err == "softaim: interrupted\n"
