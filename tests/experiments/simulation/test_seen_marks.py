"""Simulated marks: as noisy, as rarely lost and as far misplaced as asked, on a given motion."""

from dataclasses import replace

import numpy as np

from dynamics import HIDDEN, OUTER
from experiments.formats.scenario import SeenMarks, read_scenario
from experiments.simulation.seen_marks import Truth, seen_marks
from experiments.simulation.simulate import scene_of

SCENE = replace(scene_of(read_scenario("quiet")), cameras=())
N = 2000


def recording(**marks):
    """2,000 frames in which each free node moves along a line of its own."""
    times = np.arange(N) / 30.0
    starts = SCENE.network.positions[SCENE.network.free]
    motion = Truth(times, starts + times[:, None, None] * np.arange(1, 5)[:, None] * 1e-3)
    return seen_marks(SCENE, motion, SeenMarks(**marks), np.random.default_rng(1)), motion


def errors_of(found, motion):
    """Errors of the marks that are seen [m], (n, dim)."""
    column = {SCENE.network.names[node]: k for k, node in enumerate(SCENE.network.free)}
    return np.array(
        [mark.position_m - motion.positions[k, column[mark.node]] for k, row in enumerate(found.marks) for mark in row]
    )


def test_errors_have_the_deviation_that_is_stated():
    """12,000 numbers: their deviation is known to 0.65 %, three times that allowed; mean to 3 standard errors."""
    found, motion = recording(sd_mm=2.0)
    errors = errors_of(found, motion)
    assert errors.shape == (3 * N, 2)
    assert abs(errors.std() / 2e-3 - 1.0) < 0.02
    assert abs(errors.mean()) < 3 * 2e-3 / np.sqrt(errors.size)
    assert {mark.sd_m for row in found.marks for mark in row} == {2e-3}
    assert {mark.node for row in found.marks for mark in row} == set(OUTER)


def test_the_truth_is_the_targets():
    found, motion = recording()
    index = [SCENE.network.names[node] for node in SCENE.network.free].index(HIDDEN)
    assert found.truth.nodes == (HIDDEN,)
    np.testing.assert_array_equal(found.truth.positions[HIDDEN], motion.positions[:, index])


def test_as_many_are_lost_as_stated():
    """A binomial of 6,000 at 0.3: three standard deviations are 106."""
    found, _ = recording(lost=0.3)
    assert abs(sum(len(row) for row in found.marks) - 0.7 * 3 * N) < 106


def test_outliers_are_as_many_and_as_far_as_stated():
    """6,000 at 0.1: three standard deviations are 70; 30 to 150 mm, but for noise of 0.01 mm."""
    found, motion = recording(outliers=0.1, sd_mm=0.01)
    away = np.linalg.norm(errors_of(found, motion), axis=1)
    wild = away[away > 1e-3]
    assert abs(len(wild) - 0.1 * 3 * N) < 70
    assert 0.0299 < wild.min() < 0.035
    assert 0.145 < wild.max() < 0.1501


def test_errors_are_the_same_but_for_their_size():
    (fine, motion), (coarse, _) = recording(sd_mm=0.5), recording(sd_mm=5.0)
    np.testing.assert_allclose(10.0 * errors_of(fine, motion), errors_of(coarse, motion), atol=1e-12)
