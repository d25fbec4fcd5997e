"""The process model: how pokes fade, what noise a step adds, how uncertainty grows."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad_vec
from scipy.linalg import eigh, expm

from dynamics import OUTER, integrate_adaptive
from estimators import ForceMode, TissueModel, accumulated_noise
from estimators.process.process_model import _without_growth

MODE = ForceMode(white=0.3, poke=5.0, lasting_s=0.2)


@pytest.fixture(scope="module")
def model(phantom):
    return TissueModel(phantom, OUTER)


def integrated(A, density, t):
    """Integral of e^{A s} D e^{A' s} over 0..t by adaptive quadrature, [vanloan1978] equation (1.1)'s right side."""
    return quad_vec(lambda s: expm(A * s) @ density @ expm(A.T * s), 0.0, t, epsabs=0.0, epsrel=1e-12)[0]


def test_state_is_the_networks_and_a_poke_for_each_marked_coordinate(model, phantom):
    """Documented order: pokes follow the state, node-major, in the order in which the marked nodes were named."""
    assert model.dim_x == 16 + 6
    assert model.poked_rows.tolist() == [0, 1, 4, 5, 6, 7]
    assert TissueModel(phantom, ("M4", "M1")).poked_rows.tolist() == [6, 7, 0, 1]


@pytest.mark.parametrize("dt", [1e-3, 1 / 240, 1 / 10])
def test_a_poke_fades_exponentially(model, rest_state, dt):
    """First-order Gauss-Markov: mean exp(-dt / tau) of what it was. Rounding."""
    pokes = np.random.default_rng(0).normal(size=(5, 6))
    moved = model.propagate(np.hstack([np.tile(rest_state, (5, 1)), pokes]), dt, MODE)
    np.testing.assert_allclose(moved[:, 16:], np.exp(-dt / 0.2) * pokes, rtol=0, atol=1e-15)


def test_a_fading_poke_moves_the_tissue_to_second_order(phantom, rest_state):
    """Against DOP853 under F exp(-t / tau) on M3: its mean over a step errs by O(dt²), seen over 0.2 s of steps.

    Without friction, whose bend over 5 mm/s makes an error of its own.

    Halving the steps quarters the error; at 1/240 s it is under 10 micrometres of a push that moves centimetres.
    """
    smooth = replace(phantom, friction=np.zeros(7))
    model, force = TissueModel(smooth, OUTER), np.zeros(8)
    force[4:6] = [1.5, -1.0]
    push = force.reshape(4, 2)
    exact = integrate_adaptive(smooth, rest_state, [0.0, 0.2], force=lambda t: np.exp(-t / 0.2) * push, rtol=1e-11)[-1]
    errors = []
    for n in (48, 96, 192):
        point = np.r_[rest_state, force[model.poked_rows]][None]
        for _ in range(n):
            point = model.propagate(point, 0.2 / n, MODE)
        errors.append(np.abs(point[0, :8] - exact[:8]).max())
    assert np.abs(exact - rest_state)[:8].max() > 0.02
    assert errors[0] < 1e-5
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert orders.min() >= 1.9
    assert orders.max() <= 2.1


def free_motion(model, mode):
    """A and density of free masses under white acceleration and fading pokes: dx = v, dv = F/m, dF = -F/tau."""
    A, density = np.zeros((22, 22)), np.zeros((22, 22))
    A[:8, 8:16] = np.eye(8)
    density[8:16, 8:16] = mode.white**2 * np.eye(8)
    for k, row in enumerate([0, 1, 4, 5, 6, 7]):
        A[8 + row, 16 + k] = 1.0 / 0.2  # kg of the phantom's masses
        A[16 + k, 16 + k] = -1.0 / mode.lasting_s
        density[16 + k, 16 + k] = 2.0 * (mode.poke * 0.2) ** 2 / mode.lasting_s
    return A, density


@pytest.mark.parametrize(("dt", "mode"), [(1 / 960, ForceMode(0.05, 0.05, 0.05)), (0.1, MODE)])
def test_noise_of_a_step_is_the_integral_of_free_motion(model, mode, dt):
    """Q = integral of e^{A s} D e^{A' s}, by quadrature to 1e-12; 1e-10 of each entry's own scale sqrt(Q_ii Q_jj)."""
    Q, expected = model.noise(dt, mode), integrated(*free_motion(model, mode), dt)
    scale = np.sqrt(np.outer(expected.diagonal(), expected.diagonal()))
    np.testing.assert_allclose(Q / scale, expected / scale, rtol=0, atol=1e-10)
    np.testing.assert_array_equal(Q, Q.T)
    assert np.linalg.eigvalsh(Q / scale)[0] > 0


def test_steps_are_of_at_most_a_120th_of_a_second(phantom):
    """Half the stability limit of the phantom is longer than that; an interval of 0.1 s takes twelve steps."""
    assert TissueModel(phantom, OUTER).stepper.n_steps(0.1) == 12


def test_linearised_motion_is_the_slope_of_the_model(model, phantom, rest_state):
    """exp(A dt) against central differences of `propagate` at rest, by 1e-6 m, m/s and N. dt = 1 ms.

    The poke's mean over the step stands for its course: (dt/tau)-fold, 1e-3 times its effect F dt²/2m = 2.5e-6.
    """
    A, _ = model.linearised(phantom.positions, MODE)
    start, h, dt = np.r_[rest_state, np.zeros(6)], 1e-6, 1e-3
    ahead, back = (model.propagate(start + sign * h * np.eye(22), dt, MODE) for sign in (1.0, -1.0))
    np.testing.assert_allclose((ahead - back).T / (2 * h), expm(A * dt), rtol=0, atol=1e-6)


def test_linearised_noise_is_that_of_a_short_step(model, phantom):
    """Over 1e-6 s springs do nothing: `accumulated_noise` of `linearised` is `noise` to 43/s times 1e-6 s."""
    A, density = model.linearised(phantom.positions, MODE)
    grown, noise = accumulated_noise(A, density, 1e-6), model.noise(1e-6, MODE)
    scale = np.sqrt(np.outer(noise.diagonal(), noise.diagonal()))
    np.testing.assert_allclose(grown / scale, noise / scale, rtol=0, atol=1e-4)


@pytest.mark.parametrize("t", [1e-3, 1.0, 500.0])
def test_covariance_of_free_motion_grows_by_its_closed_form(t):
    """White acceleration of density q: q [[t³/3, t²/2], [t²/2, t]], with no damping at all. Rounding of doublings."""
    A, density = np.array([[0.0, 1.0], [0.0, 0.0]]), np.diag([0.0, 0.7])
    expected = 0.7 * np.array([[t**3 / 3, t**2 / 2], [t**2 / 2, t]])
    np.testing.assert_allclose(accumulated_noise(A, density, t), expected, rtol=1e-11)


@pytest.mark.parametrize("t", [0.01, 0.3])
def test_covariance_grows_as_quadrature_says(model, phantom, t):
    """Van Loan's blocks against the integral itself, relative to sqrt(P_ii P_jj). Quadrature 1e-12, expm's rounding."""
    A, density = model.linearised(phantom.positions, MODE)
    expected = integrated(A, density, t)
    scale = np.sqrt(np.outer(expected.diagonal(), expected.diagonal()))
    found = accumulated_noise(A, density, t)
    np.testing.assert_allclose(found / scale, expected / scale, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(found, found.T)


@pytest.mark.parametrize("squares", [(-4.0, 2.0, 0.5), (-4.0, -2.0, 0.5), (-4.0, -2.0, 30.0)])
def test_motions_of_negative_stiffness_do_not_grow(squares):
    """By SciPy's modes of K v = w² M v, V' M V = 1: -K / M is V diag(squares) V' M; those above nothing become nothing.

    To rounding; masses of 1, 2 and 5, modes that are not those of the coordinates.
    """
    mass = np.array([1.0, 2.0, 5.0])
    form = np.random.default_rng(5).normal(size=(3, 3))
    modes = eigh(form + form.T, np.diag(mass))[1]
    growing = modes @ np.diag(squares) @ modes.T * mass
    expected = modes @ np.diag(np.minimum(squares, 0.0)) @ modes.T * mass
    np.testing.assert_allclose(_without_growth(growing, mass), expected, rtol=0, atol=1e-12 * max(np.abs(squares)))
