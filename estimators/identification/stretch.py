"""Selection of the consecutive frames with the most motion, for a recording with more frames than the time allows."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from estimators.identification.budget import Budget, OutOfTimeError
from estimators.identification.filter_pass import Frames

LEAST_FRAMES = 10
"""Least number of frames for an estimation."""

PROBED = 3
"""Number of frames of a timed pass. A first pass, which is not timed, loads the compiled code."""

TIMED = 3
"""Number of timed passes. Only the fastest pass counts, because another program may delay the others; numerical."""


def from_first_marks(frames: Frames) -> Frames:
    """The frames, beginning with the first one that has marks."""
    return frames[next((k for k, (_, marks) in enumerate(frames) if marks), 0) :]


def liveliest(frames: Frames, n: int) -> Frames:
    """The n consecutive frames with the most motion: the largest sum of squared mark displacements between frames."""
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
    # the first frame must have marks, because a filter starts with them
    moving[[not marks for _, marks in frames[: len(moving)]]] = -1.0
    first = int(np.argmax(moving))
    return frames[first : first + n]


def frame_seconds(run: Callable[[Frames], object], frames: Frames, budget: Budget) -> float:
    """Computing time per frame [s], from the fastest of `TIMED` passes; 0 if the time is unlimited."""
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
    """All frames if the remaining time allows n_passes passes, otherwise as many as it allows, chosen by `liveliest`.

    frame_s: computing time of a pass, per frame [s]; reserved_s: time reserved for other work [s]
    Raises OutOfTimeError if the time is too short for `LEAST_FRAMES` frames.
    """
    if frame_s <= 0.0:
        return frames
    n = int((budget.seconds - budget.spent_s - reserved_s) / (n_passes * frame_s))
    if n < min(LEAST_FRAMES, len(frames)):
        raise OutOfTimeError
    return liveliest(frames, n)
