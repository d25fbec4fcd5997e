"""A calibration that is off by the same in every frame, against simulated truth; `test_statics.py` has its textbook."""

from dataclasses import replace

import numpy as np
from scipy.linalg import hadamard

from dynamics import HIDDEN, OUTER
from estimators import TissueFilter, coverage, normalised_error_squared
from tests.estimators.conftest import driven, followed, marks_of, poke_forces


def directions(phantom):
    """A camera a little aside, turned, and nearer than it is said to be: 1.5 mm each at the marks [m], by node."""
    rest = {node: phantom.positions[phantom.index(node)] - [0.0, 0.2] for node in OUTER}
    return {
        node: 1.5e-3 * np.column_stack([np.eye(2), 3.0 * np.array([-at[1], at[0]]), 3.0 * at])
        for node, at in rest.items()
    }


def frames_of(phantom, rest_state, seed, theta):
    """Marks of 0.5 mm of the poked phantom seen by such a camera for 2 s, and where the target was."""
    rng, shared = np.random.default_rng((seed, 1)), directions(phantom)
    states = driven(phantom, rest_state, poke_forces(phantom, 1.3, np.random.default_rng(seed)))[::4]
    frames = []
    for k, state in enumerate(states):
        marks = [
            replace(mark, position=mark.position + shared[mark.node] @ theta, shared=shared[mark.node])
            for mark in marks_of(phantom, state, 5e-4, rng)
        ]
        frames.append((k / 30.0, marks))
    return frames, states[:, phantom.coordinates(HIDDEN)]


def test_regions_hold_a_target_seen_by_a_camera_that_is_off(phantom, rest_state):
    """Two runs of 1.3 s, calibrations of mean square 1 each way, truth by DOP853: 95 % regions hold 92 % and more.

    Squared errors are below what is predicted. `docs/calibration.md` has the figures of many runs.
    """
    errors, covs = [], []
    for seed, theta in enumerate(hadamard(4)[:2]):
        frames, places = frames_of(phantom, rest_state, seed, theta)
        found = followed(TissueFilter(phantom, HIDDEN, OUTER, n_calibration=4), frames)
        errors += [one.mean - place for one, place in zip(found, places, strict=True)]
        covs += [one.cov for one in found]
    assert coverage(normalised_error_squared(np.array(errors), covs), 2) > 0.92
    assert np.square(errors).sum() < np.trace(covs, axis1=1, axis2=2).sum()
