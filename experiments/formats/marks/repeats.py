"""Detection of repeated frames of marks: a frozen tracker may send the same marks with new times."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from experiments.arrays import Floats
from experiments.formats.marks.rows import MarkRow
from vision import FrozenValues, SourceEvent


def values_of(marks: Iterable[MarkRow]) -> dict[str, tuple[float, ...]]:
    """Positions of a frame's marks by node [m], for a comparison with other frames."""
    return {mark.node: tuple(mark.position_m.tolist()) for mark in marks}


def without_repeats(
    times_s: Floats, marks: Sequence[Sequence[MarkRow]]
) -> tuple[tuple[tuple[MarkRow, ...], ...], tuple[SourceEvent, ...]]:
    """The marks of each frame, and the events FROZEN and RESUMED. Frames with repeated values get no marks."""
    watch, used, events = FrozenValues(), [], []
    for time_s, found in zip(times_s.tolist(), marks, strict=True):
        repeats, noticed = watch.saw(time_s, values_of(found))
        used.append(() if repeats else tuple(found))
        events += noticed
    return tuple(used), tuple(events)
