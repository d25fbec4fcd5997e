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

from experiments import interrupts
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


@POSIX
def test_an_interrupt_of_a_callback_is_not_raised_again_after_the_end(monkeypatch):
    """Another exception ends the block before the interrupt is raised again."""
    callback = ctypes.CFUNCTYPE(None)(lambda: os.kill(os.getpid(), signal.SIGINT))
    monkeypatch.setattr(interrupts, "AGAIN_S", 0.3)
    with pytest.raises(ValueError, match="another"), as_interrupts():
        raise ValueError([callback(), "another"][1])
    time.sleep(0.5)


def test_a_fault_that_python_ignores_while_an_interrupt_is_handled_is_reported(monkeypatch):
    class Faulty:
        def __del__(self) -> None:
            raise OSError("a fault of its own")

    reported = []
    monkeypatch.setattr(sys, "unraisablehook", lambda fault: reported.append(str(fault.exc_value)))
    with as_interrupts():
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt:
            del [Faulty()][0]
            time.sleep(3.0 * interrupts.AGAIN_S)
    assert reported == ["a fault of its own"]


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
