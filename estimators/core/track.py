"""Filter that estimates a hidden target in a tissue from marks on the tissue."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dynamics.threads import one_blas_thread
from estimators.arrays import Floats
from estimators.core.ahead import AheadTables
from estimators.core.marks import Places
from estimators.core.posterior import TissuePosterior
from estimators.filters.unscented import CovarianceError
from estimators.process.known_force import ForceHistory, KnownForce
from estimators.tissue.estimate import (
    CommonShift,
    GaussianMixture,
    MarkMeasurement,
    Status,
    TargetEstimate,
    checked_measurement,
)
from estimators.tissue.gate import Outlying, confirmed
from estimators.tissue.health import Health, after_frame
from estimators.tissue.snapshot import all_or_nothing

REFUTED_S = 0.5
"""The filter restarts if all marks are outliers for the time `REFUTED_S / number of marks` [s]; choice."""

MIX_S, PUSHED_S = 0.05, 1.0 / 120.0
"""Longest step of a prediction beyond the filter's time, and longest step under a known force [s]; numerical."""

UNMEASURED = 0.5
"""A coordinate of a mark is not measured if its standard deviation exceeds this share of the body's extent; choice."""

FIX = "fix"
"""Name of a direct measurement of the target."""

STATE = ["health", "rejected", "repairs", "log_likelihood", "residual_m"]
STATE += ["_refuted_s", "_far_fix", "_seen_s", "_updated_s", "_placed"]
"""Attributes of `TissueFilter` that a snapshot copies, in addition to the hypotheses and the open-loop covariance."""


@dataclass(frozen=True, slots=True, eq=False)
class FilterSnapshot:
    """Complete state of a `TissueFilter` at one time.

    own: values of the attributes that the list `STATE` names
    filter: state of the `HypothesisFilter`; None stands for its prior
    open_loop_cov: covariance of the open-loop estimate, (n, n)
    """

    time_s: float | None
    own: Mapping[str, Any]
    filter: Mapping[str, Any] | None
    open_loop_cov: Floats

    def without_marks(self) -> FilterSnapshot:
        """Copy of the snapshot in which the hypotheses are the prior, and the health is that of a new filter."""
        fresh = {"health": Health(), "_refuted_s": -np.inf, "_far_fix": None, "_placed": None}
        return replace(self, own={**self.own, **fresh}, filter=None)


class TissueFilter(TissuePosterior):
    """Filter that estimates a hidden target from marks on the tissue.

    Parameters
    ----------
    network : MassSpringNetwork
    target : str or TargetPoint
        Name of a node, or a point of the tissue. Only a `TargetPoint` can have an offset from the nodes.
    marked : sequence of str
        Nodes whose marks are measured. A mark of another node raises ValueError.
    settings : FilterSettings, optional
    uncertainty : ParameterUncertainty, optional
        Uncertainty of the constants. It increases covariances; constants are not estimated. Default: exact constants.
    n_calibration : int
        Number of constant calibration errors, one for each column of `MarkMeasurement.shared`. If it is 0, the
        shared errors of different frames are independent.
    disturbances, discrepancy
        Priors of the unknown forces and of the model's error. Default: priors made from `settings`.
    """

    def _restart(self, repair: str, *, as_drawn: bool = False, marks: Sequence[MarkMeasurement] = ()) -> None:
        """Restart with the last or, if `as_drawn`, the drawn coordinates. Unless DIVERGED, keep the offset's estimate.

        marks: marks to which a body without anchors is registered when it restarts at `network.positions`
        """
        own = np.arange(self.process.n)[self.process.parts.get("offset", slice(0, 0))]
        mean, cov = self.filter.moments(np.eye(self.process.n)[own])
        self.begin()
        if self._placed is not None and not as_drawn:
            self.filter.means[:, self.process.parts["position"]] = self._placed
        elif not self.network.fixed.any() and self.network.continuum is None:
            self.filter.means[:, self.process.parts["position"]] = self.registered(marks)
        if self.health.status is not Status.DIVERGED:
            self.filter.means[:, own], self.filter.covs[:, own[:, None], own] = mean, cov
        self._refuted_s = -np.inf
        self.repairs[repair] += 1

    def snapshot(self) -> FilterSnapshot:
        """The complete present state, for `restore`."""
        own = {key: copy(getattr(self, key)) for key in STATE}
        return FilterSnapshot(self.time_s, own, self.filter.state(), self.open_loop.cov)

    def restore(self, then: FilterSnapshot) -> None:
        """Reset the state to a snapshot. Raises ValueError for a snapshot of a filter with other states."""
        expected = found = self.filter.means.shape
        if then.filter is not None and (found := then.filter["means"].shape) != expected:
            raise ValueError(f"snapshot: expected means of shape {expected}, found {found}")
        self.begin() if then.filter is None else self.filter.resume(then.filter)
        for key, value in then.own.items():
            setattr(self, key, copy(value))
        self.time_s, self.open_loop.cov = then.time_s, then.open_loop_cov

    def run(
        self,
        frames: Sequence[tuple[float, Sequence[MarkMeasurement]]],
        advance: Callable[[float], None] = lambda _share: None,
    ) -> Iterator[list[TargetEstimate]]:
        """For each frame (time [s], marks), yield a list of one estimate. advance: called with the completed share."""
        for k, (time_s, marks) in enumerate(frames, start=1):
            self.predict(time_s)
            estimate = self.update(marks)
            advance(k / len(frames))
            yield [estimate]

    @all_or_nothing
    def predict(self, time_s: float, push: ForceHistory | None = None) -> None:
        """Predict the state at an exposure time [s]. Raises ValueError for an infinite or an earlier time.

        push: known force on the tissue, such as the force of a needle
        """
        if not np.isfinite(time_s) or (self.time_s is not None and time_s < self.time_s):
            raise ValueError(f"time_s: expected {self.time_s} or later, found {time_s}")
        if self._moved(time_s, push, np.inf):
            self.health = replace(self.health, status=Status.LOST)

    def _moved(self, time_s: float, push: ForceHistory | None, longest_s: float) -> bool:
        """Predict the state at a time [s]; if the step exceeds `forget_s` and `lost_s`, reset it and return True."""
        dt = 0.0 if self.time_s is None or self.health.since_s is None else time_s - self.time_s
        if dt > 0.0:
            self.residual_m = np.zeros_like(self.residual_m)
        is_forgotten = dt > max(self.settings.forget_s, self.settings.lost_s)
        if is_forgotten:
            self._restart("forgotten", as_drawn=True)
        elif dt > 0.0:
            self._advance(time_s - dt, dt, push, longest_s)
        self.time_s = time_s
        return is_forgotten

    def _advance(self, time_s: float, dt: float, push: ForceHistory | None, longest_s: float) -> None:
        known = None if push is None else KnownForce(push, self.network, time_s)
        n = max(1, int(np.ceil(dt / (longest_s if known is None else PUSHED_S) - 1e-9)))
        for _ in range(n):
            kick = None
            if known is not None:
                known.step(dt / n)
                mean, velocity = self.filter.mean, self.process.parts["velocity"]
                state = np.r_[self.process.positions(mean), self.process.at(mean[velocity])]
                forces = known.forces(state[None]).ravel()
                kick = self.process.pushed(mean, dt / n, forces[:, None])[:, 0]
                if self.flexibility is not None:
                    self.residual_m = self.flexibility @ forces
            self.filter.predict(dt / n, kick)

    def _ahead(self, time_s: float, push: ForceHistory | None = None) -> None:
        if self.time_s is None or not self.time_s <= time_s < np.inf:
            after = "a first call of predict" if self.time_s is None else f"{self.time_s} or later"
            raise ValueError(f"time_s: expected {after}, found {time_s}")
        self._moved(time_s, push, MIX_S)

    @contextmanager
    def _unchanged(self) -> Iterator[None]:
        """Context manager that uses one thread for linear algebra, and restores the present state at the end."""
        now = self.snapshot()
        try:
            with one_blas_thread():
                yield
        finally:
            self.restore(now)

    def predict_at(self, time_s: float, push: ForceHistory | None = None) -> TargetEstimate:
        """Predict the target at a later time [s], under the known force `push`. The state does not change.

        Raises ValueError before the first frame, and for an earlier or infinite time.
        """
        with self._unchanged():
            self._ahead(time_s, push)
            return self._estimate(time_s, 0, None)

    def predict_modes(self, time_s: float, push: ForceHistory | None = None) -> GaussianMixture:
        """Predict the target like `predict_at`, as a mixture with one Gaussian for each mode of the unknown forces."""
        with self._unchanged():
            self._ahead(time_s, push)
            rows, own, live = self.rows_of(self.target), self.filter, np.flatnonzero(self.filter.weights)
            means = own.means[live] @ rows.T + self.constant_of(self.target)
            return GaussianMixture(own.weights[live], means, rows @ own.covs[live] @ rows.T)

    def predict_path(self, times_s: Floats) -> tuple[Floats, Floats]:
        """Means [m], (k, dim), and covariances [m²], (k, dim, dim), of the target at later times [s], (k,).

        The state does not change. Raises ValueError as `predict_at` does, and if the times decrease.
        """
        found = []
        with self._unchanged():
            for time_s in np.asarray(times_s, dtype=float).tolist():
                self._ahead(time_s)
                found.append(self.place_of(self.target))
        dim = self.network.dim
        means, covs = [mean for mean, _ in found], [cov for _, cov in found]
        return np.reshape(means, (-1, dim)), np.reshape(covs, (-1, dim, dim))

    def tables(self, n_times: int, cycle_s: float) -> AheadTables:
        """Tables that predict the target at n_times times with the interval cycle_s [s], from the filter's time on."""
        return AheadTables.of(self, n_times, cycle_s)

    @all_or_nothing
    def update(self, marks: Sequence[MarkMeasurement]) -> TargetEstimate:
        """Update with any number of marks at the state's time, and estimate the target.

        Raises ValueError before the first `predict`, and for marks that `check` rejects. Raises CovarianceError if
        the updated state is not finite.
        """
        if self.time_s is None:
            raise ValueError("update: expected predict(time_s) first, found no time")
        self.check(marks)
        dt = 0.0 if self._updated_s is None else self.time_s - self._updated_s
        self._updated_s = self.time_s
        before = self.health.status
        starting = self.health.since_s is None or before is Status.LOST
        if marks and before is Status.LOST:
            is_refuted = self._refuted_s > -np.inf  # all marks after a restart were outliers
            self._restart("restarted", as_drawn=is_refuted, marks=marks)
        taken, nis, shift = self._taken(marks, starting=starting)
        measured = self._measured(taken)
        self.health = after_frame(self.health, self.time_s, nis, measured, self.settings)
        if self.health.status is Status.DIVERGED and not self.health.innovations and taken:
            taken, nis = self._again(marks, before)
            measured = self._measured(taken)
        self.rejected.update(mark.node for mark in marks if mark not in taken)
        covs = {mark.node: mark.total_cov for mark in taken if mark.node in self._driven}
        self.open_loop.take(min(dt, self.settings.forget_s), covs)
        self._seen_s |= dict.fromkeys((mark.node for mark in taken), self.time_s)
        self._placed = self.filter.mean[self.process.parts["position"]] if taken else self._placed
        estimate = self._estimate(self.time_s, len(taken), None if nis is None else self._nis)
        shares = self.shares(marks, float(np.trace(np.asarray(estimate.cov)))) if marks else {}
        return replace(estimate, information_share=shares, shift=shift, measured=measured)

    def _measured(self, marks: Sequence[MarkMeasurement]) -> int:
        """Number of coordinates that the marks measure. In 3-D, a mark that only one camera sees measures no depth."""
        variances = np.linalg.eigvalsh(np.reshape([mark.cov for mark in marks], (-1, *[self.network.dim] * 2)))
        return int((variances < (UNMEASURED * self.process.extent_m) ** 2).sum())

    def _taken(
        self, marks: Sequence[MarkMeasurement], *, starting: bool
    ) -> tuple[list[MarkMeasurement], float | None, CommonShift | None]:
        """Update with the marks; returns the inliers, their NIS, and the test for a common shift of all marks."""
        self.log_likelihood = 0.0
        if not marks or self.time_s is None:
            return [], None, None
        places = self.places(marks)
        y, S = self.filter.innovations([places]).overall
        shift = None if starting else self.shift(y, S)
        nis = self._observed(places)
        kept = np.repeat(~self.filter.outlying, self.network.dim)
        self._nis = float(y[kept] @ np.linalg.solve(S[np.ix_(kept, kept)], y[kept]))
        self.log_likelihood = 0.0 if starting else self.filter.log_likelihood
        taken = self._inliers(marks)
        if taken:
            self._refuted_s = -np.inf
            return taken, nis, shift
        self._refuted_s = self.time_s if self._refuted_s == -np.inf else self._refuted_s
        if (self.time_s - self._refuted_s) * len(marks) < REFUTED_S:
            return [], None, shift
        before, self.health = self.health.status, Health(Status.DIVERGED, self.time_s, self.time_s)
        return *self._again(marks, before), shift

    def _again(self, marks: Sequence[MarkMeasurement], before: Status) -> tuple[list[MarkMeasurement], float | None]:
        """Restart, then update with the marks; returns the inliers and their NIS."""
        self._restart("restarted", as_drawn=before in (Status.DIVERGED, Status.INITIALISING), marks=marks)
        nis = self._observed(self.places(marks))
        taken = self._inliers(marks)
        return taken, nis if taken else None

    def _observed(self, places: Places) -> float:
        try:
            nis = self.filter.update([places])
        except np.linalg.LinAlgError:
            raise CovarianceError("innovation covariance: expected a positive definite matrix, found another") from None
        if not self.is_finite:
            raise CovarianceError("mean and covariance of the tissue: expected finite numbers, found others")
        return nis

    def _inliers(self, marks: Sequence[MarkMeasurement]) -> list[MarkMeasurement]:
        return [mark for mark, out in zip(marks, self.filter.outlying, strict=True) if not out]

    @all_or_nothing
    def fix(self, position: Floats, cov: Floats) -> TargetEstimate:
        """Update with a fix, which is a direct measurement of the target.

        position: measured position [m], (dim,); cov: covariance of the measured position [m²], (dim, dim)
        A fix outside the gate is rejected, unless the previous fix was rejected at nearly the same position.
        Raises ValueError before the first `predict`, and for an invalid position or covariance.
        """
        if self.time_s is None:
            raise ValueError("fix: expected predict(time_s) first, found no time")
        dim = self.network.dim
        if np.shape(position) != (dim,) or np.shape(cov) != (dim, dim):
            found = f"{np.shape(position)}, {np.shape(cov)}"
            raise ValueError(f"fix: expected shapes {(dim,)} and {(dim, dim)}, found {found}")
        place, R = checked_measurement(FIX, position, cov)
        rows = self.rows_of(self.target)
        bias = self.process.parts.get("bias")
        if bias is not None:
            rows[:, bias] = np.eye(dim)
        seen = Places([MarkMeasurement(FIX, place - self.constant_of(self.target), R)], {FIX: rows})
        mean, P = self.filter.moments(rows)
        y = seen.value - mean
        nis = float(y @ np.linalg.solve(P + R, y))
        before, now = self._far_fix, Outlying(self.time_s, self.time_s, place, R)
        self._far_fix = None
        if nis <= self.settings.gate or (before is not None and confirmed(before, now, self.settings)):
            self._observed(seen)
        else:
            self._far_fix = now
            self.rejected[FIX] += 1
        return self._estimate(self.time_s, 0, nis)

    def _estimate(self, time_s: float, marks_used: int, nis: float | None) -> TargetEstimate:
        mean, cov = self.place_of(self.target)
        tissue_m2, open_loop_m2 = self.tissue_m2(cov), float(np.trace(self.open_loop.target_cov))
        unseen_s = np.inf if self.seen_s is None else time_s - self.seen_s
        return TargetEstimate(
            time_s=time_s,
            mean=mean,
            cov=cov,
            status=self.health.status,
            marks_used=marks_used,
            nis=nis,
            noise=self.level.noise,
            poked=float(self.filter.weights[~self.process.disturbances.calm_modes].sum()),
            model_only=unseen_s > self.settings.lost_s or tissue_m2 > self._model_only_m2,
            gain=None if open_loop_m2 <= 0.0 else 1.0 - tissue_m2 / open_loop_m2,
        )
