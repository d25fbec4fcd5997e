"""Both methods on a recording, scored where the truth is known: what `softaim track` does."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

from estimators import MarkMeasurement, Status, TargetEstimate, coverage, normalised_error_squared
from estimators.process.target import target_map
from experiments.arrays import Floats
from experiments.errors import InputError
from experiments.formats.estimate_rows import header, row
from experiments.formats.recording import MarkRow, Recording
from experiments.pipeline.events import rest_offsets
from experiments.pipeline.line import FILTER, OPEN_LOOP, Line, Step

Advance = Callable[[float], None]


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """Estimates of the methods on a recording.

    steps: one for each frame
    truth: where the target was [m], (n_frames, dim), NaN where that is not known
    counts: marks rejected and covariances repaired by the filter; results of the check, if there was one
    """

    recording: Recording
    steps: tuple[Step, ...]
    truth: Floats
    counts: Mapping[str, float | int | None] = field(default_factory=dict)

    @property
    def times_s(self) -> Floats:
        """Exposure times of the frames [s], (n_frames,)."""
        return np.array([step.estimates[FILTER].time_s for step in self.steps])

    def estimates(self, method: str) -> list[TargetEstimate]:
        """The estimates of one method, one for each frame."""
        return [step.estimates[method] for step in self.steps]


def track(recording: Recording, advance: Advance = lambda _share: None, *, check: bool = False) -> Track:
    """Run both methods through every frame; `advance` gets the share done. Raises InputError, SourceError.

    check: predict each mark as if it were hidden, too.
    """
    if check and len(recording.scene.measured_nodes) < 2:
        raise InputError.at("--check", "two or more measured marks", str(len(recording.scene.measured_nodes)))
    line = Line(recording.scene, fixes=recording.fixes, check=check)
    n_frames = len(recording.exposures_s)
    steps = []
    checked: list[float] = []
    for k, step in enumerate(each_step(line, recording)):
        steps.append(step)
        if line.checks is not None:
            checked += [one.nees for one in line.checks.checks.values()]
        advance((k + 1) / n_frames)
    counts: dict[str, float | int | None] = {
        "marks_refused": sum(n for node, n in line.filter.rejected.items() if node != "fix"),
        "repairs": sum(line.filter.repairs.values()),
        "swaps_undone": len(line.identity.swaps),
        "rest_offset_mm": 1e3 * float(rest_offsets(recording.scene).max()),
    }
    if line.checks is not None:
        counts["check_nees"] = float(np.mean(checked)) if checked else None
        counts["check_scale"] = line.checks.scale
    return Track(recording, tuple(steps), target_truth(recording, steps), counts)


def each_step(line: Line, recording: Recording) -> Iterator[Step]:
    """Estimates of each frame of a recording, from its frames or from the marks that stand in their place."""
    if recording.marks is not None:
        for exposure_s, marks in zip(recording.exposures_s, recording.marks, strict=True):
            yield line.take(float(exposure_s), [measurement(mark) for mark in marks])
        return
    with recording.open_frames() as frames:
        for frame in frames:
            yield line.see(frame.exposure_s, frame.image)


def measurement(mark: MarkRow) -> MarkMeasurement:
    """A row of marks.csv as the filter takes it."""
    return MarkMeasurement(mark.node, mark.position_m, mark.sd_m**2 * np.eye(len(mark.position_m)))


def target_truth(recording: Recording, steps: list[Step]) -> Floats:
    """Where the target was at each frame [m], (n_frames, dim), NaN where it is unknown.

    Its node from truth.csv, without it from its own mark, where that is seen for scoring only; from there to the target
    by the map that makes all estimates.
    """
    scene = recording.scene
    node = scene.target.node
    known = np.full((len(steps), scene.network.dim), np.nan)
    if recording.truth is not None and node in recording.truth.nodes:
        inside, positions = recording.truth.at(recording.exposures_s, node)
        known[inside] = positions[inside]
    elif node not in scene.measured_nodes:
        for k, step in enumerate(steps):
            for mark in step.marks:
                if mark.node == node:
                    known[k] = mark.position
    return known + target_map(scene.network, scene.target.point).constant


def table(done: Track, method: str) -> pd.DataFrame:
    """The estimates of one method as estimates.csv has them, with err_mm and nees where the truth is known."""
    estimates = done.estimates(method)
    rows = pd.DataFrame([row(e) for e in estimates], columns=header(done.recording.scene.network.dim))
    errors = np.array([e.mean for e in estimates]) - done.truth
    rows["err_mm"] = 1e3 * np.linalg.norm(errors, axis=1)
    rows["nees"] = _nees(errors, estimates)
    numbers = [column for column in rows.columns if column not in ("status", "marks_used", "model_only")]
    return rows.astype(dict.fromkeys(numbers, float))


def _nees(errors: Floats, estimates: list[TargetEstimate]) -> Floats:
    """NEES of each frame, (n_frames,): NaN where error or covariance is not known, inf where the latter is singular."""
    nees = np.full(len(errors), np.nan)
    covs = {k: e.cov for k, e in enumerate(estimates) if e.cov is not None and np.isfinite(errors[k]).all()}
    if covs:
        known = list(covs)
        try:
            nees[known] = normalised_error_squared(errors[known], np.array(list(covs.values())))
        except np.linalg.LinAlgError:  # no batch can be solved of which one is singular
            nees[known] = [_nees_or_infinite(errors[k], cov) for k, cov in covs.items()]
    return nees


def _nees_or_infinite(error: Floats, cov: Floats) -> float:
    try:
        return float(normalised_error_squared(error[None], cov[None])[0])
    except np.linalg.LinAlgError:
        return float("inf")


def figures(done: Track, method: str) -> dict[str, float | int | None]:
    """The row of summary.json for one method; None where truth or covariance is missing, or the number not finite."""
    rows = table(done, method)
    errors = rows["err_mm"].dropna().to_numpy()
    nees = rows["nees"].dropna().to_numpy()
    dim = done.recording.scene.network.dim
    seconds = [step.detect_s + step.method_s[method] for step in done.steps]
    return {
        "mae_mm": _finite(errors.mean()) if len(errors) else None,
        "sd_mm": _finite(errors.std()) if np.isfinite(errors).all() and len(errors) else None,
        "rmse_mm": _finite(np.sqrt((errors**2).mean())) if len(errors) else None,
        "coverage95": coverage(nees, dim) if len(nees) else None,
        "mean_nees": _finite(nees.mean()) if len(nees) else None,
        "frames": len(rows),
        "frames_lost": int(rows["status"].isin([Status.COASTING, Status.LOST]).sum()),
        "ms_per_frame": float(1e3 * np.median(seconds)),
    }


def _finite(number: float) -> float | None:
    """The number as JSON can have it: None where it is not finite."""
    return float(number) if np.isfinite(number) else None


def summary(done: Track) -> dict[str, dict[str, float | int | None]]:
    """What summary.json holds: figures by method."""
    return {OPEN_LOOP: figures(done, OPEN_LOOP), FILTER: figures(done, FILTER) | dict(done.counts)}


def write_tables(done: Track, folder: Path) -> None:
    """Write the tables and figures of a track to a folder that exists."""
    for method, name in ((FILTER, "estimates.csv"), (OPEN_LOOP, f"estimates.{OPEN_LOOP}.csv")):
        table(done, method).to_csv(folder / name, index=False, float_format="%.9g")
    (folder / "summary.json").write_text(json.dumps(summary(done), indent=2) + "\n", encoding="utf-8")
