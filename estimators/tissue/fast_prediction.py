"""The target's predicted path within a tenth of a millisecond, for a live loop: the filter's tables, made once.

About the rest shape the tissue is linear, and each mode moves it by a matrix of its own. Under states that turn into
each other at given rates the moments m_i = P(state i) E[x | i] and S_i = P(state i) E[x x' | i] then move linearly,
too: in each cycle they are mixed, m_j <- sum_i M_ij m_i, and moved, m <- F m, S <- F S F' + P(state) Q. Mean and
covariance of the target some cycles ahead are therefore a matrix times the moments of now. That matrix is made
backwards, as adjoint of the cycles, and only its rows for the target are kept.

Differs from `TissueFilter.predict_path`: springs are taken as straight, friction as a dashpot of F / sqrt(slip² + v²)
for a speed v out of a few; second moments are carried exactly where the filter matches moments cycle by cycle.

Constants in error, which a filter considers, are forces beside the model's: what each direction's force about the mean
path makes of the target in the cycles that follow is added to what becomes of the error of now.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from typing import cast

import numpy as np
from numpy.typing import NDArray

from dynamics import DRIVEN, SLIP_VELOCITY, rest_shape, state_matrix
from estimators.arrays import Floats
from estimators.filters.chain import rising
from estimators.filters.exponential import small_expm
from estimators.process.target import TargetMap
from estimators.tissue.filter import TissueFilter
from estimators.tissue.prediction import onset_of, reported
from estimators.tissue.target_filter import PathTables, Tabled, TargetFilter, times_until

SPEEDS_M_S = (0.0, 0.01, 0.02, 0.04, 0.08, 0.16, 0.32)
"""Typical speeds of the nodes for which tables are made, each twice the last; choice, its cost in docs/settings.md."""

SPREAD = 4.0
"""Weight of the velocities' variance beside their squared mean in the typical speed; choice, its cost in
docs/settings.md. The sigma points of `predict_path` stand some standard deviations away and feel less friction."""


@dataclass(frozen=True, slots=True, eq=False)
class SpeedTables:
    """Tables at one typical speed of the nodes.

    first: what the first moment in each state of the chain makes of the target's mean, (n_times dim, n_states dim_x)
    second: what its second moment, the lower triangle, makes of the target's, (n_times pairs, n_states n_low)
    noise: and what the odds of now do, (n_times pairs, n_states), at the stated level of white noise
    white: what that level's share of it is, (n_times pairs, n_states)
    pushed: by how much forces on the free coordinates, held in each of the cycles ahead, move the target [m/N],
        (n_times dim, (n_times - 1) n_free dim)
    step: what a cycle without forces makes of the network's state about rest, (n_state, n_state)
    quiet: what so many cycles in which nobody pokes make of the target's mean, (n_times, dim, dim_x)
    quiet_noise: and what they add to its covariance [m²], (n_times, dim, dim); quiet_white: the share of white noise
    """

    first: Floats
    second: Floats
    noise: Floats
    white: Floats
    pushed: Floats
    step: Floats
    quiet: Floats
    quiet_noise: Floats
    quiet_white: Floats


@dataclass(frozen=True, slots=True, eq=False)
class FastPredictionTables:
    """Tables of a filter's predictions for n_times times, cycle_s [s] apart from its state's own on.

    rest: the network's state at rest, (n_state,); shape: of all nodes then [m], (n_nodes, dim)
    undisturbed: probability that nobody pokes in the cycles until then, by the state of now, (n_times, n_states)
    speeds: typical ones for which there are tables [m/s], (n_speeds,): a single one where there is no friction
    made: tables by the place of their speed
    """

    cycle_s: float
    n_times: int
    rest: Floats
    shape: Floats
    target: TargetMap
    undisturbed: Floats
    speeds: Floats
    made: dict[int, SpeedTables] = field(default_factory=dict)

    def at(self, level: int, tissue: TissueFilter) -> SpeedTables:
        """Tables for one of the speeds, by its place; made, of this filter, where it is asked for first."""
        if level not in self.made:
            self.made[level] = _tables(tissue, float(self.speeds[level]), self.shape, self.n_times)
        return self.made[level]

    def ahead(self, tissue: TissueFilter, push: Floats | None = None) -> tuple[Floats, Floats, Floats]:
        """Times [s] (k,), means [m] (k, dim) and covariances [m²] (k, dim, dim) of the target from now on.

        push: a known force on the free nodes [N], held in each cycle ahead, (k - 1, n_free, dim)
        """
        now = moments_now(self, tissue)
        times, means, covs = self._whole(now)
        if push is not None:
            forces = np.asarray(push, dtype=float)
            if forces.size != now.tables.pushed.shape[1] or len(forces) != self.n_times - 1:
                raise ValueError(f"push: expected shape ({self.n_times - 1}, n_free, dim), found {forces.shape}")
            means = means + (now.tables.pushed @ forces.ravel()).reshape(means.shape)
        return times, means, covs

    def parts(self, tissue: TissueFilter) -> tuple[Floats, Floats, Floats, Floats, Floats, Floats]:
        """As `ahead`, and the probability [1] (k,) that nobody pokes, with mean [m] and covariance [m²] if so."""
        now = moments_now(self, tissue)
        return (*self._whole(now), *self._quiet(now))

    def _whole(self, now: MomentsNow) -> tuple[Floats, Floats, Floats]:
        times = now.time_s + self.cycle_s * np.arange(self.n_times, dtype=np.float64)
        return times, *moments_ahead(self, now)

    def _quiet(self, now: MomentsNow) -> tuple[Floats, Floats, Floats]:
        own, staying = now.tables, self.undisturbed
        weights = staying @ now.odds
        shares = staying / np.maximum(weights, np.finfo(float).tiny)[:, None]
        first, second = (np.einsum("ks,s...->k...", shares, each) for each in (now.first, now.second))
        away = np.einsum("kdi,ki->kd", own.quiet, first)
        moments = np.einsum("kdi,kij,kej->kde", own.quiet, second, own.quiet, optimize=True)
        noise = own.quiet_noise + (now.level - 1.0) * own.quiet_white
        covs = moments - away[:, :, None] * away[:, None, :] + noise
        if now.forced.shape[2]:
            columns = np.einsum("kdi,ks,sir->kdr", own.quiet, shares, now.columns, optimize=True)
            covs += forced_cov(columns, now.forced)
        return weights, away + self.target.position(self.rest), covs


def fast_prediction_tables(tissue: TargetFilter, horizon_s: float, *, at_once: bool = True) -> PathTables:
    """Tables of a filter, as far ahead as this [s]; its posterior does not matter, its network and settings do.

    at_once: for all speeds now, as a live loop needs it; if not, for each speed when it first occurs
    """
    if not isinstance(tissue, TissueFilter):
        return cast(Tabled, tissue).tables(times_until(horizon_s, tissue.settings.mix_s), tissue.settings.mix_s)
    model, settings = tissue.model, tissue.settings
    cycle = settings.mix_s
    n_times = times_until(horizon_s, cycle)
    shape = rest_shape(model.network)
    rest = np.zeros(model.network.n_state)
    rest[: len(rest) // 2] = shape[model.network.free].ravel()
    speeds = np.array(SPEEDS_M_S if model.network.friction.any() else SPEEDS_M_S[:1])
    tables = FastPredictionTables(cycle, n_times, rest, shape, tissue.target, _staying_quiet(tissue, n_times), speeds)
    if at_once:
        for level in range(len(speeds)):
            tables.at(level, tissue)
    return tables


def predict_fast(tables: PathTables, tissue: TargetFilter, push: Floats | None = None) -> tuple[Floats, Floats, Floats]:
    """Times [s] (k,), means [m] (k, dim) and covariances [m²] (k, dim, dim) of the target from the filter's time on.

    push [N]: (k - 1, n_free, dim). Raises ValueError before the filter's first frame and for a push of another shape.
    """
    return tables.ahead(tissue, push)


@dataclass(frozen=True, slots=True, eq=False)
class MomentsNow:
    """A filter's belief about rest, state of the chain by state, each by its odds, and the tables for its speed.

    time_s: of the belief [s]; odds (n_states,); first (n_states, dim_x), second (n_states, dim_x, dim_x): moments
    columns (n_states, dim_x, r): of the error, what directions that are considered make of it
    forced: what their forces will have made of the target until each time of the tables, (n_times, dim, r)
    level: factor on the variance of white noise [1]
    """

    time_s: float
    tables: SpeedTables
    odds: Floats
    first: Floats
    second: Floats
    columns: Floats
    forced: Floats
    level: float


def moments_now(tables: FastPredictionTables, tissue: TissueFilter) -> MomentsNow:
    """The belief of a filter as its tables need it; raises ValueError before the filter's first frame."""
    if tissue.time_s is None:
        raise ValueError("predict_fast: expected a filter after its first frame, found no time")
    with reported(tissue.mixture, tissue.target, tissue.model_error):
        return _moments_of(tables, tissue, tissue.time_s)


def _moments_of(tables: FastPredictionTables, tissue: TissueFilter, time_s: float) -> MomentsNow:
    mixture, modes = tissue.mixture, tissue.mixture.beliefs()
    n, half = len(tables.rest), len(tables.rest) // 2
    away = modes.means.copy()
    away[:, :n] -= tables.rest
    mean, var = mixture.x[half:n], np.diagonal(mixture.P)[half:n]
    speed = np.sqrt(2.0 * float(mean @ mean + SPREAD * var.sum()) / half)
    own = tables.at(
        int(np.abs(np.log(np.maximum(tables.speeds, SLIP_VELOCITY)) - np.log(max(speed, SLIP_VELOCITY))).argmin()),
        tissue,
    )
    columns = mixture.columns
    # what is considered moves as any error of the state does, and is pushed besides by what is `forced`
    second = modes.covs + columns @ columns.swapaxes(1, 2) + away[:, :, None] * away[:, None, :]
    chain = mixture.chain

    def by_state(each: Floats) -> Floats:
        """Of what each mode has, that of the states by their odds."""
        return np.asarray(np.einsum("s,s...->s...", chain.odds, each[chain.of_state]))

    forced = _forced(tables, own, tissue, mixture.x[:n] - tables.rest)
    level = mixture.noise_level
    return MomentsNow(time_s, own, chain.odds, by_state(away), by_state(second), by_state(columns), forced, level)


def moments_ahead(tables: FastPredictionTables, now: MomentsNow) -> tuple[Floats, Floats]:
    """Means [m] (k, dim) and covariances [m²] (k, dim, dim) of the target at the times of the tables."""
    dim, k = len(tables.target.constant), tables.n_times
    low = _lower(now.first.shape[1])
    away = (now.tables.first @ now.first.ravel()).reshape(k, dim)
    noise = now.tables.noise @ now.odds + (now.level - 1.0) * (now.tables.white @ now.odds)
    moments = now.tables.second @ now.second[:, low[0], low[1]].ravel() + noise
    a, b = _lower(dim)
    covs = np.empty((k, dim, dim))
    covs[:, a, b] = moments.reshape(k, len(a)) - away[:, a] * away[:, b]
    covs[:, b, a] = covs[:, a, b]
    r = now.forced.shape[2]
    if r:
        columns = now.tables.first @ now.columns.reshape(-1, r)
        covs += forced_cov(columns.reshape(k, dim, r), now.forced)
    return away + tables.target.position(tables.rest), covs


def forced_cov(columns: Floats, forced: Floats) -> Floats:
    """What forces of directions add to a covariance in which their columns are, (k, dim, dim): both (k, dim, r)."""
    across = columns @ forced.swapaxes(1, 2)
    return across + across.swapaxes(1, 2) + forced @ forced.swapaxes(1, 2)


def _forced(tables: FastPredictionTables, own: SpeedTables, tissue: TissueFilter, away: Floats) -> Floats:
    """`MomentsNow.forced`: forces about the path on which the mean state goes back to rest, (n_state,) from it now."""
    model, k = tissue.model, tables.n_times
    found = np.zeros((k, len(tables.target.constant), model.n_columns))
    if not model.n_constants:
        return found
    states = np.empty((k, len(away)))
    for time in range(k):
        states[time] = away
        away = own.step @ away
    forces = model.constant_forces(states + tables.rest)
    held = 0.5 * (forces[1:] + forces[:-1])
    moved = own.pushed @ held.swapaxes(1, 2).reshape(own.pushed.shape[1], -1)
    found[:, :, : model.n_constants] = moved.reshape(k, -1, model.n_constants)
    return found


@cache
def _lower(n: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns of the lower triangle, (n (n + 1) / 2,) each: made once, since a frame needs them."""
    rows, columns = np.tril_indices(n)
    return rows, columns


def _staying_quiet(tissue: TissueFilter, n_times: int) -> Floats:
    """Probability that the chain is in states in which nobody pokes now and after each cycle, (n_times, n_states)."""
    settings = tissue.settings
    quiet = np.isin(settings.of_state, settings.quiet_modes)
    M = small_expm(settings.rates * settings.mix_s)
    staying = np.zeros((n_times, len(quiet)))
    staying[0] = quiet
    for k in range(1, n_times):
        staying[k] = quiet * (M @ staying[k - 1])
    return staying


def _tables(tissue: TissueFilter, speed: float, shape: Floats, n_times: int) -> SpeedTables:
    """The tables at one speed [m/s]: backwards from the target, cycle by cycle."""
    model, settings = tissue.model, tissue.settings
    cycle, n = settings.mix_s, model.network.n_state
    forces, of_state = settings.modes, list(settings.of_state)
    n_steps = model.stepper.n_steps(cycle)
    M = small_expm(settings.rates * cycle)
    rate = state_matrix(model.network, shape, speed_m_s=speed)
    mass = model.mass
    if tissue.mixture.move.linear is not None:  # a hand moves what it is known to lead, and nothing else does
        rate[n // 2 + model.led_rows] = 0.0
        mass = mass.copy()
        mass[model.led_rows] *= DRIVEN
    Fs, Qs = [], []
    for mode, noises in zip(forces, model.noise_of_modes(cycle / n_steps, forces), strict=True):
        A, _ = model.linearised(shape, mode)
        A[:n, :n] = rate
        F, Q = small_expm(A * cycle / n_steps), np.array(noises)
        total = np.zeros_like(Q)
        for _ in range(n_steps):
            total = F @ total @ F.T + Q
        Fs.append(np.linalg.matrix_power(F, n_steps))
        Qs.append(total)
    F_each, Q_each = np.array(Fs)[of_state], np.array(Qs)[of_state]
    begun = rising(onset_of(model, forces)[of_state])
    of_target = tissue.target.over(model.dim_x)
    dim = len(of_target)
    y = np.tile(of_target, (len(of_state), 1, 1))
    pairs = list(zip(*_lower(dim), strict=True))
    Y = np.array([[np.outer(own[a], own[b]) for a, b in pairs] for own in y])
    Y = 0.5 * (Y + Y.swapaxes(2, 3))
    c = np.zeros((2, len(of_state), len(pairs)))
    low = _lower(model.dim_x)
    twice = np.where(low[0] == low[1], 1.0, 2.0)
    first, second, noise = [y], [Y[..., low[0], low[1]] * twice], [c]
    for _ in range(n_times - 1):
        c = M @ (np.einsum("jpab,jwab->wjp", Y, Q_each) + c)
        y = np.einsum("ij,jda->ida", M, y @ F_each)
        Y_before = F_each.swapaxes(1, 2)[:, None] @ Y @ F_each[:, None]
        c[0] += np.einsum("ij,ijn,jpnn->ip", M, begun, Y_before)
        Y = np.einsum("ij,jpab->ipab", M, Y_before)
        first.append(y)
        second.append(Y[..., low[0], low[1]] * twice)
        noise.append(c)
    firsts = np.array(first).swapaxes(1, 2).reshape(n_times * dim, -1)
    seconds = np.array(second).swapaxes(1, 2).reshape(n_times * len(pairs), -1)
    of_odds = np.array(noise).swapaxes(0, 1).swapaxes(2, 3).reshape(2, n_times * len(pairs), -1)
    quiet, quiet_noise = [y_now := first[0][0]], [np.zeros((2, dim, dim))]
    for _ in range(n_times - 1):
        quiet_noise.append(quiet_noise[-1] + y_now @ Qs[0] @ y_now.T)
        quiet.append(y_now := y_now @ Fs[0])
    quiet_noises = np.array(quiet_noise)
    return SpeedTables(
        firsts,
        seconds,
        of_odds[0],
        of_odds[1],
        _answers(rate, mass, tissue.target, cycle, n_times),
        small_expm(rate * cycle),
        np.array(quiet),
        quiet_noises[:, 0],
        quiet_noises[:, 1],
    )


def _answers(A: Floats, mass: Floats, target: TargetMap, cycle: float, n_times: int) -> Floats:
    """`SpeedTables.pushed`, of a network that moves by A, (n_state, n_state), about rest."""
    n, half, dim = len(A), len(mass), len(target.constant)
    held = np.zeros((n + half, n + half))
    held[:n, :n], held[half:n, n:] = A, np.diag(1.0 / mass)
    moved = small_expm(held * cycle)
    F, now = moved[:n, :n], moved[:n, n:]
    found = np.zeros((n_times, dim, n_times - 1, half))
    for lag in range(1, n_times):
        begun = np.arange(n_times - lag)
        found[begun + lag, :, begun] = target.linear(now)
        now = F @ now
    return found.reshape(n_times * dim, -1)
