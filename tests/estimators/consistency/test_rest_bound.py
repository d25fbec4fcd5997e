"""The bound of a body at rest: closed forms, SciPy's Riccati equation, and the recursion that it is the end of."""

from dataclasses import replace

import numpy as np
from scipy.linalg import expm, solve_discrete_are
from scipy.optimize import brentq

from dynamics import OUTER, four_mass_phantom, rest_shape
from estimators import ForceMode, TissueModel, accumulated_noise, resting_bound
from tests.networks import held_masses

MARK = 1e-6 * np.eye(2)
QUIET = ForceMode(white=0.3, poke=1e-9, lasting_s=1.0)
POKED = ForceMode(white=0.05, poke=5.0, lasting_s=0.2)


def test_of_many_frames_a_second_it_is_kalman_and_bucys() -> None:
    """Of x'' = -w² x + white noise of density q, seen with noise of density r: p11 = sqrt(2 r p12), p12 as below.

    The steady Riccati equation of two states, in closed form; frames every 0.1 ms change it by 2e-3.
    """
    dt, w2, q = 1e-4, 80.0, 0.3**2
    r = 1e-3 * dt
    p12 = r * (np.sqrt(w2**2 + q / r) - w2)
    found = resting_bound(held_masses(), {"mass": 1e-3 * np.eye(2)}, dt, QUIET)
    np.testing.assert_allclose(np.diag(found)[:2], np.sqrt(2.0 * r * p12), rtol=3e-3)
    np.testing.assert_allclose([found[0, 2], found[1, 3]], p12, rtol=3e-3)


def test_it_solves_the_riccati_equation_of_the_phantom() -> None:
    """SciPy's solution by Schur vectors, 1e-5; pokes on the outer masses, no friction."""
    network = replace(four_mass_phantom(), friction=np.zeros(7))
    model = TissueModel(network, OUTER)
    A, density = model.linearised(rest_shape(network), POKED)
    rows = [i for node in OUTER for i in range(model.dim_x)[network.coordinates(node)]]
    H = np.eye(model.dim_x)[rows]
    F, Q = expm(A / 30.0), accumulated_noise(A, density, 1.0 / 30.0)
    before = solve_discrete_are(F.T, H.T, Q, 1e-6 * np.eye(len(rows)))
    K = before @ H.T @ np.linalg.inv(H @ before @ H.T + 1e-6 * np.eye(len(rows)))
    expected = before - K @ H @ before
    found = resting_bound(network, dict.fromkeys(OUTER, MARK), 1.0 / 30.0, POKED, poked=OUTER)
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(found / np.outer(scale, scale), expected / np.outer(scale, scale), atol=1e-5)


def test_what_no_mark_sees_is_known_only_as_well_as_an_hour_of_shaking_leaves_it() -> None:
    """Undamped, its variance grows by q / 2 w² a second and coordinate; the other mass is the same as alone."""
    network = held_masses(2)
    found = resting_bound(network, {"mass": MARK}, 1.0 / 30.0, QUIET)
    unseen = np.diag(found)[2:4]
    frames = 2.0 ** np.ceil(np.log2(3600.0 * 30.0))
    np.testing.assert_allclose(unseen, 0.3**2 / (2.0 * 80.0) * frames / 30.0, rtol=1e-3)
    alone = resting_bound(held_masses(), {"mass": MARK}, 1.0 / 30.0, QUIET)
    np.testing.assert_allclose(np.diag(found)[:2], np.diag(alone)[:2], rtol=1e-6)


def test_dry_friction_is_the_drag_of_its_own_speed() -> None:
    """Under white noise of density q² a held mass moves at v² = q² m / 2 d along each axis, d = drag + friction / v."""
    white, mass, drag, friction = 0.3, 0.5, 0.2, 0.05

    def excess(d: float) -> float:
        return drag + friction / np.sqrt(white**2 * mass / d + 5e-3**2) - d

    one = np.arange(5) == 0
    rough = replace(held_masses(), drag=np.where(one, drag, 0.0), friction=np.where(one, friction, 0.0))
    smooth = replace(rough, friction=np.zeros(5), drag=np.where(one, brentq(excess, drag, 20.0), 0.0))
    found, expected = (resting_bound(body, {"mass": 1e-2 * np.eye(2)}, 0.1, QUIET) for body in (rough, smooth))
    np.testing.assert_allclose(np.diag(found), np.diag(expected), rtol=1e-6)
    slippery = resting_bound(replace(rough, friction=np.zeros(5)), {"mass": 1e-2 * np.eye(2)}, 0.1, QUIET)
    assert found[0, 0] < 0.98 * slippery[0, 0]
