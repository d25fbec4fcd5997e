"""Journal of a live loop, journal.csv: all its actions in order, for an exact replay."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from estimators import MarkMeasurement
from experiments.errors import InputError, shown

JOURNAL = "journal.csv"
HEADER = ("what", "time_s", "now_s", "values")


class Act(StrEnum):
    """Kinds of actions of the live loop."""

    BEGIN = "begin"
    """The journal begins; values: the source, and whether the run begins at this time."""
    PAUSE = "pause"
    """Pause or resume the use of frames; value: whether there is a pause now."""
    ORIGIN = "origin"
    """The source's time is zero at time_s on the clock."""
    FRAME = "frame"
    """A frame with exposure time time_s: the next picture of the recording; in space, the next picture of each camera
    that the values name."""
    MARKS = "marks"
    """Another tracker's frame with exposure time time_s; values: its marks, possibly none."""
    UNFIT = "unfit"
    """An unusable frame with exposure time time_s: of another size, or not later than the last frame."""
    COAST = "coast"
    """A prediction without a frame."""
    DATED = "dated"
    """A change of delays; values: the largest delay from exposure to arrival [s], whether frames come irregularly."""
    RESET = "reset"
    """Reset of the filter."""
    FIX = "fix"
    """A direct measurement of the target; values: position [m], then standard deviation [m]."""
    HUE = "hue"
    """A new colour of a mark; values: the mark's node, then the colour in the order of `MarkHue`."""
    NEEDLE = "needle"
    """A tracked needle; values: position of its tip [m], then its direction; no values if it is not visible."""


@dataclass(frozen=True, slots=True)
class Done:
    """An action of the loop. time_s: time that the action concerns [s]; now_s: clock time when the loop did it [s]."""

    act: Act
    time_s: float
    now_s: float
    values: tuple[Any, ...] = ()

    @property
    def row(self) -> tuple[str, ...]:
        """The action as a row of the journal: numbers in full precision, `values` as JSON."""
        return str(self.act), repr(self.time_s), repr(self.now_s), json.dumps(self.values, allow_nan=False)


def mark_values(marks: Sequence[MarkMeasurement]) -> tuple[Any, ...]:
    """The marks of a frame for the journal: each mark's node, position [m], covariance [m²] and shared errors [m]."""
    return tuple(
        [m.node, m.position.tolist(), m.cov.tolist(), None if m.shared is None else m.shared.tolist()] for m in marks
    )


def marks_of(values: Sequence[Any]) -> tuple[MarkMeasurement, ...]:
    """The marks in values made by `mark_values`. Raises ValueError or TypeError for invalid values."""
    return tuple(
        MarkMeasurement(node, np.array(position), np.array(cov), None if shared is None else np.array(shared))
        for node, position, cov, shared in values
    )


def read_journal(path: Path) -> Iterator[Done]:
    """The actions in a journal, in order; an incomplete last row is omitted. Raises InputError."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        found = "none" if isinstance(error, FileNotFoundError) else "one that cannot be read"
        raise InputError.at(path, "the journal of a live run", found) from None
    whole = text[: text.rfind("\n") + 1]
    rows = csv.reader(whole.splitlines())
    header = next(rows, [])
    if tuple(header) != HEADER:
        raise InputError.at(f"{path}: header", ",".join(HEADER), shown(",".join(header)))
    for number, row in enumerate(rows, start=2):
        try:
            what, time_s, now_s, values = row
            yield Done(Act(what), float(time_s), float(now_s), tuple(json.loads(values)))
        except ValueError:
            raise InputError.at(f"{path}: row {number}", ",".join(HEADER), shown(",".join(row))) from None
