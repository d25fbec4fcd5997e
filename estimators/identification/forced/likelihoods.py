"""Log likelihoods of a recording under many networks and noise levels at once, its pokes known.

As `forced_pass` has them, without sensitivities. All cases go through the frames together, some on each core: a frame
costs the arithmetic of sigma points, and Python once for all of them.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial

import numpy as np

from dynamics import MassSpringNetwork
from dynamics.forces.kernels import packed
from estimators.arrays import Floats
from estimators.filters.unscented import CovarianceError
from estimators.identification.forced.forced_filter import Belief, ForcedFilter, Forces, forces_between, stacked
from estimators.identification.forced.kernels import moved_each, taken_each
from estimators.identification.forced.recorded import Recorded
from estimators.process.process_model import ForceMode
from estimators.tissue.estimate import MarkMeasurement

Case = tuple[MassSpringNetwork, Forces]
"""Networks that differ in their constants alone, forces in their noise alone."""


def log_likelihoods(cases: Sequence[Case], seen: Recorded) -> Floats:
    """Of the marks after the first frame, (n_cases,), -inf where the filter has no finite state.

    Raises OutOfTimeError.
    """
    n = max(1, min(len(cases), os.cpu_count() or 1))
    found = np.empty(len(cases))
    # the compiled frames hold no lock
    with ThreadPoolExecutor(n) as threads:
        parts = [cases[k::n] for k in range(n)]
        for k, part in enumerate(threads.map(partial(_in_one_thread, seen), parts)):
            found[k::n] = part
    return found


def _in_one_thread(seen: Recorded, cases: Sequence[Case]) -> Floats:
    frames, settings = seen.frames, seen.settings
    total = np.full(len(cases), -np.inf)
    started: list[tuple[int, ForcedFilter]] = []
    for k, (network, _) in enumerate(cases):
        forced = ForcedFilter(network, seen.nodes[0], settings)
        try:
            forced.start(frames[0][1])
        except (CovarianceError, np.linalg.LinAlgError):
            continue
        started.append((k, forced))
    if not started:
        return total
    own = [k for k, _ in started]
    batch = _Batch([forced for _, forced in started], [cases[k][1] for k in own])
    total[own] = 0.0
    for k in range(1, len(frames)):
        seen.budget.check()
        total[own] += batch.advance(frames[k][0] - frames[k - 1][0], k, frames[k][1])
    return total


class _Batch:
    """Forced filters that have started, frame by frame together.

    State: means (k, dim_x), covariances (k, dim_x, dim_x), the mode of each; the noise of the last step.
    """

    def __init__(self, filters: Sequence[ForcedFilter], forces: Sequence[Forces]) -> None:
        self._filters, self._forces = filters, forces
        first = filters[0]
        network = first.model.network
        beliefs = [one.belief for one in filters if one.belief is not None]
        self._xs = np.array([belief.x for belief in beliefs])
        self._Ps = np.array([belief.P for belief in beliefs])
        self._modes: list[ForceMode | None] = [None] * len(filters)
        self._noise: tuple[float, Floats] = (0.0, np.zeros(0))
        self._points = float(first.scale[0]), first.weights[0][0], first.weights[1][0]
        packs = [packed(one.model.network) for one in filters]
        self._constants = np.array([p.spring_constants for p in packs]), np.array([p.node_constants for p in packs])
        inverse_mass = np.zeros(network.n_nodes)
        inverse_mass[network.free] = 1.0 / network.masses[network.free]
        self._motion = network.positions, network.free, inverse_mass, packs[0].springs, packs[0].weight
        self._factors = np.array([one.marks for one in forces])

    def advance(self, dt: float, frame: int, marks: Sequence[MarkMeasurement]) -> Floats:
        """Move all beliefs dt [s] to this frame, take in its marks: their log likelihoods, (k,), 0 without any."""
        first, acting = self._filters[0], self._forces[0].at(frame)
        model, settings = first.model, first.settings
        modes = [
            forces_between(replace(settings.quiet, white=one.white), settings.poked.lasting_s, acting)
            for one in self._forces
        ]
        if modes[0][0] != self._modes[0]:
            self._change([mode for (mode,) in modes])
        # as many steps as the stiffest takes: a likelihood would jump where another number is enough
        n_steps = max(one.model.stepper.n_steps(dt) for one in self._filters)
        step = dt / n_steps
        n_parts = max(one.model.stepper.n_steps(step) for one in self._filters)
        lasting = model.noise_of(modes[0])[2][:, None]
        fade = np.exp(-step / lasting)
        self._xs, self._Ps, definite = moved_each(
            self._xs,
            self._Ps,
            self._noise_of(step),
            n_steps,
            self._points,
            ((1.0 - fade) * lasting / step, fade, model.poked_rows),
            (step / n_parts, n_parts, *self._motion),
            *self._constants,
        )
        logs = np.where(definite, 0.0, -np.inf)
        if marks:
            (_, H), (z, R) = first.rows(marks), stacked(marks, 1.0)
            dim, gate = model.network.dim, settings.gate
            self._xs, self._Ps, taken = taken_each(self._xs, self._Ps, z, H, R, self._factors, dim, gate)
            logs = logs + taken
        return logs

    def _change(self, modes: Sequence[ForceMode]) -> None:
        """Let pokes begin and end, each filter its own."""
        none = np.zeros((self._xs.shape[1], 0))
        for k, (one, mode) in enumerate(zip(self._filters, modes, strict=True)):
            now = one.between_pokes(Belief(self._xs[k], self._Ps[k], none, self._modes[k]), mode)
            self._xs[k], self._Ps[k], self._modes[k] = now.x, now.P, mode
        self._noise = 0.0, self._noise[1]

    def _noise_of(self, step: float) -> Floats:
        """Covariances that a step [s] adds in the modes of now, (k, dim_x, dim_x); those asked for last are kept."""
        key = round(step, 9)
        if self._noise[0] != key:
            modes = [mode for mode in self._modes if mode is not None]
            by_mode = {mode: self._filters[0].model.noise(step, mode) for mode in set(modes)}
            self._noise = key, np.array([by_mode[mode] for mode in modes])
        return self._noise[1]
