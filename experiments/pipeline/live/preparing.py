"""Before a run: what frames would have to wait for is compiled or loaded, while they are shown as they come.

Compiling holds Python's lock for seconds at a time, and page and pictures would stand still: another process does that,
and leaves it in numba's cache on disk. Where all is there already, or that process fails, none is needed.
"""

from __future__ import annotations

import multiprocessing
import os
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from typing import TypeVar

from numba.core.event import Listener, install_listener

import vision
from experiments.log import LOG
from experiments.threads import begin_helper

PREPARING = "preparing: frames are shown and not used yet"

LOOK_S = 0.05
"""Between two looks at whether all is prepared [s]: so often it is shown that the run lives; chosen."""

NICENESS = 10
"""Of the process that compiles: camera and page go first; chosen."""

Made = TypeVar("Made")
Show = Callable[[vision.Frame | None, int], None]


class NotCompiledError(Exception):
    """A kernel that neither this process nor the cache on disk has for such arguments."""


class _Refusal(Listener):
    """Compiles nothing in the thread that made it."""

    def __init__(self) -> None:
        self._thread = threading.get_ident()

    def on_start(self, event: object) -> None:
        """Of compiling."""
        if threading.get_ident() == self._thread:
            raise NotCompiledError(str(event))

    def on_end(self, event: object) -> None:
        """Of compiling, which another thread did."""


def prepared(
    make: Callable[[], Made], rehearse: Callable[[], object], frames: vision.LiveFrames | None, show: Show
) -> tuple[Made, int]:
    """What is made, in a thread of its own, and how many frames were shown meanwhile.

    make: may be broken off and begun anew; rehearse: calls the same kernels, and can be pickled
    frames: of a source that goes on whether it is read or not; None: no frame is taken, as of a film, which begins when
    it is first asked for one. show: is given each frame and how many came so far; None where none came for LOOK_S.
    What make, show or the source raises is raised here.
    """
    made = _in_thread(partial(_from_cache, make))
    n_shown = _shown_until(made.done, frames, show, 0)
    if isinstance(made.exception(), NotCompiledError):
        n_shown = _compiled_elsewhere(rehearse, frames, show, n_shown)
        made = _in_thread(make)
        n_shown = _shown_until(made.done, frames, show, n_shown)
    return made.result(), n_shown


def _from_cache(make: Callable[[], Made]) -> Made:
    """What is made without compiling; else NotCompiledError."""
    with install_listener("numba:compile", _Refusal()):
        return make()


def _in_thread(make: Callable[[], Made]) -> Future[Made]:
    made: Future[Made] = Future()

    def work() -> None:
        try:
            made.set_result(make())
        except BaseException as error:
            made.set_exception(error)

    threading.Thread(target=work, name="softaim preparing", daemon=True).start()
    return made


def _shown_until(over: Callable[[], bool], frames: vision.LiveFrames | None, show: Show, n_shown: int) -> int:
    """Show what comes until that is over; how many frames were shown, with those n_shown before."""
    while not over():
        frame = None
        if frames is None or frames.ended:
            time.sleep(LOOK_S)
        else:
            frame = frames.next(LOOK_S)
        n_shown += frame is not None
        show(frame, n_shown)
    return n_shown


def _compiled_elsewhere(
    rehearse: Callable[[], object], frames: vision.LiveFrames | None, show: Show, n_shown: int
) -> int:
    """Have another process compile; where it cannot, this one will have to. How many frames were shown."""
    LOG.info("kernels are compiled, once on this machine for such a scene; it takes about a minute")
    process = multiprocessing.get_context("spawn").Process(
        target=_rehearse, args=(rehearse,), name="softaim compiling", daemon=True
    )
    process.start()
    try:
        n_shown = _shown_until(lambda: not process.is_alive(), frames, show, n_shown)
    finally:
        process.kill()
        process.join()
    if process.exitcode:
        LOG.warning("the process that compiles ended with %d: pictures stand still for a while", process.exitcode)
    return n_shown


def _rehearse(rehearse: Callable[[], object]) -> None:
    """Rehearse, in a process that helps another and ends with it."""
    begin_helper()
    if sys.platform != "win32":
        os.nice(NICENESS)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    try:
        rehearse()
    except Exception as error:
        sys.exit(f"compiling: {type(error).__name__}: {error}")


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
