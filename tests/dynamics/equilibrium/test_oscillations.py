"""Small oscillations against closed forms: one mass, a row of masses, and what a long motion shows."""

import numpy as np
import pytest

from dynamics import oscillations, stiffness_matrix
from tests.networks import build_network

K, M, C, D = 80.0, 0.2, 0.3, 0.5


def row_of_masses(n: int, dim: int, **changes):
    """Masses in line between two anchors, all springs stretched to twice their length."""
    x = np.zeros((n + 2, dim))
    x[:, 0] = 0.1 * np.arange(n + 2)
    springs = [(i, i + 1) for i in range(n + 1)]
    return build_network(x, springs, (0, n + 1), rest_lengths=0.05, **changes)


@pytest.mark.parametrize("dim", [2, 3])
def test_a_row_of_masses_has_the_textbooks_frequencies_and_damping(dim: int) -> None:
    """w_j = 2 sqrt(s / m) sin(j pi / 2 (n + 1)): s = k along the row, s = T / l = k / 2 across it.

    The damping ratio is (c w_j / k + d / (m w_j)) / 2 along it; across it no dashpot acts: the second part alone.
    """
    n = 4
    network = row_of_masses(n, dim, damping=C, drag=D)
    found = oscillations(network, network.positions)
    sines = 2.0 * np.sin(np.arange(1, n + 1) * np.pi / (2 * (n + 1)))
    along, across = np.sqrt(K / M) * sines, np.sqrt(0.5 * K / M) * sines
    w = np.concatenate([along, *[across] * (dim - 1)])
    ratio = 0.5 * (D / (M * w) + np.where(np.arange(len(w)) < n, C * w / K, 0.0))
    order = np.argsort(w)
    np.testing.assert_allclose(found.frequencies_hz, w[order] / (2.0 * np.pi), rtol=1e-9)
    np.testing.assert_allclose(found.damping_ratios, ratio[order], rtol=1e-7)
    assert not len(found.decays_s)


@pytest.mark.parametrize("turned", [0.0, 0.5, 1.5])
@pytest.mark.parametrize("n", [3, 4])
def test_equal_motions_of_a_symmetric_body_creep_however_it_is_turned(n: int, turned: float) -> None:
    """A ring of masses, each held by an anchor: of pairs of equal roots none is an oscillation.

    Roots of m z² + d z + s = 0, s the eigenvalues of the stiffness, d far above 2 sqrt(m s): 1e-6.
    """
    around = 2.0 * np.pi * np.arange(n) / n + turned
    ring = np.stack([np.cos(around), np.sin(around)], axis=1)
    springs = [(i, (i + 1) % n) for i in range(n)] + [(i, n + i) for i in range(n)]
    network = build_network(np.vstack([ring, 2.0 * ring]), springs, tuple(range(n, 2 * n)), rest_lengths=0.9, drag=40.0)
    stiffnesses = np.linalg.eigvalsh(stiffness_matrix(network, network.positions))
    roots = [(-40.0 + sign * np.sqrt(1600.0 - 4.0 * M * s)) / (2.0 * M) for s in stiffnesses for sign in (-1, 1)]
    found = oscillations(network, network.positions)
    assert not len(found.frequencies_hz)
    np.testing.assert_allclose(found.decays_s, np.sort(-1.0 / np.array(roots))[::-1], rtol=1e-6)


def test_two_masses_afloat_have_their_one_oscillation_and_no_motion_as_a_whole() -> None:
    """w² = 2 k / m; drifting along, across and turning are none."""
    network = build_network([[0.0, 0.0], [0.1, 0.0]], [(0, 1)])
    found = oscillations(network, network.positions)
    np.testing.assert_allclose(found.frequencies_hz, [np.sqrt(2 * K / M) / (2 * np.pi)], rtol=1e-9)
    assert not len(found.decays_s)


def test_friction_is_left_out() -> None:
    network = row_of_masses(3, 2, friction=0.05)
    assert oscillations(network, network.positions).damping_ratios == pytest.approx(0.0, abs=1e-9)
