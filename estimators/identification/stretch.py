"""Which frames of a recording are used where the time does not do for all: the liveliest ones in a row."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from estimators.identification.budget import Budget, OutOfTimeError
from estimators.identification.filter_pass import Frames

LEAST_FRAMES = 10
"""Frames with fewer of which no constant or noise level is estimated."""

PROBED = 3
"""Frames through which a pass is timed, after as many in which compiled code is loaded."""

TIMED = 3
"""Passes that are timed; numerical: what else the machine or the interpreter does meanwhile takes longer than a few
frames, and a fit that counts it as theirs gives up though there is time."""


def from_first_marks(frames: Frames) -> Frames:
    """The frames from the first on that has marks."""
    return frames[next((k for k, (_, marks) in enumerate(frames) if marks), 0) :]


def liveliest(frames: Frames, n: int) -> Frames:
    """The n frames in a row in which the marks move the most, by the sum of their squared steps."""
    if n >= len(frames):
        return frames
    if n < 1:
        return frames[:0]
    steps = np.zeros(len(frames))
    last: dict[str, np.ndarray] = {}
    for k, (_, marks) in enumerate(frames):
        for mark in marks:
            if mark.node in last:
                steps[k] += float(((mark.position - last[mark.node]) ** 2).sum())
            last[mark.node] = mark.position
    total = np.concatenate([[0.0], np.cumsum(steps)])
    moving = total[n:] - total[:-n]
    # a filter starts from marks
    moving[[not marks for _, marks in frames[: len(moving)]]] = -1.0
    first = int(np.argmax(moving))
    return frames[first : first + n]


def frame_seconds(run: Callable[[Frames], object], frames: Frames, budget: Budget) -> float:
    """Time that a pass takes for each frame [s], by the quickest of a few; 0 where the time is unlimited."""
    if not np.isfinite(budget.seconds):
        return 0.0
    some = frames[:PROBED]
    run(some)
    taken = []
    for _ in range(TIMED):
        before_s = budget.spent_s
        run(some)
        taken.append(budget.spent_s - before_s)
    return min(taken) / len(some)


def affordable(frames: Frames, frame_s: float, n_passes: int, budget: Budget, *, reserved_s: float = 0.0) -> Frames:
    """The frames, or the liveliest in a row for which the time allows so many passes of frame_s [s] a frame.

    reserved_s: of the time, for something else. Raises OutOfTimeError where these are fewer than `LEAST_FRAMES`.
    """
    if frame_s <= 0.0:
        return frames
    n = int((budget.seconds - budget.spent_s - reserved_s) / (n_passes * frame_s))
    if n < min(LEAST_FRAMES, len(frames)):
        raise OutOfTimeError
    return liveliest(frames, n)
