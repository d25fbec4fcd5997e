"""Detection of frames of marks that repeat an earlier frame, because the tracker is frozen while its times advance."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from experiments.arrays import Floats
from experiments.formats.marks.rows import MarkRow
from vision import FrozenValues, SourceEvent


def values_of(marks: Iterable[MarkRow]) -> dict[str, tuple[float, ...]]:
    """Positions of a frame's marks by node [m], which are never equal in two frames by chance."""
    return {mark.node: tuple(mark.position_m.tolist()) for mark in marks}


def without_repeats(
    times_s: Floats, marks: Sequence[Sequence[MarkRow]]
) -> tuple[tuple[tuple[MarkRow, ...], ...], tuple[SourceEvent, ...]]:
    """The marks of each frame, none for frames with repeated values, and the events FROZEN and RESUMED."""
    watch, used, events = FrozenValues(), [], []
    for time_s, found in zip(times_s.tolist(), marks, strict=True):
        repeats, noticed = watch.saw(time_s, values_of(found))
        used.append(() if repeats else tuple(found))
        events += noticed
    return tuple(used), tuple(events)
