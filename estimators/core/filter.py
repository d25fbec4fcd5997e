"""Interacting multiple model filter, with one Gaussian for each mode and an iterated update."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.linalg.blas import dgemm

from estimators.arrays import Floats
from estimators.core.discrepancy import LevelPosterior
from estimators.core.innovations import (
    Innovations,
    Outliers,
    are_same,
    block_diagonal,
    each_alone,
    joined,
    named,
    solved,
    together,
)
from estimators.core.moments import Move, Predicted, Prior, mixed, of_each
from estimators.core.protocols import Observation, ProcessModel, Transition

DISCREPANCY = "discrepancy"
"""Name of the states of the discrepancy, which is the displacement that the model leaves out."""

LEAST_SHARE = 1e-3
"""The prediction of a mode is a mixture of hypotheses. Weights below this number become zero [1]; choice."""

REBORN = 0.05
"""If an updated mode is less probable than this number times the probability of a change from other modes into it, the
mode is omitted until the next prediction [1]; choice."""

LINEARISATIONS = 10
"""Largest number of linearisations per frame of transition and observation; numerical: a rotating cable needs many."""

LEAST_STEP = 0.125
"""Smallest share of a Gauss-Newton step that is tried [1]; numerical."""

CURVED = 0.1
"""Largest accepted error of a linearised observation, in standard deviations of the observation [1]; numerical."""

ONSET_SHAPE, ONSETS_S = 1.0, 60.0
"""An onset is a change to a mode with a higher index. The filter estimates a factor on the rates of onsets. ONSET_SHAPE
is the shape of the factor's gamma prior [1], ONSETS_S the time constant for which onsets are remembered [s]; choice."""

STATE = ["means", "_covs", "weights", "log_likelihood", "outlying", "found"]
STATE += ["onsets", "exposure", "_before", "_transition", "_reference", "_dt"]
"""Attributes of `HypothesisFilter` that each step replaces."""

Groups = Callable[[Sequence[str], Sequence[slice]], Sequence[NDArray[np.int64]]]


class HypothesisFilter:
    """Filter with one Gaussian hypothesis of the state for each mode of the process.

    All hypotheses use one linearisation of the transition, about their common mean. If the linearisation error is too
    large, the transition is linearised again about the smoothed mean (iterated update). Sources: [blom1988] for the
    hypotheses, [garciafernandez2017] for the iteration.

    Parameters
    ----------
    process : ProcessModel
    level : LevelPosterior, optional
        Estimator of the standard deviation of the discrepancy (the error of the model). Default: the deviation is 1.
    groups : callable, optional
        Returns the blocks of the observations that `level` leaves out together, like `WithheldGroups`. Default: each
        block is left out alone.
    outliers : Outliers, optional
        Prior of outliers; default: no outliers.
    considered : (n_considered,) int
        Indices of states that increase covariances but are not estimated (Schmidt-Kalman filter, [schmidt1966]).

    Attributes
    ----------
    means, covs, weights : (k, n), (k, n, n), (k,)
        Mean, covariance and weight of each hypothesis. If the weight is 0 after an update, the covariance is 0.
    log_likelihood : float
        Log likelihood of the last observations.
    onsets, exposure : (k,), float
        Estimated number of past onsets (see `ONSET_SHAPE`) in each hypothesis; number that the prior rates predict.
    outlying : (n_names,) bool
        Whether each of the last observations is an outlier in the most probable hypothesis.
    found : Innovations or None
        Innovations of the last update.
    trace : list of Move, or None
        List to which each prediction is appended. If it is None, predictions are not recorded.
    """

    def __init__(
        self,
        process: ProcessModel,
        level: LevelPosterior | None = None,
        groups: Groups | None = None,
        *,
        outliers: Outliers | None = None,
        considered: NDArray[np.int64] | Sequence[int] = (),
    ) -> None:
        self.process, self.level, self._groups, self._outliers = process, level, groups or each_alone, outliers
        self._considered = np.asarray(considered, dtype=np.int64)
        self._before: Prior | None = None
        self._latest: tuple[Sequence[Observation], Innovations] | None = None
        self._named: tuple[list[str], list[slice]] = [], []
        self._withheld: Sequence[NDArray[np.int64]] = ()
        self._transition: Transition | None = None
        self._reference = np.empty(0)
        self.trace: list[Move] | None = None
        self.restart()

    def restart(self) -> None:
        """Reset to the prior of the process."""
        mean, covs = self.process.prior(self._level)
        k = len(covs)
        self.means, self.weights = np.tile(mean, (k, 1)), np.full(k, 1.0 / k)
        self._covs: Predicted | Floats = covs
        self._before, self._latest, self.log_likelihood, self._dt = None, None, 0.0, 0.0
        self.outlying = np.zeros(0, dtype=bool)
        self.found: Innovations | None = None
        self.onsets, self.exposure = np.zeros(k), 0.0

    def state(self) -> dict[str, Any]:
        """The complete present state, for `resume`."""
        levels = None if self.level is None else self.level.log_weights
        return {**{key: getattr(self, key) for key in STATE}, "levels": levels}

    def resume(self, state: Mapping[str, Any]) -> None:
        """Restore a state that `state` returned."""
        for key in STATE:
            setattr(self, key, state[key])
        self._latest = None
        if self.level is not None:
            self.level.log_weights = state["levels"]

    @property
    def covs(self) -> Floats:
        """Covariances of the hypotheses, (k, n, n)."""
        if isinstance(self._covs, Predicted):
            self._covs = self._covs.each(np.arange(len(self.weights)))
        return self._covs

    def times(self, H: Floats) -> Floats:
        """The products `H P`, (k, m, n), of a matrix H (m, n) with the covariance P of each hypothesis."""
        return self._covs.times(H) if isinstance(self._covs, Predicted) else np.asarray(H @ self.covs)

    @property
    def variances(self) -> Floats:
        """Variance of each source of noise in each mode, (n_modes, n_sources)."""
        return self.process.variances(self._level)

    @property
    def rates(self) -> Floats:
        """Transition rates [1/s], (n_modes, n_modes), with the estimated factor on the rates of onsets."""
        factor = (ONSET_SHAPE + self.weights @ self.onsets) / (ONSET_SHAPE + self.exposure)
        found = np.tril(self.process.rates, -1) + factor * np.triu(self.process.rates, 1)
        return np.asarray(found - np.diag(found.sum(axis=1)))

    @property
    def mean(self) -> Floats:
        """Mean of the mixture, (n,)."""
        return np.asarray(self.weights @ self.means)

    def moments(self, rows: Floats) -> tuple[Floats, Floats]:
        """Mean (d,) and covariance (d, d) of `rows @ state`, where `rows` is a matrix (d, n)."""
        live, seen = np.flatnonzero(self.weights), np.flatnonzero(rows.any(axis=0))
        covs = [rows[:, seen] @ self.covs[k][seen] @ rows.T for k in live]
        return mixed(self.weights[live], self.means[live] @ rows.T, covs)

    def moments_by(self, weights: Floats) -> tuple[Floats, Floats]:
        """Mean (n,) and covariance (n, n) of the mixture of all hypotheses with given weights (n_modes,)."""
        return mixed(weights, self.means, self.covs)

    def predict(self, dt: float, kick: Floats | None = None) -> None:
        """Predict all hypotheses over dt > 0 [s].

        kick: change of the state by a known force, (n,)
        """
        live, chain = np.flatnonzero(self.weights), expm(self.rates * dt)
        joint = self.weights[live, None] * chain[live]
        weights = joint.sum(axis=0)
        shares = joint / weights
        kept = np.exp(-dt / ONSETS_S)
        self.onsets = (shares * (kept * self.onsets[:, None] + np.triu(np.ones_like(chain), 1))[live]).sum(axis=0)
        shares[shares < LEAST_SHARE] = 0.0
        shares /= shares.sum(axis=0)
        self.exposure = kept * self.exposure + dt * float(self.weights @ np.triu(self.process.rates, 1).sum(axis=1))
        if self.level is not None:
            self.level.forget(dt)
        own = self.means[live], tuple(self.covs[k] for k in live), self.weights[live]
        before = Prior(*own, shares, chain, dt, 0.0 if kick is None else kick)
        self.weights, self._before, self._dt = weights, before, dt
        self._move(before, before.weights @ before.means, lambda: before.cov(int(np.argmax(weights))))
        if self.trace is not None:
            self.trace.append(self._traced(self._before))

    def _move(
        self, before: Prior, reference: Floats, cov: Callable[[], Floats] | None = None, error: Floats | None = None
    ) -> None:
        found = self.process.linearize(reference, before.dt, cov)
        means = found.mean + (before.means - reference) @ found.matrix.T + before.kick
        self.means = before.shares.T @ means
        alike = np.zeros(len(reference))
        if error is not None:
            for own in self.process.parts.values():
                alike[own] = (error[own] ** 2).mean() if error[own].size else 0.0
        self._covs = Predicted.of(before, means, found, self.variances, alike)
        self._transition, self._reference, self._latest = found, reference, None

    def _traced(self, before: Prior) -> Move:
        assert self._transition is not None  # a prediction sets it
        start = mixed(before.weights, before.means, before.covs)
        return Move(*start, self._transition.matrix, *self.moments_by(self.weights))

    @property
    def _level(self) -> float:
        return 1.0 if self.level is None else self.level.level

    def innovations(self, observations: Sequence[Observation], points: Floats | None = None) -> Innovations:
        """Innovations of all hypotheses, linearised at their means or at points (k, n). Raises CovarianceError."""
        if points is None and self._latest is not None and are_same(self._latest[0], observations):
            return self._latest[1]
        value, R = together(observations)
        linear = [[one.linearize(at) for one in observations] for at in (self.means if points is None else points)]
        predicted = np.array([joined([place for place, _ in row]) for row in linear])
        matrices = [[matrix for _, matrix in row] for row in linear]
        if all(are_same(row, matrices[0]) for row in matrices):  # linear: all hypotheses have the same products
            del matrices[1:]
        H = np.array([joined(row) for row in matrices])
        y = value - predicted if points is None else value - predicted - of_each(H, self.means - points)
        seen = np.flatnonzero(H.any(axis=(0, 1)))  # the states that the observation depends on
        HP = self.times(H[0]) if len(H) == 1 else H[:, :, seen] @ self.covs[:, seen]
        S = HP[:, :, seen] @ H[:, :, seen].swapaxes(1, 2) + R
        result = solved((y, S, H, HP), self.weights, observations, self._outliers)
        if points is None:
            self._latest = observations, result
        return result

    def update(self, observations: Sequence[Observation]) -> float:
        """Update with all observations of the present time. Returns the smallest NIS among the hypotheses."""
        found = self._fitted(observations)
        if self.trace and self._before is not None:
            self.trace[-1] = self._traced(self._before)
        for left in reversed(range(LINEARISATIONS)):
            logs = found.logs - 0.5 * len(found.y[0]) * np.log(2.0 * np.pi)
            log_likelihood = float(np.logaddexp.reduce(logs))
            weights, means = np.exp(logs - log_likelihood), self.means.copy()
            if self._before is not None:
                weights[weights < REBORN * self._before.born(weights)] = 0.0
                weights /= weights.sum()
            live = np.flatnonzero(weights) if len(found.H) == 1 else np.arange(len(weights))
            gains = found.root[live] @ found.HP[live]
            means[live] += of_each(gains.swapaxes(1, 2), found.white[live])
            if not left or self._is_linear(observations, found, means):
                break
            found = self.innovations(observations, means)
        if self.level is not None:
            self._weigh_levels(self.level, observations, found)
        self.log_likelihood, own, kept = log_likelihood, self._considered, weights[live] > 0.0
        if isinstance(self._covs, Predicted):
            covs = self._covs.each(live[kept])
        else:
            covs = np.where((weights > 0.0)[:, None, None], self._covs, 0.0)
        for k, gain in zip(live[kept], gains[kept], strict=True):
            cov = covs[k]
            dgemm(-1.0, gain.T, gain.T, 1.0, cov.T, trans_b=True, overwrite_c=True)  # subtracts the product in place
            if len(own):
                cov[np.ix_(own, own)] += gain[:, own].T @ gain[:, own]
        means[:, own] = self.means[:, own]
        self.means, self._covs, self.weights = means, covs, weights
        self._before, self._latest, self.found = None, None, found
        self._dt = 0.0  # a part of the new discrepancy is now known: it is no longer independent noise
        self.outlying = found.outlying[int(np.argmax(self.weights))]
        return float(found.nis.min())

    def _fitted(self, observations: Sequence[Observation]) -> Innovations:
        """Innovations after the transition is linearised about the smoothed previous state.

        Gauss-Newton steps find the smoothed previous state of the most probable hypothesis. The remaining linearisation
        error becomes process noise. In each part of the state, all noise variances are the part's mean square error.
        """
        found, before = self.innovations(observations), self._before
        if before is None or not np.isfinite(self.process.tolerance).any():
            return found
        value, best = together(observations)[0], int(np.argmax(found.logs))
        prior = before.mean(best)
        dual = np.zeros(len(prior))

        def misfit(start: Floats, dual: Floats, end: Floats, noise: Floats, counted: NDArray[np.bool_]) -> float:
            """Twice the negative log posterior of the state `start`, up to a constant; `end` is the state after it."""
            if not np.isfinite(end).all():
                return np.inf
            y = counted * (value - joined([one.linearize(end + before.kick)[0] for one in observations]))
            return float(dual @ (start - prior) + y @ np.linalg.solve(noise, y))

        for _ in range(LINEARISATIONS - 1):
            transition, start = self._transition, self._reference
            assert transition is not None  # a prediction sets it
            counted = found.HP[best].any(axis=1)  # names that are no outliers
            H = found.H[best % len(found.H)] * counted[:, None]
            wanted = transition.matrix.T @ (H.T @ (found.root[best].T @ found.white[best]))
            step = prior + before.times(best, wanted) - start
            step[self._considered] = 0.0
            end = self.process.moved(start + step, before.dt)
            error = end - transition.mean - transition.matrix @ step
            if (np.abs(error) <= self.process.tolerance).all():
                break
            by_start = H @ transition.matrix
            weighing = found.S[best] - by_start @ before.times(best, by_start.T), counted
            now, share = misfit(start, dual, transition.mean, *weighing), 1.0
            while share and misfit(start + share * step, dual + share * (wanted - dual), end, *weighing) >= now:
                share = 0.5 * share if share > LEAST_STEP else 0.0
                end = self.process.moved(start + share * step, before.dt)
            dual = dual + share * (wanted - dual)
            self._move(before, start + share * step, error=error if np.isfinite(error).all() else None)
            found = self.innovations(observations)
            if not share:
                break
        return found

    def _is_linear(self, observations: Sequence[Observation], found: Innovations, means: Floats) -> bool:
        """Whether the linearised observations are accurate at the updated mean of the most probable hypothesis."""
        best = int(np.argmax(found.logs))
        value, R = together(observations)
        there = joined([one.linearize(means[best])[0] for one in observations])
        linear = value - found.y[best] + found.H[best % len(found.H)] @ (means[best] - self.means[best])
        is_out = found.y[best] == 0.0 if found.outlying[best].any() else False
        return bool(np.all((np.abs(there - linear) <= CURVED * np.sqrt(R.diagonal())) | is_out))

    def _weigh_levels(self, level: LevelPosterior, observations: Sequence[Observation], found: Innovations) -> None:
        """Update `level` with the innovations of the most probable hypothesis."""
        best = int(np.argmax(found.logs))
        own = found.H[best % len(found.H)][:, self.process.parts[DISCREPANCY]]
        names, blocks = named(observations)
        fresh = self.process.fresh(self._dt) * (own @ own.T)
        if self._named != (names, blocks):
            self._named, self._withheld = (names, blocks), self._groups(names, blocks)
        R = block_diagonal([getattr(one, "noise_cov", one.cov) for one in observations])
        level.update(found.y[best], found.S[best], fresh, R, self._withheld)
