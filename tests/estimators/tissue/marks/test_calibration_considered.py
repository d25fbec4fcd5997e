"""A calibration that is off by the same in every frame: against the textbook, shifted marks, and simulated truth."""

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
    states = driven(phantom, rest_state, poke_forces(phantom, 2.0, np.random.default_rng(seed)))[::4]
    frames = []
    for k, state in enumerate(states):
        marks = [
            replace(mark, position=mark.position + shared[mark.node] @ theta, shared=shared[mark.node])
            for mark in marks_of(phantom, state, 5e-4, rng)
        ]
        frames.append((k / 30.0, marks))
    return frames, states[:, phantom.coordinates(HIDDEN)]


def test_regions_hold_a_target_seen_by_a_camera_that_is_off(phantom, rest_state):
    """Two runs of 2 s, calibrations of mean square 1 each way, truth by DOP853: 95 % regions hold 92 % and more.

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


def test_an_error_that_all_frames_have_is_no_poke(phantom, rest_state):
    """1 s unpoked, marks to 4 mm, the camera off in scale by 3 % and in place by 3 mm an axis.

    Where each frame could have an error of its own the target is further off.
    """
    states = driven(phantom, rest_state, poke_forces(phantom, 1.0, np.random.default_rng(3), poked=False))
    place, about = phantom.coordinates(HIDDEN), phantom.positions.mean(axis=0)

    def run(n_calibration: int) -> tuple[float, float]:
        """Mean probability of a poke, mean error of the target [m]."""
        tissue, rng = TissueFilter(phantom, HIDDEN, OUTER, n_calibration=n_calibration), np.random.default_rng(4)
        poked, errors = [], []
        for k, state in enumerate(states[::4]):
            tissue.predict(k / 30.0)
            seen = []
            for mark in marks_of(phantom, state, 4e-3, rng):
                shared = np.column_stack([0.02 * (mark.position - about), 2e-3 * np.eye(2)])
                seen.append(replace(mark, position=mark.position + shared @ [1.5, 1.5, 1.5], shared=shared))
            estimate = tissue.update(seen)
            poked.append(estimate.poked)
            errors.append(np.linalg.norm(estimate.mean - state[place]))
        return float(np.mean(poked)), float(np.mean(errors))

    (poked, error), (poked_again, error_again) = run(3), run(0)
    assert max(poked, poked_again) < 0.06
    assert error < 0.9 * error_again
