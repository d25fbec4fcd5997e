"""Prediction: the state moved on in time, the target at later times, and where marks are to be expected."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass

import numpy as np

from dynamics import MassSpringNetwork, all_positions
from estimators.arrays import Floats
from estimators.filters.gaussians import corrected_each, evened_each, inflated_each, pooled_each
from estimators.filters.kernels import mixed_each, with_columns
from estimators.filters.mixture import InteractingMixture
from estimators.filters.motion import LinearMotion, Move
from estimators.filters.noise_level import NoiseLevel
from estimators.filters.unscented import UnscentedKalmanFilter
from estimators.process.known_force import ForceHistory, KnownForce
from estimators.process.linear_motion import LinearisedTissue, is_linearised
from estimators.process.process_model import ForceMode, TissueModel
from estimators.process.target import TargetMap
from estimators.threads import one_blas_thread
from estimators.tissue.estimate import GaussianMixture
from estimators.tissue.model_error import UNDIRECTED, ModelError, Opinions
from estimators.tissue.settings import FilterSettings, stationary
from estimators.tissue.snapshot import unchanged


def propagate_points(model: TissueModel, points: Floats, dt: float, modes: Sequence[ForceMode]) -> Floats:
    """Sigma points of each mode, (n_modes, n_points, dim_x), dt [s] later; a known force goes on with them."""
    if model.push is not None:
        model.push.step(dt)
    return model.propagate_each(points, dt, modes)


@dataclass(frozen=True, slots=True, eq=False)
class MotionOfModes:
    """How the sigma points and columns of all modes move, for `Move`; a record, so that filters pickle and copy."""

    model: TissueModel
    modes: Sequence[ForceMode]

    def points(self, points: Floats, dt: float) -> Floats:
        """Sigma points (n_modes, n_points, dim_x), dt [s] later."""
        return propagate_points(self.model, points, dt, self.modes)

    def columns(self, means: Floats, columns: Floats, dt: float) -> Floats:
        """Columns (n_modes, dim_x, n_columns) about means (n_modes, dim_x), dt [s] later."""
        return self.model.propagate_columns(means, columns, dt, self.modes)


@dataclass(frozen=True, slots=True, eq=False)
class LinearisedCycle:
    """The motion of a linearised tissue over one cycle of dt [s], under these forces, about whatever states."""

    motion: LinearisedTissue
    dt: float
    modes: Sequence[ForceMode]
    push: KnownForce | None
    level: float

    def __call__(self, about: Floats) -> LinearMotion:
        """About states (n_modes, dim_x)."""
        return self.motion(about, self.dt, self.modes, copy(self.push), self.level)


@dataclass(frozen=True, slots=True, eq=False)
class LinearisedCycles:
    """For `Move.linear`: the motion of a linearised tissue over a cycle; a known force goes on with it."""

    motion: LinearisedTissue
    modes: Sequence[ForceMode]

    def __call__(self, dt: float, level: float) -> tuple[LinearisedCycle, int]:
        """The motion of the modes over the next dt [s], and in how many passes at most it may be asked for."""
        model = self.motion.model
        cycle = LinearisedCycle(self.motion, dt, self.modes, copy(model.push), level)
        if model.push is not None:
            model.push.step(dt)
        return cycle, self.motion.passes


def unmoved(points: Floats, _dt: float) -> Floats:
    """Sigma points as they are: what moves the filters of a mixture is its `Move`."""
    return points


def mixture_of_modes(model: TissueModel, settings: FilterSettings, modes: Sequence[ForceMode]) -> InteractingMixture:
    """A filter for each mode of the settings, at the long-run odds of their chain.

    modes: those of the settings, made once: what was worked out for them is known again by the tuple itself
    """
    filters = [UnscentedKalmanFilter(model.dim_x, unmoved) for _ in modes]
    for f in filters:
        f.P[model.slow, model.slow] = np.diag(model.slow_sd**2)
    motion = MotionOfModes(model, modes)
    linear = LinearisedCycles(LinearisedTissue(model), modes) if is_linearised(model) else None
    move = Move(motion.points, motion.columns, model.turned, linear)
    mixture = InteractingMixture(filters, stationary(settings.rates), settings.rates, move, settings.of_state)
    mixture.onset = onset_of(model, modes)
    if settings.white_bounds != (1.0, 1.0):
        mixture.level = NoiseLevel(settings.white_bounds, model.dim_x)
    return mixture


def onset_of(model: TissueModel, modes: Sequence[ForceMode]) -> Floats:
    """Variance of each state by the forces of each mode, (n_modes, dim_x): of the pokes alone."""
    found = np.zeros((len(modes), model.dim_x))
    for own, mode in zip(found, modes, strict=True):
        own[model.pokes] = (model.force_noise(mode)[0] * model.mass[model.poked_rows]) ** 2
    return found


def advance(
    mixture: InteractingMixture,
    model: TissueModel,
    modes: Sequence[ForceMode],
    dt: float,
    *,
    mix_s: float,
    push: KnownForce | None = None,
) -> None:
    """Move every mode ahead by dt [s], more than 0, mixed about every mix_s [s], under a known force if given."""
    n = max(1, round(dt / mix_s))
    step = dt / n / model.stepper.n_steps(dt / n)
    if mixture.move.linear is None:
        noises = model.noise_of_modes(step, modes)
        level = mixture.noise_level
        for f, (Q, white) in zip(mixture.filters, noises, strict=True):
            f.Q = Q if level == 1.0 else Q + (level - 1.0) * white
        mixture.white = level * noises[0][1]
    model.push = push
    try:
        for _ in range(n):
            mixture.predict(dt / n, step)
    finally:
        model.push = None


def known_force(push: ForceHistory | None, model: TissueModel, time_s: float | None) -> KnownForce | None:
    """A push as it begins at this time [s]; None where there is none, or no time yet."""
    return None if push is None or time_s is None else KnownForce(push, model.network, time_s)


def reported_place(mixture: InteractingMixture, target: TargetMap, model_error: ModelError) -> tuple[Floats, Floats]:
    """Mean [m], (dim,), and covariance [m²], (dim, dim), of a target, with what marks show of the model's error."""
    if not model_error.is_looked_for:
        return place_and_cov(mixture, target)
    if target.error_rows is not None:  # the field has the node's place, not the target's
        with reported(mixture, target, model_error):
            return place_and_cov(mixture, target)
    modes, found = mixture.beliefs(), model_error.of_target(target, mixture.x, mixture.P)
    own = target.position(modes.means), target.cov(modes.covs), target.linear(mixture.columns)
    ahead, H = target.linear(found.ahead[:, None])[:, 0], np.eye(len(target.constant))
    means, covs, columns = mixed_each(modes.mu[:, None], *_beside(modes.mu, own, found, ahead, found.place, H))
    return means[0], target.within_reach(with_columns(covs[0], columns[0]))


def place_and_cov(mixture: InteractingMixture, target: TargetMap) -> tuple[Floats, Floats]:
    """Mean [m], (dim,), and covariance [m²], (dim, dim), of a target by the mixture as it is."""
    return target.position(mixture.x), target.within_reach(target.cov(mixture.P))


@contextmanager
def reported(mixture: InteractingMixture, target: TargetMap, model_error: ModelError) -> Iterator[None]:
    """The mixture as it is predicted from for a target, as `reported_place`, in one thread; at the end it is as it was.

    For a report alone: the errors of the other opinions are much the same from frame to frame, and taken into the state
    with each they would count as new.
    """
    if not model_error.is_looked_for:
        with one_blas_thread():
            yield
        return
    with one_blas_thread(), unchanged(mixture):
        modes, found = mixture.beliefs(), model_error.of_target(target, mixture.x, mixture.P)
        H = np.zeros((len(target.constant), len(mixture.x)))
        H[:, : target.matrix.shape[1]] = target.matrix
        z = found.place - target.constant[: len(found.place)]
        mixture.hold(_beside(modes.mu, (modes.means, modes.covs, mixture.columns), found, found.ahead, z, H))
        yield


def _beside(
    odds: Floats, beliefs: tuple[Floats, Floats, Floats], found: Opinions, ahead: Floats, z: Floats, H: Floats
) -> tuple[Floats, Floats, Floats]:
    """Beliefs of several modes at these odds, inflated and with the other opinions of the target.

    That innovations exceed what was predicted says how large errors are, and not where they point: the larger the
    share that these add, the more even is what is told.
    """
    pooled = pooled_each(inflated_each(odds, beliefs, found.factor), ahead, found.share)
    corrected = corrected_each(pooled, z, H[: len(z)], found.cov, trust=found.trust)
    return evened_each(odds, corrected, H, UNDIRECTED * (1.0 - 1.0 / found.factor))


def until(time_s: float, now_s: float | None) -> float:
    """From now to a time [s]; raises ValueError where there is no now, and for a time that is past or not finite."""
    if now_s is None or not now_s <= time_s < np.inf:
        raise ValueError(f"time_s: expected {now_s} or later, found {time_s}")
    return time_s - now_s


def later_times(times_s: Sequence[float] | Floats, now_s: float | None) -> tuple[Floats, Floats]:
    """Times [s], (k,), and the steps to each from the one before; ValueError where they are no rising times from now.

    The steps [s], (k,), begin with the one from now_s.
    """
    times = np.asarray(times_s, dtype=float)
    if now_s is None or not len(times) or not now_s <= times[0] <= times[-1] < np.inf:
        raise ValueError(f"times_s: expected {now_s} or later, found {times}")
    steps = np.diff(times, prepend=now_s)
    if not (steps >= 0.0).all():
        raise ValueError(f"times_s: expected times that rise, found {times}")
    return times, steps


def target_by_modes(mixture: InteractingMixture, target: TargetMap, move: Callable[[], None]) -> GaussianMixture:
    """The target after a move, of each mode of now and each of then by itself: n_modes² Gaussians; all is set back."""
    parts, odds = [], mixture.mu
    with unchanged(mixture) as now:
        for k, (mean, cov) in enumerate(now.moments):
            mixture.chain.odds = now.odds
            mixture.restart(mean, cov, now.columns[k])
            mixture.mu = np.eye(len(mixture.mu))[k]
            move()
            modes, columns = mixture.beliefs(), target.linear(mixture.columns)
            covs = target.cov(modes.covs) + columns @ columns.swapaxes(1, 2)
            parts.append((odds[k] * modes.mu, target.position(modes.means), target.within_reach(covs)))
    weights, means, covs = (np.concatenate(each) for each in zip(*parts, strict=True))
    return GaussianMixture(weights / weights.sum(), means, covs)


def target_path(
    mixture: InteractingMixture, target: TargetMap, steps: Floats, move: Callable[[float], None]
) -> tuple[Floats, Floats]:
    """The target after each of these steps [s], (k,): means [m] (k, dim), covs [m²] (k, dim, dim); all is set back."""
    dim = len(target.constant)
    means, covs = np.empty((len(steps), dim)), np.empty((len(steps), dim, dim))
    with unchanged(mixture):
        for k, dt in enumerate(steps):
            if dt > 0.0:
                move(dt)
            means[k], covs[k] = place_and_cov(mixture, target)
    return means, covs


def expected_place(
    mixture: InteractingMixture, place: slice, shared: Floats | None, settings: FilterSettings
) -> tuple[Floats, Floats]:
    """Mean [m] and covariance [m²] of these coordinates by the mode in which they are the most uncertain.

    shared: what each column moves the mark there by, (dim, n_columns); None for the node itself. Not of the mixture: a
    poke that begins is improbable before it is seen, and a gate drawn by the mixture would reject the very marks that
    show it. Modes among blows count where they are more probable than an outlier, which else explains the same marks.
    """
    own = np.zeros((len(mixture.filters[0].x[place]), mixture.columns.shape[2])) if shared is None else shared
    possible = [k for k, each in enumerate(mixture.mu) if k < settings.n_usual or each >= settings.outlier_odds]
    widest = max(possible, key=lambda mode: float(np.trace(mixture.filters[mode].P[place, place])))
    f, columns = mixture.filters[widest], mixture.columns[widest][place] + own
    return f.x[place].copy(), f.P[place, place] + columns @ columns.T


def places_under_force(mixture: InteractingMixture, places: Sequence[slice]) -> tuple[Floats, Floats]:
    """Means [m] (n, dim) and covariances [m²] (n, dim, dim) of coordinates by the mode of the strongest forces."""
    forced, columns = mixture.filters[-1], mixture.columns[-1]
    rows = np.array([range(len(forced.x))[place] for place in places], dtype=np.int64)
    covs = forced.P[rows[:, :, None], rows[:, None, :]] + columns[rows] @ columns[rows].swapaxes(1, 2)
    return forced.x[rows], covs


class MixtureViews:
    """What a filter shows of its model and mixture."""

    model: TissueModel
    settings: FilterSettings
    mixture: InteractingMixture
    target: TargetMap
    n_calibration: int

    @property
    def network(self) -> MassSpringNetwork:
        """The network that the model moves."""
        return self.model.network

    @property
    def positions(self) -> Floats:
        """Mean places of all nodes now [m], (n_nodes, dim)."""
        network = self.network
        return all_positions(network, self.mixture.x[: network.n_state // 2].reshape(-1, network.dim))

    @property
    def is_finite(self) -> bool:
        """Whether the state is one of numbers: no mark would mend another."""
        return all(bool(np.isfinite(one.x).all() and np.isfinite(one.P).all()) for one in self.mixture.filters)

    @property
    def by_calibration(self) -> Floats:
        """How each error of the calibration, one standard deviation, moves the target [m], (dim, n_calibration)."""
        columns = self.target.linear(self.mixture.mean_columns)
        return columns[:, columns.shape[1] - self.n_calibration :]

    @property
    def may_be_led(self) -> bool:
        """Whether the body may be led for as long as it likes: a stiff or large one."""
        return self.settings.led is not None

    @property
    def repairs(self) -> Counter[str]:
        """Counts of repairs, by kind."""
        return self.mixture.repairs
