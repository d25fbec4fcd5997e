"""Rest lengths corrected by one still picture: the model rests where the tissue rests."""

import numpy as np
import pytest

from dynamics import NetworkError, fit_rest_lengths, four_mass_phantom, parameters, rest_shape, scale_parameters
from tests.networks import build_network

PHANTOM = four_mass_phantom()


def tissue(seed, off=0.03):
    """A phantom whose rest lengths are off at random, relative, and its other constants by 10 %."""
    which = parameters(PHANTOM)
    sds = [off if one.kind == "rest_length" else 0.1 for one in which]
    return scale_parameters(PHANTOM, which, np.array(sds) * np.random.default_rng(seed).normal(size=len(which)))


def test_of_all_corrections_it_is_the_smallest():
    """Ten rest lengths, eight balances of force: moving along the two that make no force makes it larger."""
    corrected = fit_rest_lengths(PHANTOM, rest_shape(tissue(3)))
    change = corrected.rest_lengths / PHANTOM.rest_lengths - 1.0
    x = corrected.positions
    apart = x[PHANTOM.springs[:, 1]] - x[PHANTOM.springs[:, 0]]
    pull = PHANTOM.stiffness * PHANTOM.rest_lengths / np.linalg.norm(apart, axis=1)
    G = np.zeros((PHANTOM.n_nodes, 2, 10))
    for s, (i, j) in enumerate(PHANTOM.springs):
        G[i, :, s] -= pull[s] * apart[s]
        G[j, :, s] += pull[s] * apart[s]
    silent = np.linalg.svd(G[PHANTOM.free].reshape(8, 10))[2][8:]
    assert np.abs(silent @ change).max() < 1e-9
    assert np.abs(change).max() > 1e-3


def test_noise_is_not_followed_further_than_rest_lengths_are_known():
    """25 tissues seen to 4 mm, rest lengths known to 1 %: nearer to the hidden mass's rest than picture and model."""
    rng = np.random.default_rng(0)
    firm, loose, before, pictured = [], [], [], []
    for seed in range(25):
        true = rest_shape(tissue(seed, off=0.01))
        seen = true.copy()
        seen[PHANTOM.free] += rng.normal(0.0, 0.004, (4, 2))
        for errors, known in ((firm, 0.01), (loose, 10.0)):
            errors.append(fit_rest_lengths(PHANTOM, seen, sd_m=0.004, known=known).positions[1] - true[1])
        before.append(PHANTOM.positions[1] - true[1])
        pictured.append(seen[1] - true[1])
    rms = [np.sqrt(np.mean(np.square(errors))) for errors in (firm, loose, before, pictured)]
    assert rms[0] < 0.8 * min(rms[2], rms[3])
    assert rms[1] == pytest.approx(rms[3], rel=0.02)


def test_a_picture_of_another_network_is_refused():
    seen = PHANTOM.positions.copy()
    seen[PHANTOM.index("M3")] += [0.0, 0.5]
    with pytest.raises(
        NetworkError, match=r"rest_length .*: expected to rest where it was seen with a change below 50 %"
    ):
        fit_rest_lengths(PHANTOM, seen)
    with pytest.raises(NetworkError, match=r"positions: expected finite numbers of shape \(7, 2\)"):
        fit_rest_lengths(PHANTOM, seen[:6])


def test_what_no_spring_can_hold_is_refused():
    """A mass on one spring from a ceiling cannot rest beside it: no correction balances gravity there."""
    pendulum = build_network([[0.0, 0.0], [0.0, -0.3]], [(0, 1)], [0], stiffness=250.0, gravity=[0.0, -9.81])
    corrected = fit_rest_lengths(pendulum, [[0.0, 0.0], [0.05, -0.3]])
    assert abs(corrected.positions[1, 0]) < 1e-9  # it rests below its anchor, whatever was seen
