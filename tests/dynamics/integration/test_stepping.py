"""Motion in time against closed forms, conserved quantities and SciPy's adaptive integrator."""

import numpy as np
import pytest

from dynamics import Stepper, integrate_adaptive, pack, stable_step, unpack
from dynamics.integration.stepping import LONGEST_STEP


def thrown(network, seed=4, spread=0.03, speed=0.5):
    """A state away from the drawn shape and moving, (n_state,)."""
    rng = np.random.default_rng(seed)
    shape = (len(network.free), network.dim)
    return pack(network.positions[network.free] + spread * rng.normal(size=shape), speed * rng.normal(size=shape))


def one(stepper, state, dt, force=None):
    return stepper.advance(state[None], dt, None if force is None else force[None])[0]


# One mass on a spring along x: k/m = 400/s², w = 20/s, starting 10 mm out and at 0.1 m/s.
OUT, SPEED, W = 0.01, 0.1, 20.0


def phase_error(decay, t, h):
    """Runge-Kutta's leading error of exp(lambda t), |lambda| = w: (w h)⁴/120 w t of what is left of the amplitude."""
    return 1.2 * (W * h) ** 4 / 120 * W * t * np.hypot(OUT, SPEED / W) * np.exp(-decay * t)


@pytest.mark.parametrize("g", [0.0, 9.81])
@pytest.mark.parametrize("c", [0.0, 0.8])
@pytest.mark.parametrize("t", [0.1, 1.0])
def test_one_mass_on_a_spring_swings_by_its_closed_form(build, c, g, t):
    """Closed form x = rest + e^{-a t} (A cos wd t + B sin wd t), a = c / 2m, wd² = k/m - a², rest = l0 + m g / k.

    Tolerance: the leading error of the scheme, `phase_error`, 20 % added for the terms that follow and for a < w.
    """
    h = 1.0 / 240.0
    mass = build([[0.0, 0.0], [1.0, 0.0]], [(0, 1)], [0], damping=c, gravity=[g, 0.0])
    rest, a = 1.0 + 0.2 * g / 80.0, c / 0.4
    wd = np.sqrt(W * W - a * a)
    x, y, vx, vy = one(Stepper(mass, h), np.array([rest + OUT, 0.0, SPEED, 0.0]), t)
    A, B = OUT, (SPEED + a * OUT) / wd
    fade, cos, sin = np.exp(-a * t), np.cos(wd * t), np.sin(wd * t)
    assert x == pytest.approx(rest + fade * (A * cos + B * sin), rel=0, abs=phase_error(a, t, h))
    expected = fade * ((B * wd - a * A) * cos - (A * wd + a * B) * sin)
    assert vx == pytest.approx(expected, rel=0, abs=W * phase_error(a, t, h))
    assert (y, vy) == (0.0, 0.0)


@pytest.mark.parametrize("dim", [2, 3])
def test_observed_order_is_four(tangled, dim):
    """Error against DOP853 at 1e-13 halves by 2⁴; three halvings, from steps small enough for the leading term."""
    network = tangled(dim, friction=0.0)
    state, t = thrown(network), 0.4
    exact = integrate_adaptive(network, state, [0.0, t], rtol=1e-13, atol=1e-15)[-1]
    steps = t / np.array([160, 320, 640])
    errors = [np.abs(one(Stepper(network, h), state, t) - exact).max() for h in steps]
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert orders.min() >= 3.9
    assert orders.max() <= 4.1


def test_a_free_network_keeps_its_momentum_and_angular_momentum(build):
    """Without anchors, drag and gravity sum m v and sum m x ^ v stay, dashpots or not. Momentum: linear, so rounding.

    Angular momentum is quadratic: the scheme keeps it to O(h⁴), seen to fall below 1e-9 of its value at 1/960 s.
    """
    corners = [[0.0, 0, 0], [0.3, 0, 0.1], [0.3, 0.3, -0.1], [0, 0.3, 0.2]]
    pairs = [(i, j) for i in range(4) for j in range(i)]
    network = build(corners, pairs, masses=[0.1, 0.2, 0.3, 0.4], damping=0.3)
    state = thrown(network)

    def momenta(state):
        x, v = unpack(state, 3)
        p = network.masses[:, None] * v
        return p.sum(axis=0), np.cross(x, p).sum(axis=0)

    linear, angular = momenta(state)
    later_linear, later_angular = momenta(one(Stepper(network, 1.0 / 960.0), state, 2.0))
    np.testing.assert_allclose(later_linear, linear, rtol=0, atol=1e-14)
    np.testing.assert_allclose(later_angular, angular, rtol=0, atol=1e-9 * np.abs(angular).max())


def test_both_adaptive_methods_agree(phantom):
    """RK45 against DOP853, each to its tolerance 1e-9 a step over some hundred steps."""
    state = thrown(phantom)
    ends = [integrate_adaptive(phantom, state, [0.0, 0.5], method=method)[-1] for method in ("RK45", "DOP853")]
    np.testing.assert_allclose(ends[0], ends[1], rtol=0, atol=2e-8)


def test_a_short_force_is_seen_where_the_longest_step_says_so(build):
    """A push of 1 N for 1 ms at 10 ms on a mass at rest: v just after is 1e-3 N s / 0.2 kg less (w 1 ms)²/6 of it."""
    mass = build([[0.0, 0.0], [1.0, 0.0]], [(0, 1)], [0])
    start = np.array([1.0, 0.0, 0.0, 0.0])

    def push(t):
        return [[1.0 if 0.01 <= t < 0.011 else 0.0, 0.0]]

    seen = integrate_adaptive(mass, start, [0.0, 0.011], force=push, max_step_s=2e-5)[-1]
    assert seen[2] == pytest.approx(5e-3, rel=5e-3)  # a step across either edge: 2e-5 of 1e-3 s each


def test_no_step_crosses_a_bend_of_the_force(build):
    """A half sine of 1 N for 1 ms from 50 ms on, of which no step sees anything without its bends: 2/pi 1e-3 N s."""
    mass = build([[0.0, 0.0], [1.0, 0.0]], [(0, 1)], [0])
    start = np.array([1.0, 0.0, 0.0, 0.0])

    def push(t):
        return [[np.sin(np.pi * (t - 0.05) / 1e-3) if 0.05 <= t < 0.051 else 0.0, 0.0]]

    def seen(bends):
        return integrate_adaptive(mass, start, [0.0, 0.02, 0.051, 0.051], force=push, bends_s=bends)

    assert np.abs(seen(())[:, 2]).max() < 1e-12
    with_bends = seen([0.051, 0.05, 7.0, 0.05])
    np.testing.assert_allclose(with_bends[:2], [start, start], rtol=0, atol=1e-15)
    assert with_bends[2, 2] == pytest.approx(2.0 / np.pi * 1e-3 / 0.2, rel=2e-4)  # (w 1 ms)²/4 = 1e-4 of it at most
    np.testing.assert_array_equal(with_bends[2], with_bends[3])


def test_an_integration_that_gives_up_is_an_error(phantom):
    with pytest.raises(RuntimeError, match="integration from 0 to 1 s: "):
        integrate_adaptive(phantom, thrown(phantom), [0.0, 1.0], force=lambda t: np.nan if t > 0.5 else 0.0)


def test_no_time_is_no_motion_and_no_force_one_of_nothing(phantom):
    state, stepper = thrown(phantom)[None], Stepper(phantom)
    moved = stepper.advance(state, 0.0)
    np.testing.assert_array_equal(moved, state)
    assert moved is not state
    np.testing.assert_array_equal(stepper.advance(state, 0.1), stepper.advance(state, 0.1, np.zeros((1, 8))))


def test_steps_are_equal_and_none_longer_than_allowed(phantom):
    """240 steps a second by choice: 1/30 s is 8 of them, and a hair more is 9, but not a rounding error more."""
    stepper = Stepper(phantom)
    assert stepper.max_step_s == LONGEST_STEP == 1.0 / 240.0
    assert [stepper.n_steps(dt) for dt in (0.0, 1e-4, 1 / 240, 1 / 30, 8.01 / 240, 0.1)] == [1, 1, 1, 8, 9, 24]
    assert stepper.n_steps(0.1 + 0.2 - 0.3 + 1 / 30) == 8
    assert Stepper(phantom, 1.0).max_step_s == 0.5 * stable_step(phantom)  # whatever is asked for, it stays stable


@pytest.mark.parametrize(
    ("states", "forces"), [((1, 15), (1, 8)), ((2, 16), (1, 8)), ((2, 16), (2, 16)), ((16,), (8,)), ((1, 16), (8,))]
)
def test_other_shapes_are_refused(phantom, states, forces):
    with pytest.raises(ValueError, match=r"expected states \(n, 16\) and forces \(n, 8\)"):
        Stepper(phantom).advance(np.zeros(states), 0.1, np.zeros(forces))


@pytest.mark.parametrize("dt", [-1e-9, np.nan])
def test_time_does_not_go_back(phantom, dt):
    with pytest.raises(ValueError, match="dt: expected 0 s or more"):
        Stepper(phantom).advance(thrown(phantom)[None], dt)
