"""The target's predicted path within a tenth of a millisecond, for a live loop: the filter's tables, made once.

About the rest shape the tissue is linear, and each mode moves it by a matrix of its own. Under states that turn into
each other at given rates the moments m_i = P(state i) E[x | i] and S_i = P(state i) E[x x' | i] then move linearly,
too: in each cycle they are mixed, m_j <- sum_i M_ij m_i, and moved, m <- F m, S <- F S F' + P(state) Q. Mean and
covariance of the target some cycles ahead are therefore a matrix times the moments of now. That matrix is made
backwards, as adjoint of the cycles, and only its rows for the target are kept.

Differs from `TissueFilter.predict_path`: springs are taken as straight, friction as a dashpot of F / sqrt(slip² + v²)
for a speed v out of a few; second moments are carried exactly where the filter matches moments cycle by cycle.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from dynamics import SLIP_VELOCITY, rest_shape, state_matrix
from estimators.arrays import Floats
from estimators.filters.exponential import small_expm
from estimators.process.target import TargetMap
from estimators.tissue.filter import TissueFilter

SPEEDS_M_S = (0.0, 0.01, 0.02, 0.04, 0.08, 0.16, 0.32)
"""Typical speeds of the nodes for which tables are made, each twice the last; choice, its cost in docs/settings.md."""

SPREAD = 4.0
"""Weight of the velocities' variance beside their squared mean in the typical speed; choice, its cost in
docs/settings.md. The sigma points of `predict_path` stand some standard deviations away and feel less friction."""


@dataclass(frozen=True, slots=True, eq=False)
class FastPredictionTables:
    """Tables of a filter's predictions for n_times times, cycle_s [s] apart from its state's own on.

    rest: the network's state at rest, (n_state,)
    first: what the first moment in each state of the chain makes of the target's mean, (n_speeds, n_times dim,
        n_states dim_x)
    second: what its second moment, the lower triangle, makes of the target's, (n_speeds, n_times pairs, n_states n_low)
    noise: and what the odds of now do, (n_speeds, n_times pairs, n_states)
    pushed: by how much a force on each free coordinate held for a cycle moves the target so many cycles after it began
        [m/N], (n_speeds, n_times, dim, n_free dim)
    """

    cycle_s: float
    rest: Floats
    target: TargetMap
    first: Floats
    second: Floats
    noise: Floats
    pushed: Floats

    @property
    def n_times(self) -> int:
        """How many times the tables reach, the first of them now."""
        return self.pushed.shape[1]


def fast_prediction_tables(tissue: TissueFilter, horizon_s: float) -> FastPredictionTables:
    """Tables of a filter, as far ahead as this [s]; its belief does not matter, its network and settings do.

    Raises ValueError for a filter that considers unknown constants: what they will make of the error is left out here.
    """
    model, settings = tissue.model, tissue.settings
    if model.n_constants:
        raise ValueError(
            f"fast_prediction_tables: expected a filter without unknown constants, found {model.n_constants} directions"
        )
    cycle = settings.mix_s
    n_times = int(np.ceil(horizon_s / cycle * (1.0 - 1e-6))) + 1
    shape = rest_shape(model.network)
    made = [_tables(tissue, speed, shape, n_times) for speed in SPEEDS_M_S]
    first, second, noise, pushed = (np.array(each) for each in zip(*made, strict=True))
    rest = np.zeros(model.network.n_state)
    rest[: len(rest) // 2] = shape[model.network.free].ravel()
    return FastPredictionTables(cycle, rest, tissue.target, first, second, noise, pushed)


def predict_fast(
    tables: FastPredictionTables, tissue: TissueFilter, push: Floats | None = None
) -> tuple[Floats, Floats, Floats]:
    """Times [s] (k,), means [m] (k, dim) and covariances [m²] (k, dim, dim) of the target from the filter's time on.

    push: a known force on the free nodes [N], held in each cycle ahead, (k - 1, n_free, dim)
    Raises ValueError before the filter's first frame and for a push of another shape.
    """
    if tissue.time_s is None:
        raise ValueError("predict_fast: expected a filter after its first frame, found no time")
    modes = tissue.mixture.beliefs()
    n, half = len(tables.rest), len(tables.rest) // 2
    away = modes.means.copy()
    away[:, :n] -= tables.rest
    mean, var = tissue.mixture.x[half:n], np.diagonal(tissue.mixture.P)[half:n]
    speed = np.sqrt(2.0 * float(mean @ mean + SPREAD * var.sum()) / half)
    level = int(np.abs(np.log(np.maximum(SPEEDS_M_S, SLIP_VELOCITY)) - np.log(max(speed, SLIP_VELOCITY))).argmin())
    dim, k = len(tables.target.constant), tables.n_times
    low = _lower(away.shape[1])
    covs_now, columns = modes.covs, tissue.mixture.columns
    if columns.shape[2]:  # an error of the calibration moves as any error of the state
        covs_now = covs_now + columns @ columns.swapaxes(1, 2)
    # a state's moments are those of its mode, in all branches
    chain = tissue.mixture.chain
    by_branch = chain.odds.reshape(chain.n_branches, -1)
    second = (covs_now + away[:, :, None] * away[:, None, :])[:, low[0], low[1]]
    first, S = (
        np.einsum("bs,bsi->si", by_branch, each.reshape(chain.n_branches, chain.n_modes, -1)[:, chain.of_state])
        for each in (away, second)
    )
    odds = chain.state_odds
    means = (tables.first[level] @ first.ravel()).reshape(k, dim)
    second_moments = tables.second[level] @ S.ravel() + tables.noise[level] @ odds
    a, b = _lower(dim)
    covs = np.empty((k, dim, dim))
    covs[:, a, b] = second_moments.reshape(k, len(a)) - means[:, a] * means[:, b]
    covs[:, b, a] = covs[:, a, b]
    if push is not None:
        means = means + _moved_by(tables.pushed[level], np.asarray(push, dtype=float), half)
    return (
        tissue.time_s + tables.cycle_s * np.arange(k, dtype=np.float64),
        means + tables.target.position(tables.rest),
        covs,
    )


@cache
def _lower(n: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns of the lower triangle, (n (n + 1) / 2,) each: made once, since a frame needs them."""
    rows, columns = np.tril_indices(n)
    return rows, columns


def _moved_by(pushed: Floats, push: Floats, half: int) -> Floats:
    k, dim, _ = pushed.shape
    if push.size != (k - 1) * half or len(push) != k - 1:
        raise ValueError(f"push: expected shape ({k - 1}, n_free, dim), found {push.shape}")
    forces, moved = push.reshape(k - 1, half), np.zeros((k, dim))
    for cycle in range(k - 1):
        moved[cycle + 1 :] += pushed[1 : k - cycle] @ forces[cycle]
    return moved


def _tables(tissue: TissueFilter, speed: float, shape: Floats, n_times: int) -> tuple[Floats, Floats, Floats, Floats]:
    """The four tables of `FastPredictionTables` at one speed [m/s]: backwards from the target, cycle by cycle."""
    model, settings = tissue.model, tissue.settings
    cycle, n = settings.mix_s, model.network.n_state
    forces, of_state = settings.modes, list(settings.of_state)
    n_steps = model.stepper.n_steps(cycle)
    M = small_expm(settings.rates * cycle)
    rate = state_matrix(model.network, shape, speed_m_s=speed)
    Fs, Qs = [], []
    for mode in forces:
        A, _ = model.linearised(shape, mode)
        A[:n, :n] = rate
        F, Q = small_expm(A * cycle / n_steps), model.noise(cycle / n_steps, mode)
        total = np.zeros_like(Q)
        for _ in range(n_steps):
            total = F @ total @ F.T + Q
        Fs.append(np.linalg.matrix_power(F, n_steps))
        Qs.append(total)
    F_each, Q_each = np.array(Fs)[of_state], np.array(Qs)[of_state]
    matrix = tissue.target.matrix
    dim = len(matrix)
    y = np.zeros((len(of_state), dim, model.dim_x))
    y[:, :, : matrix.shape[1]] = matrix
    pairs = list(zip(*np.tril_indices(dim), strict=True))
    Y = np.array([[np.outer(own[a], own[b]) for a, b in pairs] for own in y])
    Y = 0.5 * (Y + Y.swapaxes(2, 3))
    c = np.zeros((len(of_state), len(pairs)))
    first, second, noise = [y], [Y], [c]
    for _ in range(n_times - 1):
        c = M @ (np.einsum("jpab,jab->jp", Y, Q_each) + c)
        y = np.einsum("ij,jda->ida", M, y @ F_each)
        Y = np.einsum("ij,jpab->ipab", M, F_each.swapaxes(1, 2)[:, None] @ Y @ F_each[:, None])
        first.append(y)
        second.append(Y)
        noise.append(c)
    low = np.tril_indices(model.dim_x)
    twice = np.where(low[0] == low[1], 1.0, 2.0)
    firsts = np.array(first).swapaxes(1, 2).reshape(n_times * dim, -1)
    packed = (np.array(second)[..., low[0], low[1]] * twice).swapaxes(1, 2).reshape(n_times * len(pairs), -1)
    noises = np.array(noise).swapaxes(1, 2).reshape(n_times * len(pairs), -1)
    return firsts, packed, noises, _answers(rate, model.mass, tissue.target, cycle, n_times)


def _answers(A: Floats, mass: Floats, target: TargetMap, cycle: float, n_times: int) -> Floats:
    """Displacement of the target so many cycles after a force held for one began, (n_times, dim, n_free dim)."""
    n, half = len(A), len(mass)
    held = np.zeros((n + half, n + half))
    held[:n, :n], held[half:n, n:] = A, np.diag(1.0 / mass)
    moved = small_expm(held * cycle)
    F, now = moved[:n, :n], moved[:n, n:]
    found = np.zeros((n_times, len(target.constant), half))
    for k in range(1, n_times):
        found[k] = target.linear(now)
        now = F @ now
    return found
