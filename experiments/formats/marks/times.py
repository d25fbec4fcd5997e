"""Test whether times of frames can be in seconds. If not, guess their unit."""

from __future__ import annotations

import numpy as np

from experiments.arrays import Floats
from experiments.errors import InputError
from experiments.formats.tables import Table

SHORTEST_S, LONGEST_S = 1e-3, 5.0
"""Shortest and longest plausible frame interval [s]; choice: 1000 frames/s, and the filter's `forget_s`."""

USUAL_S = 1.0 / 30.0
"""Typical interval of a tracker's frames [s], from which the unit of times is guessed; choice."""

UNITS = {
    "nanoseconds": 1e-9,
    "microseconds": 1e-6,
    "milliseconds": 1e-3,
    "minutes": 60.0,
    "hours": 3600.0,
    "days": 86400.0,
}


def likely_unit(stated: float, expected_s: float, most: float = np.inf) -> str | None:
    """The unit with which the number `stated` is nearest to the time `expected_s`.

    None if this unit is seconds, or if `stated` in this unit still differs from `expected_s` by a factor above `most`.
    """
    off = {unit: abs(np.log(stated * seconds / expected_s)) for unit, seconds in {**UNITS, "seconds": 1.0}.items()}
    best = min(off, key=lambda unit: off[unit])
    return None if best == "seconds" or off[best] > np.log(most) else best


def check_seconds(table: Table, column: str) -> None:
    """Raise InputError if the median interval between the times in a column is not plausible in seconds."""
    times = table.numbers[column]
    intervals = np.diff(np.unique(times))
    if not len(intervals):
        return
    usual = float(np.median(intervals))
    if 0.99 * SHORTEST_S <= usual <= 1.01 * LONGEST_S:  # files and differences round times
        return
    later = table.place(int(np.argmax(times > times[0])), column)
    unit = likely_unit(usual, USUAL_S) or "another unit"
    expected = f"seconds, frames {SHORTEST_S:g} to {LONGEST_S:g} s apart"
    raise InputError.at(later, expected, f"{usual:.6g} in the median: it seems to be {unit}")


def check_within(table: Table, column: str, times_s: Floats) -> None:
    """Raise InputError if no time in a column is near the frames, which have the times `times_s` [s], (n_frames,)."""
    times = table.numbers[column]
    first_s, last_s = float(times_s[0]), float(times_s[-1])
    if not len(times) or (times.min() <= last_s + LONGEST_S and times.max() >= first_s - LONGEST_S):
        return
    found = f"none before {times.min():.6g}" if times.min() > last_s else f"none after {times.max():.6g}"
    inside = [unit for unit, seconds in UNITS.items() if first_s <= seconds * times.max() <= last_s]
    guess = f": it seems to be {inside[-1]}" if inside else ""
    raise InputError.at(
        table.place(0, column), f"seconds, as those of the frames, {first_s:.6g} to {last_s:.6g}", f"{found}{guess}"
    )
