"""Constants of a real pendulum: rigid links, seen from the first frame on in motion, by a network of springs."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from estimators import Budget, IdentificationError, IdentificationSettings, MarkMeasurement, identify_constants
from tests.estimators.identification.pendulum import LENGTHS, SD, hanging_links, swung

FACTORS = (1.08, 0.93)


def by_post(function, items):
    """What a pool of processes does to functions and items: they go there by pickle, and are done in any order."""
    sent = [pickle.dumps((function, item)) for item in items]
    answers = [pickle.dumps(call(*pickle.loads(one))) for one in reversed(sent)]
    return [pickle.loads(answer) for answer in reversed(answers)]


def call(function, item):
    return function(item)


@pytest.fixture(scope="module")
def swing():
    """0.4 s at 100 frames/s from the first frame on in motion, both masses seen to SD."""
    times, places = swung(40)
    noisy = places + np.random.default_rng(4).normal(0.0, SD, places.shape)
    cov, nodes = SD**2 * np.eye(2), ("joint", "end")
    return [
        (float(time_s), [MarkMeasurement(node, place, cov) for node, place in zip(nodes, now, strict=True)])
        for time_s, now in zip(times, noisy, strict=True)
    ]


@pytest.fixture(scope="module")
def found(swing):
    """From 30 of the frames."""
    return identify_constants(
        hanging_links(FACTORS),
        swing[:30],
        ("end",),
        "joint",
        search=IdentificationSettings(n_starts=2),
        workers=by_post,
    )


def test_the_lengths_of_rigid_links_are_found(found):
    """From 8 and 7 % wrong: to 0.5 %, and within 4.5 standard errors, which are no smaller than the noise allows.

    A length seen in n frames to SD at either end has a standard error of SD sqrt(2 / n) / length at the least.
    """
    errors = np.log(found.network.rest_lengths / LENGTHS)
    sd = found.sd[[group.kind == "rest_length" for group in found.groups]]
    assert np.abs(errors).max() < 0.005
    assert (np.abs(errors) < 4.5 * sd).all()
    assert (sd > 0.5 * 5e-4 * np.sqrt(1.0 / 30.0) / LENGTHS).all()


def test_the_search_ends_and_residuals_are_explained(found):
    assert found.converged
    assert found.n_starts == 2
    assert 1 <= found.n_agreeing <= 2
    assert found.residuals.explained
    assert 0.5 < found.residuals.size < 1.1  # the model is exact, and the filter supposes that it is not
    assert found.log_likelihood > found.log_likelihood_before + 80.0


def test_the_hidden_joint_is_predicted_with_what_was_found(found):
    """Its mark not used: below 2 mm, where the wrong lengths leave twice as much and more."""
    assert found.target_error_m < 2e-3
    assert found.target_error_before_m > 2.0 * found.target_error_m


def test_a_target_that_is_the_only_marked_node_is_refused(swing):
    with pytest.raises(IdentificationError, match="expected a marked node besides end, which is predicted from it"):
        identify_constants(hanging_links(), swing, ("end",), "end")


class Clock:
    """State: seconds that have passed, more by a step at every reading."""

    def __init__(self, step_s):
        self.now_s, self.step_s = 0.0, step_s

    def __call__(self):
        self.now_s += self.step_s
        return self.now_s


def test_out_of_time_the_best_until_then_is_returned(swing):
    """A clock that a pass of 40 frames moves by 40 s, and 270 s: fewer frames, starts or passes, and said so."""
    found = identify_constants(hanging_links(FACTORS), swing, ("end",), "joint", budget=Budget(270.0, Clock(1.0)))
    assert not found.in_time
    assert found.n_frames < 40
    assert found.log_likelihood > found.log_likelihood_before
    assert np.abs(np.log(found.network.rest_lengths / LENGTHS)).max() < 0.02


def test_too_little_time_is_said(swing):
    with pytest.raises(IdentificationError, match="expected more time, found 20 s"):
        identify_constants(hanging_links(FACTORS), swing, ("end",), "joint", budget=Budget(20.0, Clock(1.0)))


def test_no_standard_error_exceeds_that_without_data(swing):
    """0.3 of gravity, marks that claim a tenth of their noise: the sd of each constant is within the bound.

    Such residuals repeat each other: they count for less.

    That without data: the prior's, and how far from the constants given those found are.
    """
    frames = [(time_s, [replace(mark, cov=0.01 * mark.cov) for mark in marks]) for time_s, marks in swing[:24]]
    prior = {"rest_length": 3e-4, "damping": 0.5, "stiffness": 0.3}
    one_start = IdentificationSettings(n_starts=1)
    wrong = identify_constants(
        hanging_links(gravity=0.3 * 9.81), frames, ("joint",), "end", prior_sd=prior, search=one_start
    )
    assert wrong.residuals.inflation > 1.0
    assert wrong.residuals.n_effective < wrong.residuals.n
    assert wrong.n_limited == 1
    assert (wrong.sd <= np.hypot(wrong.prior_sd, wrong.change) * (1.0 + 1e-9)).all()
