"""Results of a run: estimates.csv and advice.csv, with all their columns."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from estimators import Status
from experiments.arrays import Floats
from experiments.errors import InputError
from experiments.formats.marks.rows import AXES, cov_names, cov_of
from experiments.formats.recording import SAME_TIME_S, nearest_frames
from experiments.formats.tables import Table, read_open

ESTIMATES, ADVICE = "estimates.csv", "advice.csv"
WORDS = ("status", "model_only", "advice", "reason")
FLAGS = {"True": True, "False": False}
TRUSTED = (Status.TRACKING, Status.COASTING)
"""Statuses of usable estimates. For estimates with another status, exports contain only the status."""
DIGITS, ROUNDED = 1e-8, 0.25
"""A row belongs to a frame if the difference of their times is at most DIGITS [1] times the row's time, and at most
ROUNDED [1] times the shortest frame interval. Older tables state times with only nine digits."""

Entry = float | str | bool | None


@dataclass(frozen=True, slots=True, eq=False)
class Results:
    """A table of results of a run.

    table: content of the file; columns: names of the file's columns, in order
    times_s: time at which each row's frame was exposed [s], (n,); for a row without a frame, the time in the file
    frames: index of each row's frame, (n,), -1 for a row without a frame
    """

    table: Table
    columns: list[str]
    times_s: Floats
    frames: NDArray[np.int64]

    def entries(self, row: int) -> dict[str, Entry]:
        """Values of a row by column; empty values are None."""
        found: dict[str, Entry] = {name: FLAGS.get(words[row], words[row]) for name, words in self.table.texts.items()}
        for name, values in self.table.numbers.items():
            found[name] = float(values[row]) if np.isfinite(values[row]) else None
        return {column: found[column] for column in self.columns}


@dataclass(frozen=True, slots=True, eq=False)
class Estimates(Results):
    """Rows of estimates.csv: means [m], (n_rows, dim), and covariances [m²], (n_rows, dim, dim); NaN if missing."""

    means: Floats
    covs: Floats

    @property
    def trusted(self) -> NDArray[np.bool_]:
        """Whether each row has a usable estimate, (n,)."""
        followed = np.isin(self.table.texts["status"], TRUSTED)
        return followed & np.isfinite(self.means).all(axis=1) & np.isfinite(self.covs).all(axis=(1, 2))


def read_estimates(folder: Path, dim: int, exposures_s: Floats) -> Estimates:
    """Estimates in a folder of results for frames with these exposure times [s], in a scene of dimension `dim`.

    Raises InputError, for example if no row belongs to a frame.
    """
    path = folder / ESTIMATES
    if not folder.is_dir():
        raise InputError.at(folder, f"a folder with {ESTIMATES}", "a file" if folder.exists() else "none")
    table, columns = read_open(path, ["time_s", "status", *AXES[:dim], *cov_names(dim)], WORDS)
    if dim == 2 and "z_mm" in table.numbers:
        raise InputError.at(f"{path}: row 1", "estimates of a flat scene, as the recording's is", "column z_mm")
    table.check("status", np.isin(table.texts["status"], list(Status)), f"one of {', '.join(Status)}")
    times_s, frames = _frames_of(table.numbers["time_s"], exposures_s)
    if not (frames >= 0).any():
        span = f"{exposures_s[0]:g} to {exposures_s[-1]:g} s"
        found = f"{times_s.min():g} to {times_s.max():g} s" if len(times_s) else "no rows"
        raise InputError.at(f"{path}: time_s", f"times of the recording's frames, {span}", found)
    covs = cov_of(np.stack([table.numbers[name] for name in cov_names(dim)], axis=1), dim)
    means = 1e-3 * np.stack([table.numbers[axis] for axis in AXES[:dim]], axis=1)
    return Estimates(table, columns, times_s, frames, means, covs)


def read_advice(folder: Path, exposures_s: Floats) -> Results | None:
    """The advice in a folder of results; None if the folder has no advice. Raises InputError."""
    path = folder / ADVICE
    if not path.exists():
        return None
    table, columns = read_open(path, ["time_s", "advice", "reason"], WORDS)
    return Results(table, columns, *_frames_of(table.numbers["time_s"], exposures_s))


def _frames_of(times_s: Floats, exposures_s: Floats) -> tuple[Floats, NDArray[np.int64]]:
    """The fields `times_s` and `frames` of `Results` for these times in a file."""
    frames, off_s = nearest_frames(times_s, exposures_s)
    shortest_s = np.diff(exposures_s).min(initial=np.inf)
    found = off_s <= SAME_TIME_S + np.minimum(DIGITS * np.abs(times_s), ROUNDED * shortest_s)
    return np.where(found, exposures_s[frames], times_s), np.where(found, frames, -1)
