"""What the tests of the filters share: the phantom, and truths computed by SciPy's adaptive integrator."""

import os
from copy import deepcopy
from functools import lru_cache

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # at twenty states more threads only wait for each other

import numpy as np
import pytest
from scipy.integrate import DOP853

from dynamics import HIDDEN, OUTER, MassSpringNetwork, four_mass_phantom, motion, pack
from estimators import MarkMeasurement, TissueFilter

STEP = 1.0 / 120.0
"""Outside forces of a made-up truth are constant over this time [s]."""


@pytest.fixture(scope="session")
def phantom() -> MassSpringNetwork:
    return four_mass_phantom()


@pytest.fixture(scope="session")
def rest_state(phantom):
    """State of the phantom at rest, (n_state,)."""
    free = phantom.positions[phantom.free]
    return pack(free, np.zeros_like(free))


def driven(network, state, forces):
    """States at 0, STEP, 2 STEP, ... [s] under forces (n, n_free, dim) [N], each held for STEP, by DOP853."""
    rate, states, step = motion(network), [np.asarray(state, dtype=float)], STEP
    for force in forces:
        solver = DOP853(
            lambda _t, now, held=force: rate(now, held),
            0.0,
            states[-1],
            STEP,
            first_step=min(step, STEP),
            rtol=1e-8,
            atol=1e-10,
        )
        while solver.status == "running":
            solver.step()
        assert solver.status == "finished"
        states.append(solver.y)
        step = solver.h_abs
    return np.array(states)


def poke_forces(network, seconds, rng, tremor=0.05, poked=True):
    """Forces on the free nodes [N], (n, n_free, dim), for each STEP.

    tremor: white acceleration on each free node [m/s²/sqrt(Hz)]
    poked: half-sine pokes of 3 to 10 m/s² lasting 0.1 to 0.4 s, on one of the outer masses, in any direction, after
        pauses of 0.3 to 2 s
    """
    n, n_free, dim = round(seconds / STEP), len(network.free), network.dim
    masses = network.masses[network.free, None]
    forces = masses * tremor / np.sqrt(STEP) * rng.normal(size=(n, n_free, dim))
    t = np.arange(n) * STEP + STEP / 2
    start = rng.uniform(0.3, 2.0)
    while poked and start < seconds:
        lasting, angle = rng.uniform(0.1, 0.4), rng.uniform(0.0, 2.0 * np.pi)
        node = network.free.tolist().index(network.index(str(rng.choice(OUTER))))
        now = (t >= start) & (t < start + lasting)
        push = rng.uniform(3.0, 10.0) * np.array([np.cos(angle), np.sin(angle)])
        forces[now, node] += masses[node] * np.sin(np.pi * (t[now] - start) / lasting)[:, None] * push
        start += lasting + rng.uniform(0.3, 2.0)
    return forces


def marks_of(network, state, sd=0.0, rng=None, nodes=OUTER):
    """Marks of these nodes in that state, each coordinate off by noise of sd [m]; a noiseless one is given 1 mm."""
    cov = (sd or 1e-3) ** 2 * np.eye(network.dim)
    noise = {node: sd * rng.normal(size=network.dim) if sd else 0.0 for node in nodes}
    return [MarkMeasurement(node, state[network.coordinates(node)] + noise[node], cov) for node in nodes]


def resting_frames(network, n_frames, sd, nodes=OUTER, by=0.0):
    """Frames (time [s], marks), 30 a second, of these nodes at rest so far aside [m], a number or (dim,)."""
    free, rng = network.positions[network.free] + by, np.random.default_rng(0)
    state = pack(free, np.zeros_like(free))
    return [(k / 30.0, marks_of(network, state, sd, rng, nodes)) for k in range(n_frames)]


@lru_cache
def poked_frames(seconds, sd, seed):
    """Frames (time [s], marks) of the poked phantom, 30 a second, and its states, (n, n_state)."""
    network, rng = four_mass_phantom(), np.random.default_rng(seed)
    free = network.positions[network.free]
    states = driven(network, pack(free, np.zeros_like(free)), poke_forces(network, seconds, rng))[::4]
    return [(k / 30.0, marks_of(network, state, sd, rng)) for k, state in enumerate(states)], states


def followed(method, frames):
    """The estimates of frames, (time [s], marks) each."""
    found = []
    for time_s, marks in frames:
        method.predict(time_s)
        found.append(method.update(marks))
    return found


@pytest.fixture(scope="session")
def hidden(phantom):
    """Where the hidden mass stands in a state."""
    return phantom.coordinates(HIDDEN)


@pytest.fixture(scope="session")
def warmed(phantom):
    """A filter of the hidden mass that has seen the phantom at rest for half a second, given its marks' sd [m]."""

    @lru_cache
    def first(sd):
        tissue = TissueFilter(phantom, HIDDEN, OUTER)
        followed(tissue, resting_frames(phantom, 15, sd))
        return tissue

    return lambda sd: deepcopy(first(sd))
