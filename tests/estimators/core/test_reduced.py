"""The filter of a body in few shapes, against that of all its nodes."""

import numpy as np
import pytest

from dynamics import ParameterUncertainty, parameters, scale_parameters
from dynamics.elements import Assembly
from dynamics.integration.rosenbrock import Rosenbrock
from estimators import MarkMeasurement, TissueFilter
from estimators.core.motion import NetworkMotion
from estimators.core.motion import network as model
from estimators.core.statics import Statics
from estimators.core.tissue import TissueProcess
from tests.estimators.conftest import followed
from tests.networks import slab

HZ = 1.0 / 30.0
MARKED = ["N44", "N42", "N38", "N36", "N27", "N33", "N35", "N29"]
TARGET = "N31"


@pytest.fixture(scope="module")
def body():
    return slab((5, 3, 3))


def in_few(network, **options):
    process = TissueProcess(network, MARKED, **options)
    assert process.span.matrix.shape[1] < 0.75 * len(process.span.matrix)
    return process


def swung(process):
    """The body bent, in motion and pushed."""
    rng, state = np.random.default_rng(1), process.prior(0.01)[0].copy()
    for name, scale in (("position", 3e-4), ("velocity", 0.01), ("force", 0.3), ("discrepancy", 1.0)):
        own = process.parts[name]
        state[own] += scale * rng.normal(size=own.stop - own.start)
    return state


def test_the_derivative_is_that_of_the_motion(body):
    """By central differences in four columns of each part, to six hundredths of the largest entry of each block."""
    process = in_few(body)
    state = swung(process)
    found = process.linearize(state, HZ)
    np.testing.assert_allclose(found.mean, process.moved(state, HZ), rtol=1e-12)
    for own in process.parts.values():
        columns = np.linspace(own.start, own.stop - 1, 4).astype(int)
        steps = 1e-6 * np.eye(process.n)[columns]
        exact = np.array([(process.moved(state + s, HZ) - process.moved(state - s, HZ)) / 2e-6 for s in steps]).T
        for rows in process.parts.values():
            scale = np.abs(exact[rows]).max()
            np.testing.assert_allclose(found.matrix[rows, columns], exact[rows], atol=0.06 * scale + 1e-12)


def test_columns_of_constants_are_derivatives_of_the_motion_by_them(body, monkeypatch):
    """Truth: the motion in the same shapes with stiffnesses that are changed, by central differences."""
    which = tuple(one for one in parameters(body) if one.kind == "stiffness")
    known = ParameterUncertainty(which, np.full((1, len(which)), 1e-3))
    process = in_few(body, statics=Statics(known))
    state, moving = swung(process), process.parts["velocity"].stop
    monkeypatch.setattr(NetworkMotion, "_span", lambda *_given: process.span)
    changed = [TissueProcess(scale_parameters(body, which, sign * known.directions[0]), MARKED) for sign in (1.0, -1.0)]
    ends = [one.moved(state[:-1], HZ)[:moving] for one in changed]
    truth, found = 0.5 * (ends[0] - ends[1]), process.linearize(state, HZ).matrix[:moving, -1]
    for part in (slice(0, moving // 2), slice(moving // 2, moving)):
        assert np.linalg.norm(found[part] - truth[part]) < 0.15 * np.linalg.norm(truth[part])


def marks_of(network, n_frames):
    """Frames of marks to half a millimetre, of the body pulled by a weight that swings at 0.5 Hz and poked once."""
    assembly, free = Assembly.of_network(network), network.free
    place = {name: int(np.flatnonzero(free == network.index(name))[0]) for name in MARKED}
    basis = np.hstack(
        [np.kron(np.ones((len(free), 1)), np.eye(3)), np.eye(3 * len(free))[:, 3 * place["N44"]][:, None]]
    )
    motion = Rosenbrock(assembly, np.repeat(network.masses[free], 3), basis, np.full(4, 1e9), 1e-5)
    state, rng = np.r_[network.positions[free].ravel(), np.zeros(3 * len(free) + 4)], np.random.default_rng(2)
    frames = []
    for k in range(n_frames):
        pulled = 0.5 * np.sin(np.pi * k * HZ)
        state[-4:] = [0.0, pulled, 0.5 * pulled, 4.0 * (3 <= k < 6)]
        state = motion.moves(state, HZ, HZ / 4.0, derivatives=False)[-1].state
        places = state[: 3 * len(free)].reshape(-1, 3)
        cov = 2.5e-7 * np.eye(3)
        marks = [MarkMeasurement(name, places[i] + 5e-4 * rng.normal(size=3), cov) for name, i in place.items()]
        frames.append(((k + 1) * HZ, marks))
    return frames


def estimates(network, frames):
    tissue = TissueFilter(network, TARGET, MARKED)
    return tissue, followed(tissue, frames)


@pytest.fixture(scope="module")
def both(body):
    """The filter in few shapes and that of all nodes after the same marks, with their estimates."""
    frames = marks_of(body, 7)
    few = estimates(body, frames)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(model, "FEWER", 0.0)
        every = estimates(body, frames)
    assert few[0].process.span.matrix.shape[1] < 0.75 * every[0].process.span.matrix.shape[1]
    return few, every


def test_the_target_is_where_all_nodes_say(both):
    """In every frame within a fifth of its standard deviation, which is the same to a tenth."""
    for few, every in zip(both[0][1], both[1][1], strict=True):
        sigma = np.sqrt(np.trace(every.cov))
        assert np.linalg.norm(few.mean - every.mean) < 0.2 * sigma
        assert np.sqrt(np.trace(few.cov)) == pytest.approx(sigma, rel=0.1)


def test_a_known_force_moves_the_target_as_it_does_by_all_nodes(both, body):
    """A push of the end for a tenth of a second, to a tenth of the shift."""

    def push(tissue):
        force = np.zeros((len(body.free), 3))
        force[-9:] = [0.0, 0.01, 0.0]
        now = tissue.time_s
        return tissue.predict_at(now + 0.1, force).mean - tissue.predict_at(now + 0.1).mean

    few, every = (push(one[0]) for one in both)
    assert np.linalg.norm(every) > 5e-4
    assert np.linalg.norm(few - every) < 0.1 * np.linalg.norm(every)
