"""The filter of the tissue: unscented filters of its equations of motion, mixed by how they explain the marks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynamics import (
    SAME_STEP,
    MassSpringNetwork,
    NetworkError,
    ParameterUncertainty,
    equilibrium_with_held,
    pack,
    rest_shape,
    stiffness_matrix,
)
from estimators.arrays import Floats
from estimators.filters.adaptation import VarianceScale
from estimators.filters.mixture import InteractingMixture, Move
from estimators.filters.unscented import UnscentedKalmanFilter
from estimators.tissue.belief import GaussianMixture
from estimators.tissue.estimate import MarkMeasurement, Status, TargetEstimate
from estimators.tissue.health import Health, after_frame
from estimators.tissue.known_force import ForceHistory, KnownForce
from estimators.tissue.open_loop_cov import OpenLoopCovariance
from estimators.tissue.process_model import ForceMode, TissueModel, accumulated_noise
from estimators.tissue.settings import N_QUIET, FilterSettings, stationary

DOUBT = 10.0
"""Factor on the covariance of a start that is added to a belief which was refuted by ten sigma; chosen."""

MODEL_ONLY = 0.5
"""Part of the variance that the target has without any marks, above which the model alone speaks; chosen."""


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """All that a filter knows at one time, for going back to it."""

    time_s: float | None
    beliefs: tuple[tuple[Floats, Floats], ...]
    columns: Floats
    mu: Floats
    mean: Floats
    cov: Floats
    health: Health
    marks_seen_s: dict[str, float]
    off_s: dict[str, float]
    repairs: Counter[str]
    refused: Counter[str]
    updated_s: float | None
    refuted_s: float | None
    open_loop: Floats
    marks_scale: tuple[float, float]
    log_likelihood: float


class TissueFilter:
    """Where the target is: unscented filters of the tissue, calm, between pokes and poked, mixed by what the marks say.

    target: where its position stands in the state
    n_calibration: how many directions the `shared` of marks has, if what they make of them, the camera's calibration
        being off, is to be the same in every frame and considered; at 0 it is taken to be drawn anew in each
    State: mixture (the bank of filters); time_s, of the state, None before the first frame; health; when each mark was
    last taken in and since when it has been refused; counts of what was refused, by node or `fix` (refused), and of
    what was mended (repairs): sigma points `narrowed`, covariances made `definite`, beliefs `doubted` after a
    divergence, `restarted` after another or a loss; open_loop, how sure the paper's method has reason to be;
    marks_scale, what the marks' variances are multiplied by; log_likelihood, of the marks of the last update, where
    one that was refused counts as if at the gate; 0 at a start.
    """

    def __init__(
        self,
        network: MassSpringNetwork,
        target: str,
        marked: Sequence[str],
        settings: FilterSettings | None = None,
        *,
        uncertainty: ParameterUncertainty | None = None,
        n_calibration: int = 0,
    ) -> None:
        self.settings = FilterSettings() if settings is None else settings
        self.n_calibration = n_calibration
        self.model = TissueModel(
            network, marked, uncertainty=uncertainty, bias=self.settings.fix_bias, n_calibration=n_calibration
        )
        self.time_s: float | None = None
        self._updated_s: float | None = None
        self._refuted_s: float | None = None
        self._noises: tuple[float, dict[ForceMode, Floats]] | None = None
        self.health = Health()
        self.refused: Counter[str] = Counter()
        self._off_s: dict[str, float] = {}
        self._marks_seen_s: dict[str, float] = {}
        self.target = network.coordinates(target)
        self._marked = tuple(marked)
        self._places = {name: network.coordinates(name) for name in (network.names[i] for i in network.free)}
        self._rest = rest_shape(network)
        rates, self._modes = self.settings.rates, self.settings.modes
        if self.settings.one_of not in (0, len(marked)):
            raise ValueError(f"settings one_of: expected 0 or {len(marked)} marked nodes, found {self.settings.one_of}")
        filters = [UnscentedKalmanFilter(self.model.dim_x, lambda _points, _dt: _points) for _ in self._modes]
        move = Move(
            points=self._propagated,
            columns=lambda means, columns, dt: self.model.carried(means, columns, dt, self._modes),
            turned=self.model.turned,
        )
        self.mixture = InteractingMixture(filters, stationary(rates), rates, move)
        self._start_from(self._rest)
        self._start_cov = self.mixture.filters[0].P.copy()
        self._alone_m2 = float(np.trace(self.mixture.P[self.target, self.target]))
        self.open_loop = OpenLoopCovariance(
            network, target, [n for n in marked if n != target], self.settings.quiet.white
        )
        self.marks_scale = VarianceScale(self.settings.marks_bounds)
        self.log_likelihood = 0.0

    @property
    def repairs(self) -> Counter[str]:
        """How often what was mended."""
        return self.mixture.repairs

    @property
    def seen_s(self) -> float | None:
        """When a mark was last taken in [s], None before the first."""
        return None if self.health.since_s is None else self.health.seen_s

    def _start_from(self, shape: Floats) -> None:
        """Believe the tissue to stand in this shape of all nodes [m], (n_nodes, dim), unsure as settle_s says."""
        network = self.model.network
        mean = np.zeros(self.model.dim_x)
        mean[: network.n_state] = pack(shape[network.free], np.zeros_like(shape[network.free]))
        A, density = self.model.linearised(shape, self.settings.poked)
        cov = accumulated_noise(A, density, self.settings.settle_s)
        if self.settings.fix_bias is not None:
            cov[self.model.bias_rows, self.model.bias_rows] = self.settings.fix_bias.sd_m**2 * np.eye(network.dim)
        self.mixture.restart(mean, cov, self.model.resting_columns(shape))

    def snapshot(self) -> Snapshot:
        """All that the filter knows now, for `restore`."""
        mixture = self.mixture
        return Snapshot(
            self.time_s,
            tuple((f.x, f.P) for f in mixture.filters),
            mixture.columns,
            mixture.mu,
            mixture.x,
            mixture.P,
            self.health,
            self._marks_seen_s.copy(),
            self._off_s.copy(),
            self.repairs.copy(),
            self.refused.copy(),
            self._updated_s,
            self._refuted_s,
            self.open_loop.cov,
            (self.marks_scale.scale, self.marks_scale.information),
            self.log_likelihood,
        )

    def restore(self, then: Snapshot) -> None:
        """Know again what was known then, and nothing since."""
        mixture = self.mixture
        for f, (x, P) in zip(mixture.filters, then.beliefs, strict=True):
            f.x, f.P = x, P
        mixture.columns, mixture.mu, mixture.x, mixture.P = then.columns, then.mu, then.mean, then.cov
        self.time_s, self.health = then.time_s, then.health
        self._marks_seen_s, self._off_s = then.marks_seen_s.copy(), then.off_s.copy()
        mixture.repairs, self.refused = then.repairs.copy(), then.refused.copy()
        self._updated_s, self._refuted_s, self.open_loop.cov = then.updated_s, then.refuted_s, then.open_loop
        self.marks_scale.scale, self.marks_scale.information = then.marks_scale
        self.log_likelihood = then.log_likelihood

    def predict(self, time_s: float, push: ForceHistory | None = None) -> None:
        """Move the state to this exposure time [s]; raises ValueError where time goes back or is not finite.

        push: a known force that acts meanwhile, a needle's say; see `ForceHistory`
        """
        if not np.isfinite(time_s):
            raise ValueError(f"time_s: expected a finite time, found {time_s}")
        if self.time_s is not None:
            dt = time_s - self.time_s
            if dt < 0:
                raise ValueError(f"time_s: expected {self.time_s} or later, found {time_s}")
            if dt > 0:
                self._advance(dt, push)
        self.time_s = time_s

    def _propagated(self, points: Floats, dt: float) -> Floats:
        if self.model.push is not None:
            self.model.push.step(dt)
        return self.model.propagate_each(points, dt, self._modes)

    def _advance(self, dt: float, push: ForceHistory | None) -> None:
        n = max(1, int(np.ceil(dt / self.settings.mix_s * (1.0 - SAME_STEP))))
        step = dt / n / self.model.stepper.n_steps(dt / n)
        # to a nanosecond: frames at one rate differ by rounding, and their noise does not
        key = round(step, 9)
        if self._noises is None or self._noises[0] != key:
            self._noises = key, {mode: self.model.noise(step, mode) for mode in set(self._modes)}
        for f, mode in zip(self.mixture.filters, self._modes, strict=True):
            f.Q = self._noises[1][mode]
        if push is not None and self.time_s is not None:
            self.model.push = KnownForce(push, self.model.network, self.time_s)
        try:
            for _ in range(n):
                self.mixture.predict(dt / n, step)
        finally:
            self.model.push = None

    def predict_at(self, time_s: float, push: ForceHistory | None = None) -> TargetEstimate:
        """What is believed now of the target at a later time [s], when the needle arrives, say; the filter stays.

        push: a known force that acts until then; see `ForceHistory`
        Raises ValueError before the first frame, and for a time that is past or not finite.
        """
        if self.time_s is None or not self.time_s <= time_s < np.inf:
            raise ValueError(f"time_s: expected {self.time_s} or later, found {time_s}")
        now = self.snapshot()
        try:
            if time_s > self.time_s:
                self._advance(time_s - self.time_s, push)
            return self._estimate(time_s, 0, None)
        finally:
            self.restore(now)

    def predict_modes(self, time_s: float, push: ForceHistory | None = None) -> GaussianMixture:
        """As `predict_at`, of each mode of now and each of then by itself, n_modes² Gaussians.

        Nearer to the truth where a poke may have begun or ended and may not have: to merge those that go on in one mode
        would give the one that knows well the spread of the one that does not. Costs n_modes times `predict_at`.
        """
        if self.time_s is None or not self.time_s <= time_s < np.inf:
            raise ValueError(f"time_s: expected {self.time_s} or later, found {time_s}")
        now, mixture, parts = self.snapshot(), self.mixture, []
        try:
            for k, (mean, cov) in enumerate(now.beliefs):
                mixture.mu = np.eye(len(now.mu))[k]
                mixture.restart(mean, cov, now.columns[k])
                if time_s > self.time_s:
                    self._advance(time_s - self.time_s, push)
                modes, columns = mixture.beliefs(), mixture.columns[:, self.target]
                covs = modes.covs[:, self.target, self.target] + columns @ columns.swapaxes(1, 2)
                parts.append((now.mu[k] * modes.mu, modes.means[:, self.target], covs))
        finally:
            self.restore(now)
        weights, means, covs = (np.concatenate(each) for each in zip(*parts, strict=True))
        return GaussianMixture(weights / weights.sum(), means, covs)

    def predict_path(self, times_s: Floats) -> tuple[Floats, Floats]:
        """What is believed now of the target at later times [s], (k,): means [m] (k, dim), covs [m²] (k, dim, dim).

        One way through all of them; the filter stays. As `predict_at` of each, but for where its steps begin: modes
        are mixed at each of these times, too. Raises ValueError as that does, and for times that go back.
        """
        times = np.asarray(times_s, dtype=float)
        if self.time_s is None or not len(times) or not self.time_s <= times[0] <= times[-1] < np.inf:
            raise ValueError(f"times_s: expected {self.time_s} or later, found {times}")
        steps = np.diff(times, prepend=self.time_s)
        if not (steps >= 0.0).all():
            raise ValueError(f"times_s: expected times that rise, found {times}")
        dim = self.model.network.dim
        means, covs = np.empty((len(times), dim)), np.empty((len(times), dim, dim))
        now = self.snapshot()
        try:
            for k, dt in enumerate(steps):
                if dt > 0.0:
                    self._advance(dt, None)
                means[k] = self.mixture.x[self.target]
                covs[k] = self.mixture.P[self.target, self.target]
        finally:
            self.restore(now)
        return means, covs

    def expected(self, node: str, shared: Floats | None = None) -> tuple[Floats, Floats]:
        """Where to look for a free node's mark [m], (dim,), and the covariance of that [m²], (dim, dim).

        shared: what the calibration being off moves the mark by, as `MarkMeasurement.shared`; None for the node itself
        The belief of the poked mode, not of the mixture: a poke that begins is improbable before it is seen, and a gate
        drawn by the mixture would shut out the very marks that show it.
        """
        place, filters = self._places[node], self.mixture.filters
        poked = max(range(N_QUIET, len(filters)), key=lambda mode: float(np.trace(filters[mode].P[place, place])))
        columns = self.mixture.columns[poked][place]
        if shared is not None:
            columns = columns + self._among_columns(shared)
        return filters[poked].x[place].copy(), filters[poked].P[place, place] + columns @ columns.T

    def expected_after_impulse(self, node: str, shared: Floats | None = None) -> tuple[Floats, Floats]:
        """As `expected`, were the node struck just after its mark was last taken in.

        Before the first marks a node may be anywhere in the network's reach.
        """
        mean, cov = self.expected(node, shared)
        if self.seen_s is None or self.time_s is None:
            off = float(np.ptp(self._rest, axis=0).max())
        else:
            since_s = self.time_s - self._marks_seen_s.get(node, self.time_s)
            off = self.settings.impulse_m_s * min(since_s, self.settings.impulse_s)
        return mean, cov + off**2 * np.eye(len(mean))

    def expected_at_rest(self, node: str) -> tuple[Floats, Floats]:
        """As `expected`, were nothing known but where a free node rests; in doubt of that, too."""
        place = self._places[node]
        return self._rest[self.model.network.index(node)].copy(), DOUBT * self._start_cov[place, place]

    def update(self, marks: Sequence[MarkMeasurement]) -> TargetEstimate:
        """Take in the marks that were seen at the state's time, any number of them, and say where the target is.

        Raises ValueError for a mark that is not on a free node or has another dimension.
        """
        if self.time_s is None:
            raise ValueError("update: expected predict(time_s) before, found no time")
        self._check(marks)
        dt = 0.0 if self._updated_s is None else self.time_s - self._updated_s
        self._updated_s = self.time_s
        if self.marks_scale.scale != 1.0:
            marks = [replace(mark, cov=self.marks_scale.scale * mark.cov) for mark in marks]
        anew = self.health.since_s is None or self.health.status is Status.LOST
        self.log_likelihood = 0.0
        taken = list(marks) if anew else self._gated(self.time_s, marks)
        self.open_loop.take(dt, {mark.node: mark.total_cov for mark in taken if self._places[mark.node] != self.target})
        if not taken:
            self.health = after_frame(self.health, self.time_s, None, 0, self.settings)
            return self._estimate(self.time_s, 0, None)
        z, rows, R, shared = self._stacked(taken)
        H = np.zeros((len(rows), self.model.dim_x))
        H[range(len(rows)), rows] = 1.0
        before = self.mixture.P
        y, S, cross = z - self.mixture.x[rows], before[np.ix_(rows, rows)] + R, before[self.target, rows]
        if shared is not None:
            columns = np.einsum("k,kij->ij", self.mixture.mu, self.mixture.columns)
            S += columns[rows] @ shared.T + shared @ columns[rows].T + shared @ shared.T
            cross += columns[self.target] @ shared.T
        told = np.linalg.inv(S)
        nis = float(y @ told @ y)
        if anew:
            if self.health.since_s is not None:
                self.repairs["restarted"] += 1
            self._start_at(taken)
            self._marks_seen_s = dict.fromkeys(self._marked, self.time_s)
            self.health = after_frame(self.health, self.time_s, 0.0, 0, self.settings)
            return self._estimate(self.time_s, len(taken), nis)
        self.mixture.update_linear(z, H, R, shared)
        self.log_likelihood += self.mixture.log_likelihood
        if self.settings.marks_bounds != (1.0, 1.0):
            self.marks_scale.learn(y, R / self.marks_scale.scale, S - R, dt)
        least = min(f.nis for f in self.mixture.filters)
        self.health = after_frame(self.health, self.time_s, least, len(z), self.settings)
        if self.health.status is Status.DIVERGED and not self.health.innovations:
            again = self._refuted_s is not None and self.time_s - self._refuted_s <= self.settings.settle_s
            self._refuted_s = self.time_s
            self._inflated(taken, again=again)
        self._marks_seen_s |= dict.fromkeys((mark.node for mark in taken), self.time_s)
        return self._estimate(self.time_s, len(taken), nis, self._carried(cross @ told, told, taken))

    def fix(self, position: Floats, cov: Floats) -> TargetEstimate:
        """Take in a direct sighting of the target at the state's time: position [m], (dim,), its covariance [m²].

        What fixes are off by together is estimated beside it where the settings have a fix_bias. A fix beyond the gate
        is refused once; the next one that is off, too, is believed. Raises ValueError for another dimension.
        """
        dim = self.model.network.dim
        if self.time_s is None:
            raise ValueError("fix: expected predict(time_s) before, found no time")
        if np.shape(position) != (dim,) or np.shape(cov) != (dim, dim):
            raise ValueError(
                f"fix: expected shapes {(dim,)} and {(dim, dim)}, found {np.shape(position)}, {np.shape(cov)}"
            )
        H = np.zeros((dim, self.model.dim_x))
        H[range(dim), range(self.target.start, self.target.stop)] = 1.0
        if self.settings.fix_bias is not None:
            H[range(dim), range(self.model.bias_rows.start, self.model.bias_rows.stop)] = 1.0
        y = np.asarray(position) - H @ self.mixture.x
        nis = float(y @ np.linalg.solve(H @ self.mixture.P @ H.T + cov, y))
        if nis > self.settings.gate and "fix" not in self._off_s:
            self._off_s["fix"] = self.time_s
            self.refused["fix"] += 1
        else:
            self._off_s.pop("fix", None)
            self.mixture.update_linear(np.asarray(position, dtype=float), H, np.asarray(cov, dtype=float))
        return self._estimate(self.time_s, 0, nis)

    def _gated(self, time_s: float, marks: Sequence[MarkMeasurement]) -> list[MarkMeasurement]:
        """The marks that are where a blow could have brought them, or that have been off for longer than stubborn_s.

        Outliers pass; what stays away is the tissue. Each refusal is counted in `refused`.
        """
        taken = []
        for mark in marks:
            if self._distance(mark) <= self.settings.gate:
                self._off_s.pop(mark.node, None)
            elif time_s - self._off_s.setdefault(mark.node, time_s) <= self.settings.outlier_s:
                self.refused[mark.node] += 1
                S = self.expected_after_impulse(mark.node)[1] + mark.total_cov
                self.log_likelihood -= 0.5 * (self.settings.gate + float(np.linalg.slogdet(2.0 * np.pi * S)[1]))
                continue
            taken.append(mark)
        return taken

    def _distance(self, mark: MarkMeasurement) -> float:
        """Squared Mahalanobis distance of a mark from where the node may be, had it been struck."""
        known = mark.shared if self.n_calibration else None
        mean, cov = self.expected_after_impulse(mark.node, known)
        y = mark.position - mean
        return float(y @ np.linalg.solve(cov + (mark.total_cov if known is None else mark.cov), y))

    def _check(self, marks: Sequence[MarkMeasurement]) -> None:
        dim = self.model.network.dim
        for mark in marks:
            if mark.node not in self._places:
                raise ValueError(
                    f"mark {mark.node}: expected one on a free node of the network, found none of that name"
                )
            if len(mark.position) != dim:
                raise ValueError(f"mark {mark.node} position: expected shape {(dim,)}, found {mark.position.shape}")
            if self.n_calibration and mark.shared is not None and mark.shared.shape[1] != self.n_calibration:
                raise ValueError(
                    f"mark {mark.node} shared: expected {self.n_calibration} directions, found {mark.shared.shape[1]}"
                )

    def _among_columns(self, shared: Floats) -> Floats:
        """What the calibration moves marks by, (m, n_calibration), with the columns that move none before it."""
        return np.hstack([np.zeros((len(shared), self.model.n_constants)), shared])

    def _estimate(
        self, time_s: float, marks_used: int, nis: float | None, carried: dict[str, float] | None = None
    ) -> TargetEstimate:
        cov = self.mixture.P[self.target, self.target].copy()
        open_loop_m2 = float(np.trace(self.open_loop.target_cov))
        unseen_s = np.inf if self.seen_s is None else time_s - self.seen_s
        return TargetEstimate(
            time_s=time_s,
            mean=self.mixture.x[self.target].copy(),
            cov=cov,
            status=self.health.status,
            marks_used=marks_used,
            nis=nis,
            poked=self.settings.poked_share(self.mixture.mu),
            model_only=unseen_s > self.settings.lost_s or float(np.trace(cov)) > MODEL_ONLY * self._alone_m2,
            gain=None if open_loop_m2 <= 0.0 else 1.0 - float(np.trace(cov)) / open_loop_m2,
            carried={} if carried is None else carried,
        )

    def _carried(self, gain: Floats, told: Floats, marks: Sequence[MarkMeasurement]) -> dict[str, float]:
        """By node, by how much the target's variance would be larger had that mark been left out of this frame.

        gain: the target's, (dim, m); told: inverse of the innovations' covariance, (m, m); the mixture's, as if it were
        one Gaussian. Leaving out block i gives back G_i (told_ii)^-1 G_i' of what the update took.
        """
        left = float(np.trace(self.mixture.P[self.target, self.target]))
        dim = self.model.network.dim
        carried = {}
        for k, mark in enumerate(marks):
            own = slice(k * dim, (k + 1) * dim)
            carried[mark.node] = float(np.sum(gain[:, own] * np.linalg.solve(told[own, own], gain[:, own].T).T)) / left
        return carried

    def _stacked(self, marks: Sequence[MarkMeasurement]) -> tuple[Floats, list[int], Floats, Floats | None]:
        """Positions of the marks, their rows of the state, and their covariance: (m,), m, (m, m).

        And what each column moves them by, (m, n_columns), where a calibration is considered; else None.
        """
        z = np.concatenate([mark.position for mark in marks])
        rows = [i for mark in marks for i in range(self._places[mark.node].start, self._places[mark.node].stop)]
        R, dim = np.zeros((len(z), len(z))), self.model.network.dim
        for k, mark in enumerate(marks):
            own = slice(k * dim, (k + 1) * dim)
            R[own, own] = mark.cov
        if self.n_calibration:
            none = np.zeros((dim, self.n_calibration))
            shared = np.concatenate([none if mark.shared is None else mark.shared for mark in marks])
            return z, rows, R, self._among_columns(shared)
        if all(mark.shared is not None for mark in marks):
            shared = np.concatenate([mark.shared for mark in marks if mark.shared is not None])
            R += shared @ shared.T
        return z, rows, R, None

    def _inflated(self, marks: Sequence[MarkMeasurement], *, again: bool) -> None:
        """What is done about a belief that these marks refuted, first, and when within settle_s the next one is, too.

        First it may have been a blow: the tissue is where it was believed to be, as unsure beside as at a start, and
        more. Then nothing is believed but that the tissue rests as the marks hold it, in greater doubt still.
        """
        if again:
            self.repairs["restarted"] += 1
            self._start_at(marks, doubt=DOUBT**2)
            return
        self.repairs["doubted"] += 1
        z, rows, R, shared = self._stacked(marks)
        H = np.zeros((len(rows), self.model.dim_x))
        H[range(len(rows)), rows] = 1.0
        columns = np.einsum("k,kij->ij", self.mixture.mu, self.mixture.columns)
        self.mixture.restart(self.mixture.x, self.mixture.P + DOUBT * self._start_cov, columns)
        self.mixture.update_linear(z, H, R, shared)

    def _start_at(self, marks: Sequence[MarkMeasurement], doubt: float = 1.0) -> None:
        """Believe the tissue to rest as these marks hold it; where it has no such rest, to rest, and take them in.

        Far from its rest shape a Kalman update would go along straight lines where the tissue turns. The shape in which
        it rests with the marked nodes held at z is a nonlinear estimate with the gain G = d(shape)/dz; its error is
        (I - G H) times that of the start, less G times that of the marks, and so are its covariance (Joseph's form) and
        columns.
        doubt: a factor on the covariance of the start.
        """
        network = self.model.network
        z, rows, R, shared = self._stacked(marks)
        try:
            shape = equilibrium_with_held(network, {mark.node: mark.position for mark in marks})
        except NetworkError:
            self._start_from(self._rest)
            H = np.zeros((len(rows), self.model.dim_x))
            H[range(len(rows)), rows] = 1.0
            self.mixture.update_linear(z, H, R, shared)
            return
        self._start_from(shape)
        K = stiffness_matrix(network, shape)
        others = [i for i in range(len(K)) if i not in set(rows)]
        G = np.zeros((self.model.dim_x, len(rows)))
        G[rows, range(len(rows))] = 1.0
        G[others] = -np.linalg.solve(K[np.ix_(others, others)], K[np.ix_(others, rows)])
        keep = np.eye(self.model.dim_x)
        keep[:, rows] -= G
        P = doubt * keep @ self.mixture.filters[0].P @ keep.T + G @ R @ G.T
        columns = self.model.resting_columns(shape, rows)
        if shared is not None:
            columns -= G @ shared
        self.mixture.restart(self.mixture.x, 0.5 * (P + P.T), columns)
