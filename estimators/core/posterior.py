"""Posterior of a tissue at the present time: positions of tissue points, and search regions for marks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynamics import MassSpringNetwork, ParameterUncertainty, all_positions, rest_shape
from estimators.arrays import Floats
from estimators.core.discrepancy import Discrepancy, LevelPosterior, WithheldGroups
from estimators.core.disturbances import Disturbances
from estimators.core.filter import HypothesisFilter
from estimators.core.innovations import Outliers, inverse_roots
from estimators.core.marks import Places
from estimators.core.statics import Statics
from estimators.core.tissue import TissueProcess
from estimators.filters.kernels import block_contributions, nis_left
from estimators.pose.registration import RegistrationError, register_points
from estimators.process.open_loop_cov import OpenLoopCovariance
from estimators.process.process_model import QUIET
from estimators.process.target import TargetMap, TargetPoint, target_map
from estimators.tissue.estimate import CommonShift, MarkMeasurement, Status
from estimators.tissue.gate import Outlying
from estimators.tissue.health import Health
from estimators.tissue.settings import FilterSettings

BESIDE = 10.0
"""A node's prior covariance times this number is the covariance of the search region for its first mark [1]; choice."""

POSSIBLE = 1e-3
"""The search region of a mark is that of the most uncertain mode with at least this probability [1]; choice."""


class TissuePosterior:
    """Posterior of a tissue and of its target at the present time; `TissueFilter` predicts and updates it.

    Attributes
    ----------
    time_s : float or None
        Time of the state; None before the first frame.
    health : Health
    filter : HypothesisFilter
    rejected, repairs : Counter
        Number of rejected marks for each node, and number of restarts for each reason.
    log_likelihood : float
        Log likelihood of the last marks.
    residual_m : (n_free dim,)
        Static displacement by a known force, minus its part in the vibration modes of a continuum [m]; 0 for a network.
    """

    def __init__(
        self,
        network: MassSpringNetwork,
        target: str | TargetPoint,
        marked: Sequence[str],
        settings: FilterSettings | None = None,
        *,
        uncertainty: ParameterUncertainty | None = None,
        n_calibration: int = 0,
        disturbances: Disturbances | None = None,
        discrepancy: Discrepancy | None = None,
    ) -> None:
        if not marked or isinstance(marked, str):
            raise ValueError(
                f"marked: expected one free node or more, found {f'the text {marked!r}' if marked else 'none'}"
            )
        self.settings = settings or FilterSettings()
        for name in (*marked, *self.settings.led_nodes):
            network.coordinates(name)  # raises NetworkError for an unknown name and for an anchor
        self.network, self.marked, self.n_calibration = network, tuple(marked), n_calibration
        self.target, self.rest = target_map(network, target), rest_shape(network)
        self.process = TissueProcess(
            network,
            marked,
            led=self.settings.led_nodes,
            disturbances=disturbances or Disturbances.of(self.settings, solid=network.continuum is not None),
            discrepancy=discrepancy or Discrepancy.of(self.settings, solid=network.continuum is not None),
            sigma_points=self.settings.sigma_points,
            statics=Statics(uncertainty, n_calibration, self.settings.fix_bias, self.target.point.sd_m),
        )
        solid = network.continuum
        self.flexibility = None if solid is None else solid.residual
        self.residual_m = np.zeros(self.target.matrix.shape[1])
        self._maps = {name: self.process.node(name) for name in (network.names[i] for i in network.free)}
        self._left_out_m2 = dict(zip(self._maps, self.process.left_out_m2, strict=True))
        self._groups = WithheldGroups.of(network, marked, self.target.point)
        self._reach_m = float(np.ptp(self.rest, axis=0).max())
        self._outliers = Outliers(frozenset(self._maps), self.settings.outlier_odds, self._reach_m)
        self.time_s: float | None = None
        self.health = Health()
        self._seen_s: dict[str, float] = {}
        self.begin()
        driven = [node for node in marked if (node,) != self.target.point.nodes]
        self._driven = frozenset(driven)
        self.open_loop = OpenLoopCovariance(network, self.target.point, driven, QUIET.white)
        self.log_likelihood, self._nis = 0.0, 0.0
        self.rejected, self.repairs = Counter[str](), Counter[str]()
        self._updated_s: float | None = None
        self._refuted_s = -np.inf
        self._placed: Floats | None = None
        self._far_fix: Outlying | None = None
        self._model_only_m2 = self.settings.model_only_share * self.tissue_m2(self.place_of(self.target)[1])

    def begin(self) -> None:
        """Reset the posterior to the prior."""
        self.level = LevelPosterior(self.process.discrepancy)
        self.filter = HypothesisFilter(
            self.process, self.level, self._groups, outliers=self._outliers, considered=self.process.considered
        )

    def registered(self, marks: Sequence[MarkMeasurement]) -> Floats:
        """Coordinates (n,) of the nodes at `network.positions`, registered rigidly to the marks if this is possible."""
        drawn = self.network.positions
        places = np.reshape([drawn[self.network.index(mark.node)] for mark in marks], (-1, self.network.dim))
        measured, covs = [np.array([getattr(mark, key) for mark in marks]) for key in ("position", "total_cov")]
        with suppress(RegistrationError):
            drawn = register_points(places, measured, covs).motion.moved(drawn)
        return self.process.coordinates(drawn)

    @property
    def seen_s(self) -> float | None:
        """Time of the last used mark [s]; None before the first used mark."""
        return None if self.health.since_s is None else self.health.seen_s

    @property
    def positions(self) -> Floats:
        """Mean positions of all nodes [m], (n_nodes, dim), without the discrepancy."""
        places = self.process.positions(self.filter.mean) + self.residual_m
        return all_positions(self.network, places.reshape(-1, self.network.dim))

    @property
    def is_finite(self) -> bool:
        """Whether all numbers of the state are finite."""
        own = self.filter
        squares = [np.vdot(own.covs[k], own.covs[k]) for k in np.flatnonzero(own.weights)]
        return bool(np.isfinite(own.means.sum() + sum(squares)))

    @property
    def by_calibration(self) -> Floats:
        """Displacement of the target per standard deviation of each calibration error [m], (dim, n_calibration)."""
        return self._with_target(self.process.parts.get("calibration", slice(0, 0)))

    @property
    def considered_cov(self) -> Floats:
        """Covariance of the target due to the considered errors [m²], (dim, dim)."""
        columns = self._with_target(self.process.considered)
        return columns @ columns.T

    def _with_target(self, states: slice | NDArray[np.int64]) -> Floats:
        """Covariance of the target's position with k states, (dim, k)."""
        return self.rows_of(self.target) @ self.filter.moments_by(self.filter.weights)[1][:, states]

    @property
    def may_be_led(self) -> bool:
        """Whether an external force may drag the body: always in 3-D, and in 2-D if the settings name `led_nodes`."""
        return bool(self.settings.led_nodes) or self.network.dim == 3

    def rows_of(self, point: TargetMap) -> Floats:
        """Matrix A (dim, n) in the formula `A @ state + b` for a point's position. `constant_of` returns b."""
        rows = self.process.places(point.matrix)
        offset = self.process.parts.get("offset")
        if offset is not None and point is self.target:
            rows[:, offset] = np.eye(len(rows))
        return rows

    def place_of(self, point: TargetMap) -> tuple[Floats, Floats]:
        """Mean [m], (dim,), and covariance [m²], (dim, dim), of the position of a point of the tissue."""
        mean, cov = self.filter.moments(self.rows_of(point))
        own = 0.0 if point is self.target else point.point.sd_m
        left_out = point.matrix * np.repeat(self.process.left_out_m2, len(mean)) @ point.matrix.T
        return mean + self.constant_of(point), cov + self.level.level**2 * left_out + own**2 * np.eye(len(mean))

    def constant_of(self, point: TargetMap) -> Floats:
        """Constant b [m], (dim,), in the formula `A @ state + b` for a point's position. `rows_of` returns A."""
        return np.asarray(point.constant + point.matrix @ self.residual_m)

    def tissue_m2(self, cov: Floats) -> float:
        """Trace of the target's covariance `cov` (dim, dim) minus the trace of `offset_cov` [m²]."""
        return float(np.trace(cov) - np.trace(self.offset_cov))

    @property
    def offset_cov(self) -> Floats:
        """Covariance of the error of `TargetPoint.offset_m` [m²], (dim, dim)."""
        offset, dim = self.process.parts.get("offset"), self.network.dim
        if offset is None:
            return np.zeros((dim, dim))
        return self.filter.moments(np.eye(self.process.n)[offset])[1]

    @property
    def offset_mean(self) -> Floats:
        """Estimated error of the target's offset [m], (dim,)."""
        offset = self.process.parts.get("offset")
        return np.zeros(self.network.dim) if offset is None else np.asarray(self.filter.mean[offset])

    @property
    def tissue_cov(self) -> Floats:
        """Covariance of the target [m²], (dim, dim), if `TargetPoint.offset_m` had no error."""
        return self.filter.moments(self.process.places(self.target.matrix))[1]

    def check(self, marks: Sequence[MarkMeasurement]) -> None:
        """Raise ValueError for a repeated mark, and for a wrong node, dimension or number of shared errors."""
        for node, n in Counter(mark.node for mark in marks).items():
            if n > 1:
                raise ValueError(f"mark {node}: expected one measurement, found {n}")
        for mark in marks:
            if mark.node not in self.marked:
                names = ", ".join(self.marked)
                raise ValueError(f"mark {mark.node}: expected one of the marked nodes ({names}), found another")
            if len(mark.position) != self.network.dim:
                expected, found = (self.network.dim,), mark.position.shape
                raise ValueError(f"mark {mark.node} position: expected shape {expected}, found {found}")
            n_shared = self.n_calibration if mark.shared is None else mark.shared.shape[1]
            if self.n_calibration and n_shared != self.n_calibration:
                raise ValueError(f"mark {mark.node} shared: expected {self.n_calibration} directions, found {n_shared}")

    def places(self, marks: Sequence[MarkMeasurement]) -> Places:
        """Observation of one or more marks. The estimated noise factor multiplies the noise's standard deviation."""
        if self.residual_m.any():
            marks = [replace(mark, position=mark.position - self._residual(mark.node)) for mark in marks]
        found = Places(marks, self._maps, self.process.parts.get("calibration"), self.level.noise)
        left_out_m2 = self.level.level**2 * np.array([self._left_out_m2[mark.node] for mark in marks])
        found.cov += np.diag(np.repeat(left_out_m2, self.network.dim))
        return found

    def log_likelihood_of(self, marks: Sequence[MarkMeasurement]) -> float:
        """Log of the predicted density of the marks; 0 without marks, or if the filter has not started or is LOST."""
        if not marks or self.health.since_s is None or self.health.status is Status.LOST:
            return 0.0
        found = self.filter.innovations([self.places(marks)])
        return float(np.logaddexp.reduce(found.logs)) - 0.5 * len(found.y[0]) * float(np.log(2.0 * np.pi))

    def shift(self, y: Floats, S: Floats) -> CommonShift:
        """Test whether a common shift of all marks explains their innovation y (m,) with covariance S (m, m)."""
        dim, root = self.network.dim, inverse_roots(S[None])[0]
        return CommonShift(len(y) // dim, *nis_left(y, root.T @ root, dim))

    def shares(self, marks: Sequence[MarkMeasurement], variance: float) -> dict[str, float]:
        """For the node of each inlier, relative increase of the target's variance if this inlier were not used.

        variance: trace of the target's covariance [m²]
        """
        found, out = self.filter.found, self.filter.outlying
        if found is None:
            return {}
        best = int(np.argmax(self.filter.weights))
        W = found.root[best].T @ found.root[best]
        gain = self.rows_of(self.target) @ found.HP[best].T @ W
        shares = (block_contributions(gain, W, self.network.dim) / variance).tolist()
        return {mark.node: share for mark, share, is_out in zip(marks, shares, out, strict=True) if not is_out}

    def expected(self, node: str, shared: Floats | None = None) -> tuple[Floats, Floats]:
        """Search region for the mark of a free node: centre [m], (dim,), and covariance [m²], (dim, dim).

        shared: shift of the mark per standard deviation of each calibration error, see `MarkMeasurement`; None: zero
        Raises NetworkError for an unknown node and for an anchor.
        """
        residual = self._residual(node)
        rows, calibration = self._maps[node], self.process.parts.get("calibration")
        if shared is not None and calibration is not None:
            rows = rows.copy()
            rows[:, calibration] = shared
        covs = self.filter.times(rows) @ rows.T
        widest = max(self._possible, key=lambda k: float(covs[k].trace()))
        return rows @ self.filter.means[widest] + residual, covs[widest]

    def _residual(self, node: str) -> Floats:
        return self.residual_m[self.network.coordinates(node)]

    @property
    def _possible(self) -> list[int]:
        """Indices of the modes with a probability of at least `POSSIBLE`."""
        weights = self.filter.weights
        return [int(k) for k in np.flatnonzero(weights >= min(POSSIBLE, float(weights.max())))]

    def expected_after_impulse(self, node: str, shared: Floats | None = None) -> tuple[Floats, Floats]:
        """Search region from `expected`, enlarged by the distance that an impulse may have moved the node.

        Before the first marks and after a divergence, this distance is the extent of the body.
        """
        mean, cov = self.expected(node, shared)
        if self.seen_s is None or self.time_s is None or self.health.status is Status.DIVERGED:
            reach = self._reach_m
        else:
            since_s = self.time_s - self._seen_s.get(node, self.time_s)
            reach = self.settings.impulse_m_s * min(since_s, self.settings.impulse_s)
        return mean, cov + reach**2 * np.eye(len(mean))

    def expected_at_rest(self, nodes: Sequence[str]) -> tuple[Floats, Floats]:
        """Search regions for the first marks of n nodes: centres [m], (n, dim), and covariances [m²], (n, dim, dim)."""
        prior = self.process.prior(self.level.level)[1][0]
        covs = [rows @ prior @ rows.T for rows in (self._maps[node] for node in nodes)]
        return self.rest[[self.network.index(node) for node in nodes]], BESIDE * np.array(covs)

    def expected_of(self, nodes: Sequence[str]) -> tuple[Floats, Floats]:
        """Search regions for the marks of n free nodes: centres [m], (n, dim), and covariances [m²], (n, dim, dim)."""
        dim, possible = self.network.dim, self._possible
        rows = np.vstack([self._maps[node] for node in nodes])
        each = rows.reshape(len(nodes), dim, -1).transpose(0, 2, 1)
        covs = self.filter.times(rows)[possible].reshape(len(possible), len(nodes), dim, -1) @ each
        widest = covs.trace(axis1=2, axis2=3).argmax(axis=0)
        means = (self.filter.means[possible] @ rows.T).reshape(len(possible), len(nodes), dim)
        one_each = np.arange(len(nodes))
        beside = np.array([self._residual(node) for node in nodes]) if self.residual_m.any() else 0.0
        return means[widest, one_each] + beside, covs[widest, one_each]
