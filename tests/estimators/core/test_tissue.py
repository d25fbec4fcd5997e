"""The tissue as a process model: derivatives by finite differences, noise by draws, parts by their rules."""

from dataclasses import replace

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER, four_mass_phantom, node_forces
from dynamics.integration.kernels import along_steps
from estimators.core.disturbances import Disturbances
from estimators.core.tissue import SOURCES, TissueProcess
from tests.estimators.core.bodies import cable
from tests.networks import slab

DT = 1.0 / 30.0


@pytest.fixture(scope="module")
def process() -> TissueProcess:
    return TissueProcess(four_mass_phantom(), OUTER)


def swung(process: TissueProcess, seed: int = 1) -> np.ndarray:
    """A state away from rest: 2 mm, 0.1 m/s, 2 m/s² and a discrepancy of one standard deviation."""
    rng, state = np.random.default_rng(seed), process.prior(0.01)[0].copy()
    for name, scale in (("position", 2e-3), ("velocity", 0.1), ("force", 2.0), ("discrepancy", 1.0)):
        own = process.parts[name]
        state[own] += scale * rng.normal(size=own.stop - own.start)
    return state


def test_the_derivative_is_that_of_the_motion(process: TissueProcess) -> None:
    """Beside the turn of dashpots, which is of second order, to three hundredths of the largest entry of each block."""
    state = swung(process)
    found = process.linearize(state, DT)
    np.testing.assert_allclose(found.mean, process.moved(state, DT), rtol=1e-12)
    columns = []
    for k in range(process.n):
        step = np.zeros(process.n)
        step[k] = 1e-6
        columns.append((process.moved(state + step, DT) - process.moved(state - step, DT)) / 2e-6)
    exact = np.array(columns).T
    for rows in process.parts.values():
        for own in process.parts.values():
            scale = np.abs(exact[rows, own]).max()
            np.testing.assert_allclose(found.matrix[rows, own], exact[rows, own], atol=0.03 * scale + 1e-12)


def test_a_frame_of_a_cable_is_stepped_through_to_a_ten_thousandth_of_its_extent() -> None:
    """A swung cable after a frame, against 32 frames as short, whose steps are as much shorter."""
    process = TissueProcess(cable(8), [f"n{k}" for k in (1, 2, 6, 7, 8)])
    start = swung(process)
    start[process.parts["velocity"]] *= 10.0
    fine = start
    for _ in range(32):
        fine = process.moved(fine, DT / 32)
    own = process.parts["position"]
    assert np.abs(process.moved(start, DT) - fine)[own].max() < 2e-4 * process.extent_m


def test_unknown_forces_move_the_marked_nodes_as_accelerations(process: TissueProcess) -> None:
    """1 m/s² on M1 alone: velocity after a millisecond."""
    network, state = process.network, process.prior(0.01)[0].copy()
    place = network.coordinates("M1")
    at = OUTER.index("M1")
    state[process.parts["force"].start + network.dim * at] = 1.0
    moved = process.moved(state, 1e-3)[process.parts["velocity"]]
    still = process.moved(process.prior(0.01)[0], 1e-3)[process.parts["velocity"]]
    pushed = (moved - still) / 1e-3
    assert pushed[place.start] == pytest.approx(1.0, rel=0.02)
    pushed[place.start] = 0.0
    assert np.abs(pushed).max() < 0.02


def test_noise_is_that_of_its_source(process: TissueProcess) -> None:
    """Over a millisecond white noise has moved velocities alone, by w² t; each other source its own states."""
    found = process.linearize(process.prior(0.01)[0], 1e-3)
    white = found.noises[SOURCES.index("white")]
    own = process.parts["velocity"]
    np.testing.assert_allclose(np.diag(white)[own], 1e-3, rtol=0.05)
    assert np.abs(white[process.parts["force"]]).max() == 0.0
    for source, lasting in (("short", process.disturbances.short_s), ("slow", process.disturbances.slow_s)):
        grown = np.diag(found.noises[SOURCES.index(source)])[process.parts["force"]]
        np.testing.assert_allclose(grown[grown > 0.0], 1.0 - np.exp(-2e-3 / lasting), rtol=0.01)
    assert SOURCES.index("discrepancy") == len(found.noises)
    grown = found.independent[0][process.parts["discrepancy"]]
    np.testing.assert_allclose(grown, 1.0 - np.exp(-2e-3 / process.discrepancy.lasting_s), rtol=1e-9)


def test_noise_over_a_frame_is_that_of_many_draws(process: TissueProcess) -> None:
    """Covariance of 20,000 ends under white noise held over a 48th of the frame, moved by the derivative."""
    rng, n = np.random.default_rng(3), process.parts["velocity"].stop // 2
    start, steps = process.prior(0.01)[0], 48
    T = process.linearize(start, DT / steps).matrix[: 2 * n, : 2 * n]
    states = np.zeros((20_000, 2 * n))
    for _ in range(steps):
        pushed = states.copy()
        pushed[:, n:] += np.sqrt(DT / steps) * rng.normal(size=(len(states), n))
        states = pushed @ T.T
    found = process.linearize(start, DT).noises[0][: 2 * n, : 2 * n]
    drawn = states.T @ states / len(states)
    for rows in (slice(0, n), slice(n, 2 * n)):
        np.testing.assert_allclose(found[rows, rows], drawn[rows, rows], atol=0.1 * np.abs(drawn[rows, rows]).max())


def test_steps_together_are_each_after_the_other() -> None:
    """Derivative and noise of three steps, by matrices of the whole state and by Simpson's rule as written."""
    rng, half, m = np.random.default_rng(4), 3, 10
    by_states, fadings, steps_s = rng.normal(size=(3, 6, m)), rng.uniform(0.5, 0.9, (3, 4)), np.array([0.1, 0.2, 0.05])
    sources, white = np.array([0, 2, 0, 2]), np.array([1.0, 0.5, 2.0])
    motion, force, noises = along_steps(by_states, fadings, steps_s, sources, 3, white)
    T, expected, after = np.eye(m), np.zeros((4, m, m)), np.eye(6)[:, half:]
    for by_state, fading, step_s in zip(by_states, fadings, steps_s, strict=True):
        step = np.vstack([by_state, np.hstack([np.zeros((4, 6)), np.diag(fading)])])
        T, expected = step @ T, step @ expected @ step.T
        for source in range(3):
            expected[1 + source] += np.diag(np.append(np.zeros(6), (sources == source) * (1.0 - fading**2)))
        for share, weight in ((0.0, 1.0), (0.5, 4.0), (1.0, 1.0)):
            pushed = ((1.0 - share) * by_state[:, half:6] + share * after) * white
            expected[0, :6, :6] += weight * step_s / 6.0 * pushed @ pushed.T
    np.testing.assert_allclose(np.vstack([motion, np.hstack([np.zeros((4, 6)), np.diag(force)])]), T, atol=1e-12)
    np.testing.assert_allclose(noises, expected, atol=1e-12 * np.abs(expected).max())


def test_strengths_by_mode() -> None:
    """For a soft body as stated; a led node is led in every mode."""
    network = four_mass_phantom()
    found = TissueProcess(network, OUTER, led=("M3",), disturbances=Disturbances(bent=0.0))
    rows = found.variances(0.02)
    d = found.disturbances
    assert rows.shape == (9, len(SOURCES))
    np.testing.assert_allclose(np.unique(rows[:, 1]), np.square([d.calm_m_s2, d.poke_m_s2, d.led_m_s2]))
    np.testing.assert_allclose(rows[:, 2], d.led_m_s2**2)
    np.testing.assert_allclose(np.unique(rows[:, 3]), np.square(d.slow_m_s2))
    np.testing.assert_allclose(rows[:, 4], 0.02**2)
    assert found.rates.shape == (9, 9)
    np.testing.assert_allclose(found.rates.sum(axis=1), 0.0, atol=1e-12)


@pytest.mark.parametrize("n_marked", [2, 20])
def test_a_poke_pushes_three_nodes_at_most(n_marked: int) -> None:
    """With more marks the variances of their pokes sum up to that of three; each led node is led as strongly."""
    body = slab((3, 4, 4))
    process = TissueProcess(body, body.names[16 : 16 + n_marked], disturbances=Disturbances(bent=0.0))
    _, poked, led = np.unique(process.variances(0.0)[:, 1])
    assert poked == pytest.approx(5.0**2 * min(1.0, 3.0 / n_marked))
    assert led == pytest.approx(50.0**2)


def test_a_stiff_body_is_pushed_harder() -> None:
    """Its slowest oscillation a hundred times as fast: forces that bend it as far are ten thousand times as strong."""
    network = four_mass_phantom()
    stiff = replace(network, stiffness=1e4 * network.stiffness)
    soft, hard = (TissueProcess(one, OUTER).variances(0.0)[1, 1] for one in (network, stiff))
    assert hard / soft == pytest.approx(1e8, rel=0.2)


def test_slow_forces_act_on_marked_nodes_and_on_all_of_a_cable() -> None:
    """The hidden mass of the phantom is inside: only the acceleration of all mass acts on it. No node of a cable is."""
    phantom = TissueProcess(four_mass_phantom(), OUTER)
    at = list(phantom.network.free).index(phantom.network.index(HIDDEN))
    state = phantom.prior(0.0)[0]
    slow = slice(phantom.parts["force"].start + 2 * len(OUTER), phantom.parts["force"].stop)
    own = phantom.parts["velocity"].start + 2 * at
    by_slow = np.abs(phantom.linearize(state, 1e-3).matrix[own, slow])
    assert by_slow[:-2].max() < 1e-5
    assert by_slow[-2] == pytest.approx(1e-3, rel=0.02)
    network = cable(8)
    hanging = TissueProcess(network, [network.names[k] for k in (1, 2, 6, 7)])
    slow = slice(hanging.parts["force"].start + 3 * 4, hanging.parts["force"].stop)
    own = hanging.parts["velocity"].start + 3 * 3
    assert np.abs(hanging.linearize(hanging.prior(0.0)[0], 1e-3).matrix[own, slow]).max() > 1e-4


def test_a_body_without_anchors_is_weightless() -> None:
    """Nobody says what holds it: at rest as drawn it stays."""
    network = cable(4, held=False)
    process = TissueProcess(network, network.names)
    state = process.prior(0.0)[0]
    np.testing.assert_allclose(process.moved(state, 0.1), state, atol=1e-12)
    assert np.abs(node_forces(network, network.positions, np.zeros_like(network.positions))).max() > 0.01
