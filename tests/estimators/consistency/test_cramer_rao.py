"""The posterior Cramér-Rao bound: the Kalman covariance where all is linear, and its scaling with the noise."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from dynamics import pack
from estimators import ForceMode, accumulated_noise, posterior_bound
from tests.networks import held_masses

R = 1e-6 * np.eye(2)


@pytest.fixture(scope="module")
def taut():
    return held_masses(drag=0.4)


A = np.block([[np.zeros((2, 2)), np.eye(2)], [-80.0 * np.eye(2), -0.8 * np.eye(2)]])
"""Of the mass: two springs of 20 N/m along each axis, 0.4 N s/m, 0.5 kg."""
WHITE = ForceMode(white=0.3, poke=1e-12, lasting_s=1.0)
DENSITY = np.diag([0.0, 0.0, 0.09, 0.09])


def textbook(marks, dt, start):
    """Kalman's covariances with the matrices of `A`, exponentials by SciPy: marks taken in where there are any."""
    F, Q = expm(A * dt), accumulated_noise(A, DENSITY, dt)
    P, H, found = start, np.eye(4)[:2], []
    for k, seen in enumerate(marks):
        P = F @ P @ F.T + Q if k else P
        if seen:
            K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
            P = (np.eye(4) - K @ H) @ P
        found.append(P)
    return np.array(found)


def test_of_a_linear_motion_it_is_the_kalman_covariance(taut):
    """Places seen every third time, velocities never: 1e-6 of each entry's scale."""
    n, dt = 200, 1.0 / 240.0
    marks = [{"mass": R} if k % 3 == 0 else {} for k in range(n)]
    start = np.diag([1e-2, 1e-2, 1.0, 1.0])
    found = posterior_bound(taut, np.zeros((n, 4)), dt * np.arange(n), marks, WHITE, start)
    expected = textbook(marks, dt, start)
    scale = np.sqrt(np.einsum("nii,njj->nij", expected, expected))
    np.testing.assert_allclose(found / scale, expected / scale, rtol=0, atol=1e-5)


def test_derivatives_are_those_where_the_truth_is(phantom, rest_state):
    """A moving phantom feels less of friction than one at rest: where nothing is seen more uncertainty is left."""
    fast = rest_state + pack(np.zeros((4, 2)), np.full((4, 2), 0.5))
    start, mode = np.diag([0.0] * 8 + [1e-4] * 8), ForceMode(1e-9, 1e-9, 1.0)
    rough = replace(phantom, friction=np.full(7, 0.1))
    spread = [
        np.trace(posterior_bound(rough, np.tile(s, (12, 1)), np.arange(12) / 120.0, [{}] * 12, mode, start)[-1])
        for s in (rest_state, fast)
    ]
    assert spread[1] > 1.5 * spread[0]


def test_shapes_that_do_not_fit_are_refused(taut):
    with pytest.raises(ValueError, match=r"expected states \(3, 4\), 3 sets of marks"):
        posterior_bound(taut, np.zeros((2, 4)), np.arange(3.0), [{}] * 3, WHITE, np.eye(4))
