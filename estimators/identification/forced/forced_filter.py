"""An unscented filter of a network under pokes whose places, times and strengths are known, beside sensitivities.

Of a filter that takes forces for possible which do not act, velocities are noise of the marks. A dashpot, whose force
is a velocity, then seems stronger than it is: an error in the regressor, and an average over frames does not lessen it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from dynamics import MassSpringNetwork, ParameterUncertainty, pack
from estimators.arrays import Floats
from estimators.filters.kernels import joseph_update, moments_each, regressions, symmetric_points_each
from estimators.filters.unscented import CovarianceError, positive_points
from estimators.identification.linear_filter import first_shape
from estimators.process.process_model import ForceMode, TissueModel, accumulated_noise
from estimators.tissue.estimate import MarkMeasurement
from estimators.tissue.settings import FilterSettings
from estimators.tissue.start import within_reach


@dataclass(frozen=True, slots=True)
class Poke:
    """A force on one marked node over some frames.

    place: of the node among the marked ones; first, last: frames at whose ends it acted
    level: standard deviation of the force by the node's mass, an axis [m/s²]
    """

    place: int
    first: int
    last: int
    level: float


@dataclass(frozen=True, slots=True)
class Forces:
    """The forces of a recording: pokes, and beside them white acceleration noise on every node.

    white: of every free node, always [m/s²/sqrt(Hz)]; marks: factor on the standard deviations of the marks [1]
    """

    white: float
    marks: float = 1.0
    pokes: tuple[Poke, ...] = ()

    def at(self, frame: int) -> tuple[tuple[int, float], ...]:
        """Place and level of each poke in this frame; of several on one node the strongest."""
        levels: dict[int, float] = {}
        for poke in self.pokes:
            if poke.first <= frame <= poke.last:
                levels[poke.place] = max(poke.level, levels.get(poke.place, 0.0))
        return tuple(sorted(levels.items()))


@cache
def forces_between(quiet: ForceMode, lasting_s: float, acting: tuple[tuple[int, float], ...]) -> tuple[ForceMode]:
    """The mode in which the nodes at these places are poked at these levels [m/s²], and the others are not."""
    mode = quiet
    for place, level in acting:
        mode = ForceMode(quiet.white, level, lasting_s, only=place, others=mode)
    return (mode,)


@dataclass(frozen=True, slots=True, eq=False)
class Belief:
    """Mean (dim_x,), covariance (dim_x, dim_x) and columns (dim_x, n) after a frame.

    mode: that led there, None at the start
    """

    x: Floats
    P: Floats
    columns: Floats
    mode: ForceMode | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Taken:
    """Marks of a frame that were taken in: innovation y (m,), its covariance S (m, m), sensitivities T (m, n).

    nis: of y [1]; log_likelihood: of the marks
    """

    y: Floats
    S: Floats
    T: Floats
    nis: float
    log_likelihood: float


@dataclass(frozen=True, slots=True, eq=False)
class Moved:
    """A motion from frame to frame, for a smoother: the belief before, mean and covariance after, the slope F."""

    before: Belief
    x: Floats
    P: Floats
    F: Floats


class ForcedFilter:
    """Unscented Kalman filter of a tissue model in one mode at a time, with the sensitivities of its error.

    scale, weights: of its sigma points, as `symmetric_points_each` and `moments_each` take them for one belief
    State: belief, None before the start; trace: None, or a list to which each motion adds its `Moved`.
    """

    def __init__(
        self,
        network: MassSpringNetwork,
        marked: Sequence[str],
        settings: FilterSettings,
        uncertainty: ParameterUncertainty | None = None,
    ) -> None:
        self.model = TissueModel(network, marked, uncertainty=uncertainty)
        self.settings = settings
        self.belief: Belief | None = None
        self.trace: list[Moved] | None = None
        points = positive_points(self.model.dim_x)
        self.weights = points.Wm[None], points.Wc[None]
        self.scale = np.array([points.alpha**2 * (points.n + points.kappa)])
        self._places = {name: network.coordinates(name) for name in (network.names[i] for i in network.free)}
        self._H: dict[tuple[str, ...], tuple[list[int], Floats]] = {}

    def start(self, marks: Sequence[MarkMeasurement]) -> None:
        """Begin where the marks hold the tissue, as uncertain beside as after pokes for lost_s.

        Raises CovarianceError without marks.
        """
        model, network = self.model, self.model.network
        shape = first_shape(network, marks)
        mean = np.zeros(model.dim_x)
        mean[: network.n_state] = pack(shape[network.free], np.zeros_like(shape[network.free]))
        moved = accumulated_noise(*model.linearised(shape, self.settings.poked), self.settings.lost_s)
        rows, H = self.rows(marks)
        z, R = stacked(marks, 1.0)
        columns = model.resting_columns(shape, rows)
        x, P, _, _, K, *_ = joseph_update(mean, within_reach(moved, network), z, H, R)
        self.belief = Belief(x, P, columns - K @ columns[rows])

    def advance(
        self, dt: float, mode: tuple[ForceMode], marks: Sequence[MarkMeasurement], factor: float
    ) -> Taken | None:
        """Move the belief dt [s] ahead in this mode, then take in the marks; None without any.

        factor: on the marks' standard deviations. Raises CovarianceError where there is no finite state.
        """
        if self.belief is None:
            raise ValueError("advance: expected start(marks) before, found no state")
        model = self.model
        before = self.belief if self.belief.mode == mode[0] else self.between_pokes(self.belief, mode[0])
        x, P, columns = before.x[None], before.P[None], before.columns[None]
        F = np.eye(model.dim_x)
        n_steps = model.stepper.n_steps(dt)
        Q = model.noise_of_modes(dt / n_steps, mode)[0][0][None]
        for _ in range(n_steps):
            points, definite = symmetric_points_each(x, P, self.scale)
            if not definite.all():
                raise CovarianceError("covariance: expected positive definite, found otherwise")
            columns = model.propagate_columns(x, columns, dt / n_steps, mode)
            moved = model.propagate_each(points, dt / n_steps, mode)
            if self.trace is not None:
                F = regressions(points, moved)[0] @ F
            x, P = moments_each(moved, *self.weights, Q)
        if self.trace is not None:
            self.trace.append(Moved(before, x[0], P[0], F))
        now = Belief(x[0], P[0], columns[0], mode[0])
        self.belief = now
        return self._taken(now, marks, factor) if marks else None

    def _taken(self, now: Belief, marks: Sequence[MarkMeasurement], factor: float) -> Taken:
        (rows, H), (z, R) = self.rows(marks), stacked(marks, factor)
        R = self._with_gate(now, rows, z, R)
        T = H @ now.columns
        x, P, y, S, K, nis, log_det, definite = joseph_update(now.x, now.P, z, H, R)
        if not (definite and np.isfinite(nis) and np.isfinite(log_det)):
            raise CovarianceError("innovation: expected a finite likelihood, found none")
        self.belief = replace(now, x=x, P=P, columns=now.columns - K @ T)
        return Taken(y, S, T, nis, -0.5 * (nis + log_det + len(z) * np.log(2.0 * np.pi)))

    def _with_gate(self, now: Belief, rows: list[int], z: Floats, R: Floats) -> Floats:
        """R (m, m) with marks beyond the gate as uncertain as puts them on it: no outlier leads, none is lost."""
        dim, gate = self.model.network.dim, self.settings.gate
        own = np.reshape(rows, (-1, dim))
        blocks = np.arange(len(rows)).reshape(-1, dim)
        y = (z - now.x[rows]).reshape(-1, dim, 1)
        S = now.P[own[:, :, None], own[:, None]] + R[blocks[:, :, None], blocks[:, None]]
        nis = (y * np.linalg.solve(S, y)).sum(axis=(1, 2))
        if (nis <= gate).all():
            return R
        widened = R.copy()
        for k in np.flatnonzero(nis > gate):
            widened[np.ix_(blocks[k], blocks[k])] += (nis[k] / gate - 1.0) * S[k]
        return widened

    def between_pokes(self, before: Belief, mode: ForceMode) -> Belief:
        """The belief as this mode follows another: pokes begin and end without a force."""
        model = self.model
        own = np.arange(model.pokes.start, model.pokes.stop)
        none = self.settings.quiet.poke * model.mass[model.poked_rows]
        now = model.force_noise(mode)[0]
        last = np.zeros_like(now) if before.mode is None else model.force_noise(before.mode)[0]
        x, P, columns = before.x, before.P, before.columns
        ends = own[(last != now) & (last > self.settings.quiet.poke)]
        if len(ends):
            H = np.zeros((len(ends), model.dim_x))
            H[range(len(ends)), ends] = 1.0
            x, P, _, _, K, *_ = joseph_update(x, P, np.zeros(len(ends)), H, np.diag(none[ends - own[0]] ** 2))
            columns = columns - K @ columns[ends]
        which = own[last != now]
        x, P, columns = x.copy(), P.copy(), columns.copy()
        x[which], P[which], P[:, which], columns[which] = 0.0, 0.0, 0.0, 0.0
        P[which, which] = none[last != now] ** 2
        return Belief(x, P, columns, mode)

    def rows(self, marks: Sequence[MarkMeasurement]) -> tuple[list[int], Floats]:
        """Rows of the state that these marks measure, and the matrix that picks them, (m, dim_x)."""
        names = tuple(mark.node for mark in marks)
        if names not in self._H:
            rows = [i for name in names for i in range(self._places[name].start, self._places[name].stop)]
            H = np.zeros((len(rows), self.model.dim_x))
            H[range(len(rows)), rows] = 1.0
            self._H[names] = rows, H
        return self._H[names]


def stacked(marks: Sequence[MarkMeasurement], factor: float) -> tuple[Floats, Floats]:
    """All marks' coordinates [m], (m,), and their covariance [m²], (m, m)."""
    dim = len(marks[0].position)
    R = np.zeros((len(marks) * dim, len(marks) * dim))
    for k, mark in enumerate(marks):
        R[k * dim : (k + 1) * dim, k * dim : (k + 1) * dim] = factor**2 * mark.total_cov
    return np.concatenate([mark.position for mark in marks]), R
