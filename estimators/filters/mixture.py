"""Interacting multiple models: filterpy's estimator with rates in place of odds a frame, and logarithmic likelihoods.

Source: [barshalom2001], section 11.6.6. What is considered beside the state: [bierman1977], chapter VIII.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from math import isfinite

import filterpy.kalman as filterpy
import numpy as np

from estimators.arrays import Floats
from estimators.filters.chain import ModeChain
from estimators.filters.gaussians import nearest_definite
from estimators.filters.iterated import IteratedStart
from estimators.filters.kernels import (
    is_finite,
    mixed_each,
    moments_each,
    regressions,
    schmidt_update,
    symmetric_points_each,
    with_columns,
    with_outliers,
)
from estimators.filters.measurement import CommonErrors, Outliers
from estimators.filters.motion import Cycle, ModeBeliefs, Move, Transition
from estimators.filters.noise_level import NoiseLevel
from estimators.filters.unscented import CovarianceError, UnscentedKalmanFilter

NARROW = 0.05
"""Spread of the sigma points, by the usual one, where the usual one would leave the model's ground; chosen."""

ADDED_SHARE = 1.0
"""Share of the variance of z's common errors that gains add as independent; choice, its cost in docs/settings.md.
Schmidt's gain, 0, is the best of one update, but the next ones have the same error: it relies on them too much."""


class InteractingMixture(filterpy.IMMEstimator):
    """A bank of unscented filters of one state, mixed by how well each explains the measurements.

    filters: one for each mode, of equal state
    mu: probability of each mode, (n_modes,); where it is set, states of one mode keep their odds to each other
    chain: the states by which modes follow each other, made of `rates`, how often state i turns into state j [1/s],
        `of_state`, the mode of each, and at first mu, their odds; without `of_state` modes are states
    columns: (n_modes, n, r): what r known, independent directions, each by one standard deviation, make of the error
        of each mode's mean; never estimated
    considered: whether gains allow for the columns; if not, these are the sensitivities of a filter that knows of none
    log_likelihood: of the last measurement
    added_share: see `ADDED_SHARE`
    innovation_columns: (n_modes, m, r): what the directions made of the last innovations
    common_errors: what innovations tell of the directions: by this, not by their variances, modes are weighed
    x, P: mean and covariance of the whole mixture, what the columns add included
    onset: None, or variances by the forces of each mode, (n_modes, n), which begin at full strength: `ModeChain.begun`
    level: None, or the level of the process noise, which is then learnt
    trace: None, or a list to which each prediction adds its `Transition`
    cycle: the last prediction of a linearised motion that no update has followed yet, else None
    repairs: how often something was mended: `narrowed` sigma points, covariances made `definite`

    Differs from filterpy: the transition matrix is exp(rates dt), so that the odds do not depend on the frame rate;
    modes may be entered from states that differ; likelihoods are compared as logarithms, so that two hopeless modes are
    still told apart; modes move together.
    """

    def __init__(
        self,
        filters: Sequence[UnscentedKalmanFilter],
        mu: Floats,
        rates: Floats,
        move: Move | None = None,
        of_state: Sequence[int] | None = None,
    ) -> None:
        self.columns = np.zeros((len(filters), filters[0].x.shape[0], 0))
        self.considered = True
        self.added_share = ADDED_SHARE
        self.filters: list[UnscentedKalmanFilter]
        self.omega: Floats
        self.cbar: Floats
        self.innovation_columns, self.common_errors = self.columns, CommonErrors.unknown(0)
        self.log_likelihood = 0.0
        self.repairs: Counter[str] = Counter()
        self.chain = ModeChain(mu, rates, of_state)
        self._ahead = 0.0
        super().__init__(list(filters), self.mu, np.eye(len(filters)))
        self.move = Move(self._one_by_one) if move is None else move
        self.trace: list[Transition] | None = None
        self.onset: Floats | None = None
        self.level: NoiseLevel | None = None
        self.white: Floats  # of each step, added to the covariance of the first filter
        self.cycle: Cycle | None = None
        first = self.filters[0]
        self._scale, self._weights = first._scale, (np.tile(first.Wm, (self.N, 1)), np.tile(first.Wc, (self.N, 1)))

    def _one_by_one(self, points: Floats, dt: float) -> Floats:
        return np.array([f.fx(own, dt) for f, own in zip(self.filters, points, strict=True)])

    @property
    def mu(self) -> Floats:
        """Probability of each mode, (n_modes,); where it is set, states of one mode keep their odds."""
        return self.chain.mode_odds

    @mu.setter
    def mu(self, odds: Floats) -> None:
        self.chain.set_mode_odds(odds)

    def restart(self, mean: Floats, cov: Floats, columns: Floats | None = None) -> None:
        """Give every mode the same Gaussian: mean (dim_x,), cov (dim_x, dim_x), columns (dim_x, r).

        The odds of the modes stay. Without columns, those of the first mode.
        """
        for f in self.filters:
            f.x, f.P = mean.copy(), cov.copy()
        self.columns = np.tile(self.columns[0] if columns is None else columns, (len(self.filters), 1, 1))
        self.cycle = None
        if self.level is not None:
            self.level.forget()
        self._compute_state_estimate()

    def predict(self, dt: float, longest_s: float = np.inf) -> None:
        """Mix, then move every mode ahead by dt [s], in equal steps no longer than longest_s."""
        self._ahead, self.common_errors = dt, self.common_errors.later(dt)
        self._noted()
        self._compute_mixing_probabilities()
        before = self.beliefs()
        xs, Ps, columns = mixed_each(self.omega, before.means, before.covs, self.columns)
        mixes = xs, Ps
        if self.onset is not None:
            Ps = Ps + self.chain.begun(self.omega, self.onset)[:, :, None] * np.eye(xs.shape[1])
        if self.move.linear is not None:
            self.chain.odds = self._odds_ahead
            motion, passes = self.move.linear(dt, self.noise_level)
            first = int(self.cbar.argmax())
            self._arrive(Cycle(xs, mixes[1], Ps, columns, motion, passes, xs, motion(xs), dt, first))
            return
        Qs = np.array([f.Q for f in self.filters])
        n, F = max(1, int(np.ceil(dt / longest_s - 1e-9))), np.tile(np.eye(xs.shape[1]), (len(xs), 1, 1))
        for _ in range(n):
            points, moved, weights = self._moved(xs, Ps, dt / n)
            if columns.shape[2] and self.move.columns is not None:
                columns = self.move.columns(xs, columns, dt / n)
            if self.trace is not None:
                F = regressions(points, moved) @ F
            if self.level is not None:
                own = slice(k := int(self.cbar.argmax()), k + 1)
                self.level.predicted(regressions(points[own], moved[own])[0], self.white, dt / n)
            xs, Ps = moments_each(moved, *weights, Qs)
        if self.trace is not None:
            self.trace.append(Transition(self.omega, *mixes, F, ModeBeliefs(self.cbar, xs, Ps)))
        self.columns = columns
        for f, x, P in zip(self.filters, xs, Ps, strict=True):
            f.x, f.P = x, P
        # filterpy moves mu only in update; between two updates the prior is the one that the rates give
        self.chain.odds = self._odds_ahead
        self._compute_state_estimate()

    @property
    def noise_level(self) -> float:
        """The factor on the variances of white noise [1]."""
        return 1.0 if self.level is None else self.level.scale

    def _noted(self) -> None:
        """Have the level know of the last prediction of a linearised motion, which stays as it is from now on."""
        if self.level is not None and self.cycle is not None:
            self.level.predicted(*self.cycle.of_first)

    def _arrive(self, cycle: Cycle) -> None:
        """Move what a cycle began with to its end, by the motion linearised about `cycle.about`."""
        found = cycle.found
        xs = found.ends + np.einsum("kij,kj->ki", found.F, cycle.means - cycle.about)
        Ps = found.predicted(cycle.covs)
        self.columns = found.F @ cycle.columns + found.added
        for f, x, P in zip(self.filters, xs, Ps, strict=True):
            f.x, f.P = x, P
        beliefs = ModeBeliefs(self.mu, xs, Ps)
        if self.trace is not None:
            self.trace.append(Transition(self.omega, cycle.means, cycle.mixed, found.F, beliefs))
        self.cycle = cycle
        self._compute_state_estimate(beliefs)

    def _relinearise(self, z: Floats, H: Floats, R: Floats) -> None:
        """Repeat the last prediction about the states at its start that z makes the most probable.

        For links that turn far within a cycle: about the state before z the motion is that of another shape.
        """
        if self.cycle is None or self.cycle.passes < 2:
            return
        if (found := IteratedStart(self.cycle, z, H, R, considered=self.considered).found()) is not None:
            if self.trace:
                self.trace.pop()
            self._arrive(found)

    def _moved(self, xs: Floats, Ps: Floats, dt: float) -> tuple[Floats, Floats, tuple[Floats, Floats]]:
        """Sigma points of each mode before and after a step, and their weights; narrow where they must be."""
        scales = np.full(len(xs), self._scale)
        points, definite = symmetric_points_each(xs, Ps, scales)
        if not definite.all():
            self.repairs["definite"] += int((~definite).sum())
            Ps = np.array([P if fine else nearest_definite(P) for P, fine in zip(Ps, definite, strict=True)])
            points, _ = symmetric_points_each(xs, Ps, scales)
        weights = self._weights
        if self.move.turned is not None and (turned := self.move.turned(points)).any():
            self.repairs["narrowed"] += int(turned.sum())
            scales[turned] *= NARROW**2
            points, _ = symmetric_points_each(xs, Ps, scales)
            weights = (weights[0].copy(), weights[1].copy())
            weights[1][turned, 1:] = 0.5 / scales[turned, None]
            weights[1][turned, 0] = 0.0  # no negative weight: the covariance stays one
            # to first order: curvature at the mean, taken as far as the covariance reaches, has no bounds
            weights[0][turned] = np.arange(points.shape[1]) == 0
        return points, self.move.points(points, dt), weights

    def _compute_mixing_probabilities(self) -> None:
        self._odds_ahead, self.cbar, self.omega = self.chain.ahead(self._ahead)

    def update_linear(
        self, z: Floats, H: Floats, R: Floats, shared: Floats | None = None, outliers: Outliers | None = None
    ) -> None:
        """Take in z = H x + noise of covariance R: z (m,), H (m, dim_x), R (m, m).

        Raises CovarianceError where the innovation of any mode has no finite likelihood; then no mode has changed.
        shared: what the directions of the columns, each by one standard deviation, move z itself by, (m, r)
        outliers: None, or what else a part of z may be: each mode takes for that what it cannot explain
        """
        self._relinearise(z, H, R)
        moved = np.zeros((len(z), self.columns.shape[2])) if shared is None else shared
        self._noted()
        innovation_columns = H @ self.columns + moved
        n, updates, logs, covs = self.considered * moved.shape[1], [], [], []
        errors = self.common_errors.moved_by(moved[:, :n])
        common = (errors.mean, errors.root)
        for f, columns, own in zip(self.filters, self.columns, innovation_columns, strict=True):
            R_own, log_odds, widened = R, 0.0, 0.0
            if outliers is not None:
                R_own, log_odds, widened = with_outliers(f.x, f.P, z, H, R, own, *outliers)
            found = schmidt_update(f.x, f.P, z, H, R_own, columns[:, :n], moved[:, :n], self.added_share, *common)
            *gained, nis, log_det, definite, own_nis, own_log_det, cov = found
            if not definite:
                raise CovarianceError("innovation covariance: expected positive definite, found otherwise")
            if not isfinite(nis + log_det + own_nis + own_log_det):
                raise CovarianceError(f"innovation: expected a finite likelihood, found {nis} and {log_det}")
            updates.append((*gained, nis - 2.0 * log_odds + widened, log_det - widened))
            logs.append(log_odds - 0.5 * (own_nis + own_log_det))
            covs.append(cov)
        # nothing changes before the update of every mode is known to succeed
        columns = np.empty_like(self.columns)
        for k, (f, (x, P, y, S, K, nis, log_det)) in enumerate(zip(self.filters, updates, strict=True)):
            f._accept(x, P, (y, S, K))
            f._judge(nis, log_det)
            columns[k] = self.columns[k] - K @ innovation_columns[k]
        self.columns, self.innovation_columns, self.cycle = columns, innovation_columns, None
        whole, own_logs = np.array([f.log_likelihood for f in self.filters]), np.array(logs)
        self.log_likelihood = float(whole.max() + np.log(self.mu @ np.exp(whole - whole.max())))
        self.likelihood = np.exp(own_logs - own_logs.max())
        self.chain.weigh(self.likelihood)
        if self.level is not None:
            f = self.filters[int(self.mu.argmax())]
            self.level.learn((f.y, f.S, f.K), H)
        self.common_errors = errors.told([f.y for f in self.filters], covs, innovation_columns[:, :, :n], self.mu)
        self._compute_state_estimate()

    def hold(self, beliefs: tuple[Floats, Floats, Floats]) -> None:
        """Set each mode's mean, covariance and columns, (k, n), (k, n, n), (k, n, r); odds stay."""
        xs, Ps, self.columns = beliefs
        for f, x, P in zip(self.filters, xs, Ps, strict=True):
            f.x, f.P = x, P
        self._compute_state_estimate()

    @property
    def mean_columns(self) -> Floats:
        """The columns of the whole mixture, (n, r): their mean over the modes."""
        return np.asarray(np.einsum("k,kij->ij", self.mu, self.columns))

    def beliefs(self) -> ModeBeliefs:
        """What the modes believe now."""
        return ModeBeliefs(self.mu, np.array([f.x for f in self.filters]), np.array([f.P for f in self.filters]))

    def _compute_state_estimate(self, now: ModeBeliefs | None = None) -> None:
        now = self.beliefs() if now is None else now
        xs, Ps, columns = mixed_each(now.mu[:, None], now.means, now.covs, self.columns)
        x, P = xs[0], with_columns(Ps[0], columns[0])
        if not is_finite(x, P):
            raise CovarianceError("mean and covariance of the mixture: expected finite, found otherwise")
        self.x, self.P = x, P
