"""Linearised motion against sigma points' motion, closed forms of noise, and which networks are moved so."""

from dataclasses import replace

import numpy as np
import pytest

from dynamics import OUTER, independent_uncertainty, integrate_adaptive, parameters, rest_shape
from estimators import FixBias, ForceMode, TissueModel, accumulated_noise
from estimators.process.known_force import KnownForce
from estimators.process.linear_motion import MANY_STATES, LinearisedTissue, is_linearised

QUIET = ForceMode(white=0.3, poke=0.5, lasting_s=0.05)
POKED = ForceMode(white=0.3, poke=5.0, lasting_s=0.2)
MODES = (QUIET, POKED)
DT = 1 / 120


@pytest.fixture(scope="module")
def smooth(phantom):
    """The phantom without friction, whose bend over 5 mm/s makes an error of its own."""
    return replace(phantom, friction=np.zeros(phantom.n_nodes))


@pytest.fixture(scope="module")
def resting(smooth):
    rest = rest_shape(smooth)
    return np.r_[rest[smooth.free].ravel(), np.zeros(8)]


def about(model, resting):
    """A state for each mode: away from rest, moving, poked."""
    states = np.zeros((2, model.dim_x))
    states[:, :16] = resting
    states[:, 8:16] = 0.1 * np.random.default_rng(2).normal(size=(2, 8))
    states[:, model.pokes] = [[0.1], [-0.3]]
    return states


def test_to_first_order_it_moves_as_sigma_points_do(smooth, resting):
    """Ends as Runge-Kutta's, places within 5 micrometres; matrices as central differences of it, within a hundredth."""
    model = TissueModel(smooth, OUTER)
    states, eps = about(model, resting), 1e-5
    found = LinearisedTissue(model)(states, DT, MODES, None)
    moved = model.propagate_each(states[:, None], DT, MODES)[:, 0]
    np.testing.assert_allclose(found.ends[:, :8], moved[:, :8], rtol=0, atol=5e-6)
    np.testing.assert_allclose(found.ends, moved, rtol=0, atol=5e-4)
    steps = eps * np.eye(model.dim_x)
    ahead, behind = (model.propagate_each(states[:, None] + sign * steps, DT, MODES) for sign in (1.0, -1.0))
    slopes = (ahead - behind).swapaxes(1, 2) / (2.0 * eps)
    np.testing.assert_allclose(found.F, slopes, rtol=0, atol=0.01 * np.abs(slopes).max())
    np.testing.assert_allclose(found.F[:, :8, :8], slopes[:, :8, :8], rtol=0, atol=2e-3)


def test_its_noise_is_that_of_the_linearised_equations(smooth, resting):
    """A second of pokes about rest: van Loan's covariance, standard deviations within three per cent."""
    model = TissueModel(smooth, OUTER)
    shape = rest_shape(smooth)
    state = np.r_[resting, np.zeros(6)]
    found = LinearisedTissue(model).noise_after(state, POKED, 1.0)
    wanted = accumulated_noise(*model.linearised(shape, POKED), 1.0)
    np.testing.assert_allclose(np.sqrt(np.diag(found)), np.sqrt(np.diag(wanted)), rtol=0.03)
    scale = np.sqrt(np.outer(np.diag(wanted), np.diag(wanted)))
    np.testing.assert_allclose(found / scale, wanted / scale, rtol=0, atol=0.05)


def test_its_white_noise_has_the_level_that_is_learnt(smooth, resting):
    """Ten times the level adds nine times the product of its root to the noise, over steps of one mode each. Rounding.

    A mode that has white noise alone has no other noise but that.
    """
    model = TissueModel(smooth, OUTER)
    states, modes = about(model, resting), (QUIET, ForceMode(white=0.2, poke=0.0, lasting_s=0.1))
    once, ten = (LinearisedTissue(model)(states, 1 / 30, modes, None, level) for level in (1.0, 10.0))
    part = once.white @ once.white.swapaxes(1, 2)
    np.testing.assert_allclose(ten.Q - once.Q, 9.0 * part, rtol=1e-9, atol=1e-20)
    np.testing.assert_allclose(ten.white, np.sqrt(10.0) * once.white, rtol=1e-12, atol=1e-20)
    np.testing.assert_allclose(part[1], once.Q[1], rtol=1e-9, atol=1e-20)


def test_constants_in_error_move_it_as_they_move_sigma_points(smooth, resting):
    """Columns after a step, against `propagate_columns`, which moves them beside the mean."""
    uncertainty = independent_uncertainty(parameters(smooth, ("stiffness", "rest_length")), 0.1)
    model = TissueModel(smooth, OUTER, uncertainty=uncertainty, n_calibration=2)
    states = about(model, resting)
    columns = 1e-3 * np.random.default_rng(3).normal(size=(2, model.dim_x, model.n_columns))
    found = LinearisedTissue(model)(states, DT, MODES, None)
    wanted = model.propagate_columns(states, columns, DT, MODES)
    made = found.F @ columns + found.added
    np.testing.assert_allclose(made[:, :16], wanted[:, :16], rtol=0, atol=0.03 * np.abs(wanted[:, :16]).max())
    assert not found.added[:, :, -2:].any()


def test_a_known_force_pushes_it(smooth, resting):
    """0.5 N on M3 for a cycle of 1/30 s, against Runge-Kutta's steps under it."""
    model, force = TissueModel(smooth, OUTER), np.zeros((4, 2))
    force[2] = [0.0, 0.5]
    states = about(model, resting)
    pushed = LinearisedTissue(model)(states, 1 / 30, MODES, KnownForce(lambda _t, _s: force, smooth, 0.0))
    left = LinearisedTissue(model)(states, 1 / 30, MODES, None)
    moved = states[:, None]
    for _ in range(4):
        model.push = KnownForce(force, smooth, 0.0)
        moved = model.propagate_each(moved, DT, MODES)
    np.testing.assert_allclose(pushed.ends[:, :8], moved[:, 0, :8], rtol=0, atol=2e-5)
    assert np.abs(pushed.ends - left.ends)[:, :8].max() > 1e-4


def test_a_node_that_is_led_moves_as_its_hand_does(smooth, resting):
    """By its velocity and a fading push alone, in closed form; the others as where that path is an anchor's.

    Adaptive integration of the network in which a mass of a million tons without weight moves so, over 1/30 s.
    """
    lasting, push, dt = 0.25, 30.0, 1 / 30
    model = TissueModel(smooth, OUTER, led=(("M3",), ForceMode(white=1.0, poke=50.0, lasting_s=lasting)), stiff=True)
    rows = model.led_rows
    k = smooth.index("M3")
    state = np.zeros((1, model.dim_x))
    state[0, :16] = resting
    state[0, 8 + rows] = [0.3, -0.2]
    on = model.pokes.start + np.flatnonzero(np.isin(model.poked_rows, rows))
    state[0, on] = push * smooth.masses[k] * np.array([1.0, 0.5])
    found = LinearisedTissue(model)(state, dt, (QUIET,), None)
    gone = -np.expm1(-dt / lasting)
    ahead = dt * np.array([0.3, -0.2]) + push * lasting * np.array([1.0, 0.5]) * (dt - lasting * gone)
    np.testing.assert_allclose(found.ends[0, rows], resting[rows] + ahead, rtol=0, atol=5e-5)
    np.testing.assert_allclose(
        found.ends[0, 8 + rows], [0.3 + push * lasting * gone, -0.2 + 0.5 * push * lasting * gone], rtol=0, atol=1e-3
    )
    masses = smooth.masses.copy()
    masses[k] = 1e9
    forces = np.zeros((smooth.n_nodes, 2))
    forces[k] = -1e9 * smooth.gravity

    def hand(time_s):
        own = forces.copy()
        own[k] += 1e9 * push * np.array([1.0, 0.5]) * np.exp(-time_s / lasting)
        return own[smooth.free]

    truth = integrate_adaptive(replace(smooth, masses=masses), state[0, :16], [0.0, dt], force=hand)[-1]
    np.testing.assert_allclose(truth[rows], resting[rows] + ahead, rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.ends[0, :8], truth[:8], rtol=0, atol=2e-4)
    apart = np.setdiff1d(np.arange(16), [*rows, *(8 + rows)])
    np.testing.assert_allclose(found.F[0][np.ix_(rows, apart)], 0.0, atol=1e-6)


def test_the_bias_of_fixes_fades(smooth, resting):
    """First-order Gauss-Markov, apart from all else: mean and variance by its closed form. Rounding."""
    model = TissueModel(smooth, OUTER, bias=FixBias(0.01, 2.0))
    states = np.zeros((1, model.dim_x))
    states[0, :16], states[0, model.bias_rows] = resting, 0.01
    found = LinearisedTissue(model)(states, 1 / 30, (QUIET,), None)
    fade = np.exp(-(1 / 30) / 2.0)
    np.testing.assert_allclose(found.ends[0, model.bias_rows], 0.01 * fade, rtol=1e-12)
    own = found.Q[0, model.bias_rows, model.bias_rows]
    np.testing.assert_allclose(own, (1.0 - fade**2) * 1e-4 * np.eye(2), rtol=0, atol=1e-9)


def chain_of(phantom, places, *, mass, stiffness, damping):
    """A chain of equal masses [kg] and springs [N/m, N s/m] from an anchor, at rest in these places [m], (n + 1, 2)."""
    n = len(places) - 1
    return replace(
        phantom,
        names=("anchor", *(f"n{i}" for i in range(n))),
        positions=places,
        masses=np.full(n + 1, mass),
        fixed=np.arange(n + 1) == 0,
        drag=np.zeros(n + 1),
        friction=np.zeros(n + 1),
        springs=np.column_stack([np.arange(n), np.arange(1, n + 1)]),
        stiffness=np.full(n, stiffness),
        rest_lengths=np.linalg.norm(np.diff(places, axis=0), axis=1),
        damping=np.full(n, damping),
    )


def test_a_large_body_is_linearised_half_way(phantom):
    """A chain of 25 masses that swings by 20 degrees in a cycle: what it makes of changes of speed is 14 % off.

    Against ends of cycles that begin with them; by matrices about the state at its start it is 25 % off.
    """
    n, L, turned = 25, 0.05, 0.35
    places = np.column_stack([np.zeros(n + 1), -L * np.arange(n + 1)])
    chain = chain_of(phantom, places, mass=0.02, stiffness=200.0, damping=0.5)
    model, dt = TissueModel(chain, ("n0",)), 1 / 30
    motion = LinearisedTissue(model)
    state = np.zeros((1, model.dim_x))
    half = chain.n_state // 2
    state[0, :half] = chain.positions[1:].ravel()
    state[0, half : 2 * half : 2] = turned / dt * L * np.arange(1, n + 1)
    found = motion(state, dt, (QUIET,), None)
    rng = np.random.default_rng(0)
    off = {"half way": [], "start": []}
    for _ in range(5):
        change = np.zeros(model.dim_x)
        change[half : 2 * half] = 0.05 * rng.normal(size=half)
        ends = motion.stepper.advance((state + [[1.0], [-1.0]] * change)[:, : 2 * half], dt, np.zeros((2, half)))
        true = 0.5 * (ends[0] - ends[1])[:half]
        at_start = motion.stepper.linearised(state[:, : 2 * half], dt).F[0] @ change[: 2 * half]
        off["half way"].append(np.linalg.norm((found.F[0] @ change)[:half] - true) / np.linalg.norm(true))
        off["start"].append(np.linalg.norm(at_start[:half] - true) / np.linalg.norm(true))
    assert np.mean(off["half way"]) < 0.65 * np.mean(off["start"])
    np.testing.assert_allclose(found.straight[:half], 0.1 * L)


@pytest.fixture(scope="module")
def link(phantom):
    """20 g on a link of 0.1 m and 2,000 N/m, whose angle and turning rate are free: `turning` makes a state of it."""
    network = chain_of(phantom, np.array([[0.0, 0.0], [0.0, -0.1]]), mass=0.02, stiffness=2000.0, damping=1.0)
    return TissueModel(network, ("n0",), stiff=True)


def turning(model, rate):
    """Hanging, its free end passing at this rate [rad/s]; (1, dim_x)."""
    return np.r_[0.0, -0.1, 0.1 * rate, 0.0, np.zeros(2)][None]


def test_a_turning_link_is_linearised_about_the_middle_of_a_step(link):
    """It turns by 0.3 rad within a frame of two steps: central differences of two hundred, along the free end's way.

    A change of its speed moves it 2 % off so, and 10 % by matrices about the starts of the steps.
    """
    state, dt, change = turning(link, 18.0), 1 / 60, 1e-3
    motion = LinearisedTissue(link)
    ends = (state + [[change], [-change]] * np.eye(6)[2])[:, :4]
    for _ in range(200):
        ends = motion.stepper.advance(ends, dt / 200, np.zeros((2, 2)))
    true = 0.5 * (ends[0] - ends[1])[:2] / change
    found = motion(state, dt, (QUIET,), None).F[0, :2, 2]
    now, F = state[:, :4], np.eye(4)
    for _ in range(2):
        F = motion.stepper.linearised(now, dt / 2).F[0] @ F
        now = motion.stepper.advance(now, dt / 2, np.zeros((1, 2)))
    assert np.linalg.norm(found - true) < 0.03 * np.linalg.norm(true)
    assert np.linalg.norm(F[:2, 2] - true) > 0.08 * np.linalg.norm(true)


@pytest.mark.parametrize(("rate", "n_steps"), [(0.0, 4), (10.0, 4), (70.0, 8), (1000.0, 8)])
def test_a_link_that_turns_fast_takes_shorter_steps(link, rate, n_steps):
    """Of a cycle of 1/30 s four of 1/120 s, more where it turns by 0.3 rad in one, twice as many at most.

    Each step has a root of the white noise of the two coordinates.
    """
    found = LinearisedTissue(link)(turning(link, rate), 1 / 30, (QUIET,), None)
    assert found.white.shape[2] == 2 * n_steps


def test_motions_of_unequal_steps_are_chosen_between(link):
    """Of two modes the first goes on slowly, the other fast, in twice the steps: each keeps its own noise."""
    motion, modes = LinearisedTissue(link), (QUIET, POKED)
    slow, fast = (motion(np.repeat(turning(link, rate), 2, axis=0), 1 / 30, modes, None) for rate in (1.0, 70.0))
    for better in ([False, True], [True, False]):
        made = slow.chosen(fast, np.array(better))
        for k, other in enumerate(better):
            own = fast if other else slow
            np.testing.assert_array_equal(made.F[k], own.F[k])
            part = made.white[k] @ made.white[k].T
            np.testing.assert_allclose(part, own.white[k] @ own.white[k].T, rtol=1e-12, atol=1e-25)


def test_stiff_and_large_networks_are_moved_so(phantom):
    """The paper's phantom is not; with springs fifty times as stiff, or so many more nodes, it would be."""
    assert not is_linearised(TissueModel(phantom, OUTER))
    stiff = replace(phantom, stiffness=50.0 * phantom.stiffness)
    assert is_linearised(TissueModel(stiff, OUTER))
    n = MANY_STATES // 4 + 1
    places = np.column_stack([0.1 * np.arange(n + 1), np.zeros(n + 1)])
    chain = chain_of(phantom, places, mass=0.1, stiffness=5.0, damping=0.1)
    assert is_linearised(TissueModel(chain, ("n0",)))


def test_white_noise_moves_what_is_faster_than_a_step(phantom):
    """A mass that an overdamped spring returns to 1/e within 2 ms, steps of 8.3 ms: half its variance, or more.

    Of dx/dt = v, dv/dt = -k x - c v + white noise q in the long run: q² / (2 k c). A force that is
    constant in a step makes 2 c / (k h) of that where the mass follows it, kicks half a step before its end 0.09.
    """
    k, c, q = 4e6, 8e3, 0.3
    network = replace(
        chain_of(phantom, np.array([[0.0, 0.0], [0.0, -0.1]]), mass=1.0, stiffness=k, damping=0.0),
        drag=np.full(2, c),
        gravity=np.zeros(2),
    )
    model = TissueModel(network, ("n0",), stiff=True)
    state = np.r_[0.0, -0.1, np.zeros(4)]
    motion = LinearisedTissue(model)(state[None], DT, (ForceMode(white=q, poke=0.0, lasting_s=0.1),), None)
    exact = q**2 / (2.0 * k * c)
    assert motion.Q[0, 1, 1] == pytest.approx(2.0 * c / (k * DT) * exact, rel=0.2, abs=0.0)


@pytest.mark.parametrize(("stiffness", "linearised"), [(800.0, False), (4000.0, True)])
def test_networks_take_two_substeps_before_they_count_as_stiff(phantom, stiffness, linearised):
    """Springs of 800 N/m move with stability in twice the steps, those of 4,000 N/m would need more."""
    springs = {"springs": phantom.springs[:8], "rest_lengths": phantom.rest_lengths[:8], "damping": phantom.damping[:8]}
    model = TissueModel(replace(phantom, stiffness=np.full(8, stiffness), **springs), OUTER)
    assert model.stepper.max_step_s < 1 / 120
    assert (model.stepper.max_step_s < 1 / 240) is linearised
    assert is_linearised(model) is linearised
