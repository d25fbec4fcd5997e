"""Content of an export: a recording, the estimates and advice of a run, and the date of the recording's time 0."""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from experiments.errors import InputError, shown
from experiments.formats.exchange.results import Estimates, Results, read_advice, read_estimates
from experiments.formats.provenance import check_made_from
from experiments.formats.recording import Recording

LATEST_S = 2**31
"""Limit of times since 1970 [s]: ROS 2 stores seconds in 31 bits."""


@dataclass(frozen=True, slots=True, eq=False)
class Exported:
    """Content of an export.

    estimates, advice: results, if given; start_ns: time from the start of 1970 (UTC) to the recording's time 0 [ns]
    """

    recording: Recording
    estimates: Estimates | None
    advice: Results | None
    start_ns: int = 0

    def time_ns(self, time_s: float) -> int:
        """A time of the recording [s] as time since 1970 UTC [ns]."""
        return self.start_ns + round(1e9 * time_s)


def exported(recording: Recording, folder: Path | None, start: str | None) -> Exported:
    """A recording, and its results from a folder. Raises InputError, also if the results are of another recording.

    start: date and time of the first exposure in ISO 8601; without it, the recording's time 0 is the start of 1970
    """
    exposures_s, dim = recording.exposures_s, recording.scene.network.dim
    if folder is not None:
        check_made_from(folder, recording.folder)
    chosen = Exported(
        recording,
        None if folder is None else read_estimates(folder, dim, exposures_s),
        None if folder is None else read_advice(folder, exposures_s),
    )
    if start is not None:
        chosen = replace(chosen, start_ns=_start_ns(start) - round(1e9 * float(exposures_s[0])))
    times = [exposures_s, *(one.times_s for one in (chosen.estimates, chosen.advice) if one is not None)]
    times.append(np.array([fix.time_s for fix in recording.fixes]))
    first_s, last_s = (edge(np.concatenate(times)) + 1e-9 * chosen.start_ns for edge in (np.min, np.max))
    if first_s < 0 or last_s >= LATEST_S:
        raise InputError.at("--start", "frames from 1970 to 2038", f"{first_s:.9g} to {last_s:.9g} s from 1970")
    return chosen


def _start_ns(start: str) -> int:
    try:
        found = datetime.fromisoformat(start)
    except ValueError:
        found = None
    if found is None or found.tzinfo is None:
        raise InputError.at("--start", "a time with its zone, such as 2026-01-31T09:00:00Z", shown(start))
    return (found - datetime(1970, 1, 1, tzinfo=UTC)) // timedelta(microseconds=1) * 1000
