"""The filter of the tissue: unscented filters of its equations of motion, mixed by how they explain the marks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from dynamics import MassSpringNetwork, NetworkError, pack, rest_shape, shape_held, stiffness_matrix
from estimators.estimate import MarkMeasurement, Status, TargetEstimate
from estimators.mixture import InteractingMixture
from estimators.tissue_model import ForceMode, TissueModel, grown_covariance
from estimators.unscented import UnscentedKalmanFilter

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class FilterSettings:
    """What the filter assumes about forces it cannot see; every figure chosen, see `docs/decisions.md`.

    Three modes: calm, where nobody pokes; between, where somebody does but not now; poked. The first two believe the
    same of the force and differ in how soon a poke may come, so that the filter learns whether pokes are about.

    calm_s, between_s, poked_s: how long each lasts on average [s]
    calm_share: part of the pokes after which there is calm
    settle_s: the filter starts as unsure as the tissue would be after unseen pokes of this duration [s]
    startle_m_s, startle_s: a blow may change a node's velocity by this at once [m/s] and carry it on for so long [s]
        before the springs have it back; marks are looked for that far off
    gate: squared Mahalanobis distance beyond which a mark is refused once: chi-square, 2 degrees, one in 100,000
    lost_s: without any mark for longer than this the target counts as lost [s]
    mix_s: the modes are mixed at least this often [s]
    """

    quiet: ForceMode = ForceMode(white=0.05, poke=0.05, lasting_s=0.05)
    poked: ForceMode = ForceMode(white=0.05, poke=5.0, lasting_s=0.2)
    calm_s: float = 100.0
    between_s: float = 1.5
    poked_s: float = 0.3
    calm_share: float = 0.05
    settle_s: float = 1.0
    startle_m_s: float = 1.0
    startle_s: float = 0.05
    gate: float = 23.03
    lost_s: float = 1.0
    mix_s: float = 1.0 / 30.0

    @property
    def modes(self) -> tuple[ForceMode, ...]:
        """What calm, between and poked believe of the force."""
        return (self.quiet, self.quiet, self.poked)

    @property
    def rates(self) -> Floats:
        """How often each mode turns into each other [1/s], (3, 3), rows summing to zero."""
        end = 1.0 / self.poked_s
        rates = np.array(
            [
                [0.0, 0.0, 1.0 / self.calm_s],
                [0.0, 0.0, 1.0 / self.between_s],
                [self.calm_share * end, (1.0 - self.calm_share) * end, 0.0],
            ]
        )
        return rates - np.diag(rates.sum(axis=1))


def stationary(rates: Floats) -> Floats:
    """Long-run probability of each mode, (n,), of a chain with these rates [1/s], (n, n)."""
    n = len(rates)
    balance = np.vstack([rates.T, np.ones(n)])
    return np.linalg.lstsq(balance, np.r_[np.zeros(n), 1.0], rcond=None)[0]


class TissueFilter:
    """Where the target is: a quiet and a poked unscented filter of the tissue, mixed by what the marks say.

    State: mixture (the bank of filters); time_s, of the state, None before the first frame; when a mark was last taken
    in, any (seen_s) and each; how often each node's mark was refused (refused), and which in the last frame.
    """

    def __init__(
        self,
        network: MassSpringNetwork,
        target: str,
        marked: Sequence[str],
        settings: FilterSettings | None = None,
    ) -> None:
        self.settings = FilterSettings() if settings is None else settings
        self.model = TissueModel(network, marked)
        self.time_s: float | None = None
        self.seen_s: float | None = None
        self.refused: Counter[str] = Counter()
        self._off: set[str] = set()
        self._marks_seen_s: dict[str, float] = {}
        self._target = network.coordinates(target)
        self._marked = tuple(marked)
        self._places = {name: network.coordinates(name) for name in (network.names[i] for i in network.free)}
        self._rest = rest_shape(network)
        rates = self.settings.rates
        filters = [UnscentedKalmanFilter(self.model.dim_x, self._process(mode)) for mode in self.settings.modes]
        self.mixture = InteractingMixture(filters, stationary(rates), rates)
        self._start_from(self._rest)

    def _process(self, mode: ForceMode) -> Callable[[Floats, float], Floats]:
        return lambda points, dt: self.model.propagate(points, dt, mode)

    def _start_from(self, shape: Floats) -> None:
        """Believe the tissue to stand in this shape of all nodes [m], (n_nodes, dim), unsure as settle_s says."""
        network = self.model.network
        mean = np.zeros(self.model.dim_x)
        mean[: network.n_state] = pack(shape[network.free], np.zeros_like(shape[network.free]))
        A, density = self.model.linearised(shape, self.settings.poked)
        cov = grown_covariance(A, density, self.settings.settle_s)
        self.mixture.restart(mean, cov)

    def predict(self, time_s: float) -> None:
        """Move the state to this exposure time [s]; raises ValueError where time goes back or is not finite."""
        if not np.isfinite(time_s):
            raise ValueError(f"time_s: expected a finite time, found {time_s}")
        if self.time_s is not None:
            dt = time_s - self.time_s
            if dt < 0:
                raise ValueError(f"time_s: expected {self.time_s} or later, found {time_s}")
            if dt > 0:
                self._advance(dt)
        self.time_s = time_s

    def _advance(self, dt: float) -> None:
        n = max(1, int(np.ceil(dt / self.settings.mix_s - 1e-9)))
        step = dt / n / self.model.stepper.n_steps(dt / n)
        noises = {mode: self.model.noise(step, mode) for mode in set(self.settings.modes)}
        for f, mode in zip(self.mixture.filters, self.settings.modes, strict=True):
            f.Q = noises[mode]
        for _ in range(n):
            self.mixture.predict(dt / n, step)

    def predict_at(self, time_s: float) -> TargetEstimate:
        """What is believed now of the target at a later time [s], when the needle arrives, say; the filter stays.

        Raises ValueError before the first frame, and for a time that is past or not finite.
        """
        if self.time_s is None or not self.time_s <= time_s < np.inf:
            raise ValueError(f"time_s: expected {self.time_s} or later, found {time_s}")
        mixture = self.mixture
        kept = [(f.x, f.P) for f in mixture.filters], mixture.mu, mixture.x, mixture.P
        try:
            if time_s > self.time_s:
                self._advance(time_s - self.time_s)
            return self._estimate(time_s, self._status(), 0, None)
        finally:
            beliefs, mixture.mu, mixture.x, mixture.P = kept
            for f, (x, P) in zip(mixture.filters, beliefs, strict=True):
                f.x, f.P = x, P

    def expected(self, node: str) -> tuple[Floats, Floats]:
        """Where to look for a free node's mark [m], (dim,), and the covariance of that [m²], (dim, dim).

        The belief of the poked mode, not of the mixture: a poke that begins is improbable before it is seen, and a gate
        drawn by the mixture would shut out the very marks that show it.
        """
        place, poked = self._places[node], self.mixture.filters[-1]
        return poked.x[place].copy(), poked.P[place, place].copy()

    def struck(self, node: str) -> tuple[Floats, Floats]:
        """As `expected`, were the node struck just after its mark was last taken in.

        Before the first marks a node may be anywhere in the network's reach.
        """
        mean, cov = self.expected(node)
        if self.seen_s is None or self.time_s is None:
            off = float(np.ptp(self._rest, axis=0).max())
        else:
            since_s = self.time_s - self._marks_seen_s.get(node, self.time_s)
            off = self.settings.startle_m_s * min(since_s, self.settings.startle_s)
        return mean, cov + off**2 * np.eye(len(mean))

    def update(self, marks: Sequence[MarkMeasurement]) -> TargetEstimate:
        """Take in the marks that were seen at the state's time, any number of them, and say where the target is.

        Raises ValueError for a mark that is not on a free node or has another dimension.
        """
        if self.time_s is None:
            raise ValueError("update: expected predict(time_s) before, found no time")
        self._check(marks)
        taken = marks if self.seen_s is None else self._believable(marks)
        nis = None
        if taken:
            z, rows, R = self._stacked(taken)
            H = np.zeros((len(rows), self.model.dim_x))
            H[range(len(rows)), rows] = 1.0
            y, S = z - H @ self.mixture.x, H @ self.mixture.P @ H.T + R
            nis = float(y @ np.linalg.solve(S, y))
            started = self.seen_s is None and self._started(taken, rows, R)
            if not started:
                self.mixture.update_linear(z, H, R)
            if self.seen_s is None:
                self._marks_seen_s = dict.fromkeys(self._marked, self.time_s)
            self.seen_s = self.time_s
            self._marks_seen_s |= dict.fromkeys((mark.node for mark in taken), self.time_s)
        return self._estimate(self.time_s, self._status(), len(taken), nis)

    def _believable(self, marks: Sequence[MarkMeasurement]) -> list[MarkMeasurement]:
        """The marks that are where a blow could have brought them, or that were off in the frame before, too.

        An outlier comes alone; what stays away is the tissue. Each refusal is counted in `refused`.
        """
        off = {mark.node for mark in marks if self._distance(mark) > self.settings.gate}
        refused = off - self._off
        self._off = refused
        self.refused.update(refused)
        return [mark for mark in marks if mark.node not in refused]

    def _distance(self, mark: MarkMeasurement) -> float:
        """Squared Mahalanobis distance of a mark from where the node may be, had it been struck."""
        mean, cov = self.struck(mark.node)
        y = mark.position - mean
        return float(y @ np.linalg.solve(cov + mark.cov, y))

    def _check(self, marks: Sequence[MarkMeasurement]) -> None:
        dim = self.model.network.dim
        for mark in marks:
            if mark.node not in self._places:
                raise ValueError(
                    f"mark {mark.node}: expected one on a free node of the network, found none of that name"
                )
            if len(mark.position) != dim:
                raise ValueError(f"mark {mark.node} position: expected shape {(dim,)}, found {mark.position.shape}")

    def _estimate(self, time_s: float, status: Status, marks_used: int, nis: float | None) -> TargetEstimate:
        return TargetEstimate(
            time_s=time_s,
            mean=self.mixture.x[self._target].copy(),
            cov=self.mixture.P[self._target, self._target].copy(),
            status=status,
            marks_used=marks_used,
            nis=nis,
            poked=float(self.mixture.mu[-1]),
        )

    def _stacked(self, marks: Sequence[MarkMeasurement]) -> tuple[Floats, list[int], Floats]:
        """Positions of the marks, their rows of the state, and their covariance: (m,), m, (m, m)."""
        z = np.concatenate([mark.position for mark in marks])
        rows = [i for mark in marks for i in range(self._places[mark.node].start, self._places[mark.node].stop)]
        return z, rows, block_diag(*(mark.cov for mark in marks))

    def _started(self, marks: Sequence[MarkMeasurement], rows: list[int], R: Floats) -> bool:
        """Believe the tissue to rest as the first marks hold it; False, and nothing is done, where it has no such rest.

        Far from its rest shape a Kalman update would go along straight lines where the tissue turns. The shape in which
        it rests with the marked nodes held at z is a nonlinear estimate with the gain G = d(shape)/dz; its error is
        (I - G H) times that of the start, less G times that of the marks, and so is its covariance (Joseph's form).
        """
        network = self.model.network
        try:
            shape = shape_held(network, {mark.node: mark.position for mark in marks})
        except NetworkError:
            return False
        self._start_from(shape)
        K = stiffness_matrix(network, shape)
        others = [i for i in range(len(K)) if i not in set(rows)]
        G = np.zeros((self.model.dim_x, len(rows)))
        G[rows, range(len(rows))] = 1.0
        G[others] = -np.linalg.solve(K[np.ix_(others, others)], K[np.ix_(others, rows)])
        keep = np.eye(self.model.dim_x)
        keep[:, rows] -= G
        P = keep @ self.mixture.P @ keep.T + G @ R @ G.T
        self.mixture.restart(self.mixture.x, 0.5 * (P + P.T))
        return True

    def _status(self) -> Status:
        if self.seen_s is None:
            return Status.LOST
        unseen = (self.time_s or 0.0) - self.seen_s
        if unseen == 0.0:
            return Status.TRACKING
        return Status.COASTING if unseen <= self.settings.lost_s else Status.LOST
