"""All that a live loop did, in order, so that it can be done again: journal.csv, and how it is done again."""

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
    """What the loop does."""

    BEGIN = "begin"
    """Writing begins; values: the source, and whether the run begins, too."""
    PAUSE = "pause"
    """Frames are no longer used, or used again: the value."""
    ORIGIN = "origin"
    """From now on times are told from time_s on."""
    FRAME = "frame"
    """A frame comes that was exposed at time_s: the next picture of the recording."""
    MARKS = "marks"
    """Another tracker's frame comes that was exposed at time_s; values: its marks, of which there may be none."""
    UNFIT = "unfit"
    """A frame that cannot be used comes, exposed at time_s: of another size, or no later than the one before."""
    COAST = "coast"
    """No frame comes."""
    DATED = "dated"
    """Frames may come later than their times say by the first value [s]; they come unevenly or not: the second."""
    RESET = "reset"
    """The state is forgotten."""
    FIX = "fix"
    """The target is seen at the place of the values [m], whose last one is a standard deviation [m]."""
    HUE = "hue"
    """The mark of the first value gets the colour of the others, in the order of `MarkHue`."""
    NEEDLE = "needle"
    """The tip of a needle is seen at the place of the values [m], then its direction; without values it is not seen."""


@dataclass(frozen=True, slots=True)
class Done:
    """One thing that the loop did: of which time [s], when by the clock [s], and what else it takes to do it again."""

    act: Act
    time_s: float
    now_s: float
    values: tuple[Any, ...] = ()

    @property
    def row(self) -> tuple[str, ...]:
        """As a journal has it: numbers are read bit for bit, values are such as JSON has."""
        return str(self.act), repr(self.time_s), repr(self.now_s), json.dumps(self.values, allow_nan=False)


def mark_values(marks: Sequence[MarkMeasurement]) -> tuple[Any, ...]:
    """Marks as the values of a frame: node, position [m], covariance [m²] and shared errors [m] of each."""
    return tuple(
        [m.node, m.position.tolist(), m.cov.tolist(), None if m.shared is None else m.shared.tolist()] for m in marks
    )


def marks_of(values: Sequence[Any]) -> tuple[MarkMeasurement, ...]:
    """The marks of such values. ValueError or TypeError where they are none."""
    return tuple(
        MarkMeasurement(node, np.array(position), np.array(cov), None if shared is None else np.array(shared))
        for node, position, cov, shared in values
    )


def read_journal(path: Path) -> Iterator[Done]:
    """What a journal holds, in order; a last row without an end is left out. Raises InputError."""
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
