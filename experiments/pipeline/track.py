"""Tracking of a recording by filter and open loop, with scores if the truth is known: what `softaim track` does."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from estimators import LeaveOneOutCheck, MarkMeasurement, Status, TargetEstimate, coverage, normalised_error_squared
from estimators.core.track import FIX
from estimators.process.target import target_map
from experiments.arrays import Floats
from experiments.errors import InputError
from experiments.formats.estimate_rows import header, row
from experiments.formats.films.several import exposures_of
from experiments.formats.marks.rows import MarkRow, without_repeats
from experiments.formats.outputs import table_text
from experiments.formats.recording import Recording
from experiments.pipeline.events import rest_offsets
from experiments.pipeline.frame_sources import check_size
from experiments.pipeline.integrity import error_budget, target_variances, variance_shares
from experiments.pipeline.line import FILTER, OPEN_LOOP, AnyFrame, Line, Step, Watcher
from experiments.pipeline.scores.fit import (
    TruthScore,
    Withheld,
    fit_of,
    frames_by_status,
    sigmas_m,
    verdict,
    withheld_of,
)
from experiments.pipeline.scores.marks import MarkShares, MarkTally, marks_verdict
from experiments.plain import plain
from experiments.threads import ahead

if TYPE_CHECKING:
    import pandas as pd

Advance = Callable[[float], None]


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """Estimates of all methods for a recording.

    steps: a step for each frame
    truth: true position of the target [m], (n_frames, dim), NaN where unknown
    truth_cov: covariance of the error of `truth` [m²], (n_frames, dim, dim); zero if `truth` is not from a mark
    counts: further figures for summary.json, such as the numbers of rejected marks and repaired covariances
    withheld: by node, how well a filter without the node's mark predicts this mark; empty without `check`
    variance_shares: share of each source of error in the target's variance at the last frame, the largest first
    one_error: whether most of the target's variance is the constant error of its position in the tissue
    marks: by node, shares of frames in which its mark was used, rejected or not found, with the most frequent reason
    """

    recording: Recording
    steps: tuple[Step, ...]
    truth: Floats
    truth_cov: Floats
    counts: Mapping[str, float | int | None] = field(default_factory=dict)
    withheld: Mapping[str, Withheld] = field(default_factory=dict)
    marks: Mapping[str, MarkShares] = field(default_factory=dict)
    variance_shares: Mapping[str, float] = field(default_factory=dict)
    one_error: bool = False

    @property
    def has_truth(self) -> bool:
        """Whether any frame has a known truth."""
        return bool(np.isfinite(self.truth).all(axis=1).any())

    @property
    def times_s(self) -> Floats:
        """Exposure times of the frames [s], (n_frames,)."""
        return np.array([step.estimates[FILTER].time_s for step in self.steps])

    def estimates(self, method: str) -> list[TargetEstimate]:
        """The estimates of one method, one for each frame."""
        return [step.estimates[method] for step in self.steps]


def track(
    recording: Recording,
    advance: Advance = lambda _share: None,
    *,
    check: bool = False,
    watch: Watcher | None = None,
) -> Track:
    """Run the filter and the open loop through every frame; advance: called with the share of processed frames.

    check: whether each mark is also predicted by a filter that does not use it; watch: called with frame and `Step`
    Raises InputError, SourceError.
    """
    if check and len(recording.scene.measured_nodes) < 2:
        raise InputError.at("--check", "two or more measured marks", str(len(recording.scene.measured_nodes)))
    explain = watch is not None or recording.marks is None
    line = Line(recording.scene, fixes=recording.fixes, check=check, explain=explain)
    steps: list[Step] = []
    checked: dict[str, list[LeaveOneOutCheck]] = {}
    sigma_factors: list[float] = []
    tally = MarkTally(recording.scene)
    for frame, step in each_frame(line, recording):
        tally.take(step)
        if watch is not None:
            watch.take(frame, line, step)
        steps.append(replace(step, sight=None))
        if line.checks is not None:
            sigma_factors.append(line.checks.scale**0.5)
            for node, one in line.checks.checks.items():
                checked.setdefault(node, []).append(one)
        advance(len(steps) / len(recording.exposures_s))
    counts: dict[str, float | int | None] = {
        "marks_refused": sum(n for node, n in line.filter.rejected.items() if node != FIX),
        "fixes_refused": line.filter.rejected[FIX],
        "repairs": sum(line.filter.repairs.values()),
        "swaps_undone": len(line.identity.swaps),
        "frames_frozen": frames_frozen(recording),
        "rest_offset_mm": 1e3 * float(rest_offsets(recording.scene).max()),
    }
    if line.checks is not None:
        nees = [one.nees for own in checked.values() for one in own]
        counts["check_nees"] = float(np.mean(nees)) if nees else None
        counts["check_scale"] = float(np.mean(sigma_factors)) ** 2
    withheld = {node: withheld_of(checked[node]) for node in recording.scene.measured_nodes if node in checked}
    budget = error_budget(recording.scene, line.filter)
    last = next((step.estimates[FILTER] for step in reversed(steps)), None)
    shares = {} if last is None else variance_shares(budget, last)
    placed = False
    if last is not None and last.cov is not None and shares:
        variance = sum(target_variances(budget, last).values()) / len(last.mean)
        counts["sigma_advice_mm"] = 1e3 * math.sqrt(variance)
        placed = bool(np.trace(line.filter.offset_cov) > 0.5 * np.trace(last.cov))
    return Track(
        recording, tuple(steps), *target_truth(recording, steps), counts, withheld, tally.shares(), shares, placed
    )


def each_frame(line: Line, recording: Recording) -> Iterator[tuple[AnyFrame, Step]]:
    """Each frame of a recording, with its `Step`."""
    if recording.marks is not None:
        for exposure_s, marks in marks_to_use(recording):
            yield None, line.take(exposure_s, marks)
        return
    if recording.films:
        with ahead(exposures_of(recording.films)) as exposures:
            for exposure in exposures:
                check_size(exposure, recording.scene)
                yield exposure, line.see_all(exposure)
        return
    with recording.open_frames() as film, ahead(film) as frames:
        for frame in frames:
            yield frame, line.see(frame.exposure_s, frame.image)


def marks_to_use(recording: Recording) -> Iterator[tuple[float, tuple[MarkMeasurement, ...]]]:
    """Time [s] and marks of each frame in marks.csv; a frame that repeats earlier values has no marks."""
    used, _ = without_repeats(recording.exposures_s, recording.marks or ())
    for exposure_s, marks in zip(recording.exposures_s.tolist(), used, strict=True):
        yield exposure_s, tuple(measurement(mark) for mark in marks)


def frames_frozen(recording: Recording) -> int:
    """Number of frames whose marks are omitted because they repeat earlier values."""
    if recording.marks is None:
        return 0
    used, _ = without_repeats(recording.exposures_s, recording.marks)
    return sum(bool(given) and not left for given, left in zip(recording.marks, used, strict=True))


def measurement(mark: MarkRow) -> MarkMeasurement:
    """A row of marks.csv as a measurement."""
    return MarkMeasurement(mark.node, mark.position_m, mark.cov)


def target_truth(recording: Recording, steps: list[Step]) -> tuple[Floats, Floats]:
    """True position of the target in each frame [m], (n_frames, dim), and the covariance of the error of this position.

    The position of the target's node comes from truth.csv or from a mark on this node that the filter does not use. It
    is NaN if unknown. The scene's offset from the node to the target is added.
    """
    scene = recording.scene
    node = scene.target.node
    known, covs = np.full((len(steps), scene.network.dim), np.nan), np.zeros((len(steps), *2 * [scene.network.dim]))
    if recording.truth is not None and node in recording.truth.nodes:
        inside, positions = recording.truth.at(recording.exposures_s, node)
        known[inside] = positions[inside]
    elif node not in scene.measured_nodes:
        for k, step in enumerate(steps):
            for mark in step.marks:
                if mark.node == node:
                    known[k], covs[k] = mark.position, mark.total_cov
    return known + target_map(scene.network, scene.target.point).constant, covs


def table(done: Track, method: str) -> pd.DataFrame:
    """The estimates of one method for estimates.csv, with err_mm and nees if the truth is known."""
    import pandas as pd  # imported here, because a live run does not need it and must start at once

    estimates = done.estimates(method)
    rows = pd.DataFrame([row(e) for e in estimates], columns=header(done.recording.scene.network.dim))
    errors = np.array([e.mean for e in estimates]) - done.truth
    rows["err_mm"] = 1e3 * np.linalg.norm(errors, axis=1)
    rows["nees"] = [_nees(one, cov, e.cov) for one, cov, e in zip(errors, done.truth_cov, estimates, strict=True)]
    numbers = [column for column in rows.columns if column not in ("status", "marks_used", "model_only")]
    return rows.astype(dict.fromkeys(numbers, float))


def _nees(error: Floats, truth_cov: Floats, cov: Floats | None) -> float:
    """NEES of a frame: NaN if error or covariance is unknown, inf if the covariance is not positive definite."""
    if cov is None or not np.isfinite(error).all():
        return float("nan")
    try:
        return float(normalised_error_squared(error[None], (cov + truth_cov)[None])[0])
    except np.linalg.LinAlgError:
        return float("inf")


def figures(done: Track, method: str) -> dict[str, float | int | None]:
    """The figures of summary.json for one method; a figure that is not finite is None.

    Figures that need truth are present if any frame has truth. Figures that need a covariance or innovations are
    present if the method has a covariance or innovations.
    """
    rows, estimates = table(done, method), done.estimates(method)
    seconds = [step.detect_s + step.method_s[method] for step in done.steps]
    found: dict[str, float | int | None] = {}
    if done.has_truth:
        errors = rows["err_mm"].dropna().to_numpy()
        found |= dict.fromkeys(("mae_mm", "sd_mm", "rmse_mm"))
        if len(errors) and np.isfinite(errors).all():
            found |= plain({"mae_mm": float(errors.mean()), "sd_mm": float(errors.std())})
            found["rmse_mm"] = plain(float(np.sqrt((errors**2).mean())))
        nees = rows["nees"].dropna().to_numpy()
        if len(nees):
            found["coverage95"] = coverage(nees, done.recording.scene.network.dim)
            found["mean_nees"] = plain(float(nees.mean()))
    sigmas_mm = 1e3 * np.array(sigmas_m(estimates))
    if len(sigmas_mm):
        found |= {"sigma_mm": float(sigmas_mm.mean()), "sigma_most_mm": float(sigmas_mm.max())}
    fit = fit_of(estimates)
    if fit is not None:
        found |= {"mean_nis": fit.mean_nis, "nis_low": fit.low, "nis_high": fit.high, "mark_noise": fit.noise}
    return found | {
        "frames": len(rows),
        "frames_lost": int(rows["status"].isin([Status.COASTING, Status.LOST]).sum()),
        "ms_per_frame": float(1e3 * np.median(seconds)),
    }


def summary(done: Track) -> dict[str, dict[str, Any]]:
    """The content of summary.json: figures by method; for the filter also the verdicts of tests that need no truth."""
    ours: dict[str, Any] = figures(done, FILTER) | dict(done.counts)
    ours["frames_by_status"] = frames_by_status(done.estimates(FILTER))
    ours["verdict"] = verdict_of(done)
    ours["variance_shares"] = dict(done.variance_shares)
    if done.marks:
        ours["marks"] = {node: asdict(one) for node, one in done.marks.items()}
        misread = done.recording.aside is not None
        ours["marks_verdict"] = marks_verdict(done.recording.scene, done.marks, misread=misread)
    if done.withheld:
        ours["check_marks"] = {node: asdict(one) for node, one in done.withheld.items()}
    return {OPEN_LOOP: dict(figures(done, OPEN_LOOP)), FILTER: ours}


def verdict_of(done: Track) -> str:
    """The verdict on the filter in words: tests by innovations and by the truth, and numbers of frames by status."""
    estimates, found = done.estimates(FILTER), figures(done, FILTER)
    refused = int(done.counts.get("marks_refused") or 0)
    frozen, pictures = int(done.counts.get("frames_frozen") or 0), done.recording.marks is None
    covered, nees = found.get("coverage95"), found.get("mean_nees")
    truth = None
    if covered is not None and nees is not None:
        truth = TruthScore(covered, nees, done.recording.scene.network.dim, done.one_error)
    by_status = frames_by_status(estimates)
    checked = bool(done.withheld)
    said = verdict(
        fit_of(estimates), by_status, refused, frozen=frozen, pictures=pictures, checked=checked, truth=truth
    )
    return said if done.recording.aside is None else f"{done.recording.aside}; {said}"


def write_tables(done: Track, folder: Path) -> None:
    """Write the tables and figures of a track to an existing folder."""
    write_estimates(done, folder, {FILTER: "estimates.csv", OPEN_LOOP: f"estimates.{OPEN_LOOP}.csv"}, summary(done))


def write_estimates(done: Track, folder: Path, names: Mapping[str, str], found: Mapping[str, Any]) -> None:
    """Write a table of each method's estimates, and summary.json, to an existing folder; names: file name by method."""
    for method, name in names.items():
        (folder / name).write_text(table_text(table(done, method)), encoding="utf-8")
    (folder / "summary.json").write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
