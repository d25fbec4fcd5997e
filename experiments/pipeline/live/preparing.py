"""Preparation of a run: code is compiled or loaded while frames are shown but not yet used.

Compilation holds Python's global lock for seconds, which would freeze the page. Therefore another process compiles into
numba's disk cache, unless everything is cached already.
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
from experiments.threads import begin_helper, start_helper

PREPARING = "preparing: frames are shown but not used yet"

LOOK_S = 0.05
"""Interval at which a state is shown and the end of the preparation is checked [s]; choice."""

NICENESS = 10
"""Nice value of the compiling process, whose priority is thus below that of the camera and the page; choice."""

Made = TypeVar("Made")
Cameras = vision.LiveFrames | vision.SeveralFrames
"""Sources with their own threads, one camera or several."""

Show = Callable[[vision.Frame | vision.Exposure | None, int], None]


class NotCompiledError(Exception):
    """Error for a kernel that has no compiled code for its types of arguments, in this process or in the disk cache."""


class _Refusal(Listener):
    """Listener to numba that forbids compilation in the thread that created it."""

    def __init__(self) -> None:
        self._thread = threading.get_ident()

    def on_start(self, event: object) -> None:
        """Raise NotCompiledError if the thread that created this listener is about to compile."""
        if threading.get_ident() == self._thread:
            raise NotCompiledError(str(event))

    def on_end(self, event: object) -> None:
        """Do nothing when a compilation ends."""


def prepared(
    make: Callable[[], Made], rehearse: Callable[[], object], frames: Cameras | None, show: Show
) -> tuple[Made, int]:
    """Run `make` in a thread, and show frames until it ends; returns its result and the number of frames shown.

    make: function that may be interrupted and called again
    rehearse: picklable function that calls the same kernels as `make`; another process runs it to compile them
    frames: frames of a camera; None if no frame may be read yet, for example because reading would start a film
    show: called with a frame, or None if no frame came for LOOK_S, and with the number of frames shown so far
    Raises exceptions of make, show or the source.
    """
    made = _in_thread(partial(_from_cache, make))
    n_shown = _shown_until(made.done, frames, show, 0)
    if isinstance(made.exception(), NotCompiledError):
        n_shown = _compiled_elsewhere(rehearse, frames, show, n_shown)
        made = _in_thread(make)
        n_shown = _shown_until(made.done, frames, show, n_shown)
    return made.result(), n_shown


def _from_cache(make: Callable[[], Made]) -> Made:
    """The result of `make`; raises NotCompiledError if `make` would have to compile code."""
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


def _shown_until(over: Callable[[], bool], frames: Cameras | None, show: Show, n_shown: int) -> int:
    """Show frames until `over` is true; n_shown: number of frames already shown; returns the new number."""
    while not over():
        frame = None
        if frames is None or frames.ended:
            time.sleep(LOOK_S)
        else:
            frame = frames.next(LOOK_S)
        n_shown += frame is not None
        show(frame, n_shown)
    return n_shown


def _compiled_elsewhere(rehearse: Callable[[], object], frames: Cameras | None, show: Show, n_shown: int) -> int:
    """Compile the kernels of `rehearse` in another process, and show frames; returns the number of frames shown."""
    LOG.info("compiling kernels, once on this machine for such a scene; it takes about a minute")
    process = multiprocessing.get_context("spawn").Process(
        target=_rehearse, args=(rehearse,), name="softaim compiling", daemon=True
    )
    start_helper(process)
    try:
        n_shown = _shown_until(lambda: not process.is_alive(), frames, show, n_shown)
    finally:
        process.kill()
        process.join()
    if process.exitcode:
        LOG.warning("compiling ended with exit code %d, so pictures will freeze for a while", process.exitcode)
    return n_shown


def _rehearse(rehearse: Callable[[], object]) -> None:
    """Call `rehearse` in a helper process, which ends if its parent ends."""
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
