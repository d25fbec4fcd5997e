"""What the filter of the tissue does at its surface."""

from copy import deepcopy
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER
from estimators import CovarianceError, MarkMeasurement, TissueFilter
from estimators.process.target import TargetPoint
from tests.estimators.conftest import followed, poked_frames
from tests.estimators.states import digest

HZ, NOISE_M, FIX_COV = 1.0 / 30.0, 1e-3, 4e-6 * np.eye(2)


@pytest.fixture(scope="module")
def frames():
    """Two seconds at 30 frames/s of the phantom, poked, by DOP853; marks with 1 mm of noise."""
    return poked_frames(2.0, NOISE_M, 3)[0]


@pytest.fixture(scope="module")
def seen_for(phantom, frames):
    """A filter after so many of these frames."""

    @lru_cache
    def first(n):
        tissue = TissueFilter(phantom, HIDDEN, OUTER)
        followed(tissue, frames[:n])
        return tissue

    return lambda n: deepcopy(first(n))


def said(estimate):
    return digest((estimate.mean, estimate.cov, estimate.status, estimate.marks_used, estimate.nis, estimate.poked))


def test_a_start_is_no_evidence(phantom, frames):
    """Names that begin again at a start are compared by what follows."""
    tissue = TissueFilter(phantom, HIDDEN, OUTER)
    followed(tissue, frames[:1])
    assert tissue.log_likelihood == 0.0
    followed(tissue, frames[1:2])
    assert tissue.log_likelihood != 0.0


def test_a_filter_that_was_set_back_goes_on_as_before_to_the_last_bit(seen_for, frames):
    """Set back twice: what came between, a loss and a start among it, does not show."""
    tissue = seen_for(20)
    then = tissue.snapshot()
    ends = []
    for _ in range(2):
        found = followed(tissue, frames[20:30])
        found.append(tissue.fix(found[-1].mean, FIX_COV))
        ends.append(([said(one) for one in found], digest(tissue.snapshot())))
        tissue.predict(30.0)
        tissue.update(frames[5][1])
        tissue.restore(then)
        assert digest(tissue.snapshot()) == digest(then)
    assert ends[0] == ends[1]


def test_without_marks_a_state_is_that_of_a_new_filter(seen_for, phantom, frames):
    tissue = seen_for(20)
    tissue.restore(tissue.snapshot().without_marks())
    again, new = (followed(one, frames[20:25]) for one in (tissue, TissueFilter(phantom, HIDDEN, OUTER)))
    assert [digest((one.mean, one.cov)) for one in again] == [digest((one.mean, one.cov)) for one in new]


LOOKS = {
    "predict_at": lambda one, t: one.predict_at(t + 0.3),
    "predict_modes": lambda one, t: one.predict_modes(t + 0.3),
    "predict_path": lambda one, t: one.predict_path(t + np.arange(3.0)),
    "expected": lambda one, _t: one.expected("M1"),
    "expected_after_impulse": lambda one, _t: one.expected_after_impulse("M1"),
    "expected_at_rest": lambda one, _t: one.expected_at_rest(["M1"]),
    "expected_of": lambda one, _t: one.expected_of(("M1", "M4")),
    "place_of": lambda one, _t: one.place_of(one.target),
    "forgotten": lambda one, t: one.predict_at(t + 100.0),
}


@pytest.mark.parametrize("look", LOOKS)
def test_to_look_changes_nothing(seen_for, look):
    tissue = seen_for(20)
    before = digest(tissue.snapshot())
    LOOKS[look](tissue, tissue.time_s)
    assert digest(tissue.snapshot()) == before


def test_looks_ahead_are_what_a_prediction_then_gives(seen_for):
    tissue = seen_for(20)
    then_s = tissue.time_s + 0.04  # one step of either
    at, modes, path = tissue.predict_at(then_s), tissue.predict_modes(then_s), tissue.predict_path([then_s])
    tissue.predict(then_s)
    mean, cov = tissue.place_of(tissue.target)
    np.testing.assert_allclose(at.mean, mean, atol=1e-12)
    np.testing.assert_allclose(at.cov, cov, rtol=1e-9)
    np.testing.assert_allclose(path[0][0], mean, atol=1e-12)
    np.testing.assert_allclose(path[1][0], cov, rtol=1e-9)
    np.testing.assert_allclose(modes.weights @ modes.means, mean, atol=3e-4)


MARK = MarkMeasurement("M1", np.zeros(2), 1e-6 * np.eye(2))
WRONG = {
    "time goes back": (lambda one: one.predict(0.1), "time_s: expected"),
    "no time": (lambda one: one.predict(np.nan), "time_s: expected"),
    "ahead goes back": (lambda one: one.predict_at(0.1), "time_s: expected"),
    "ahead no time": (lambda one: one.predict_at(np.inf), "time_s: expected"),
    "path from the past": (lambda one: one.predict_path([0.1, 1.0]), "time_s: expected"),
    "path goes back": (lambda one: one.predict_path([1.0, 3.0, 2.0]), "time_s: expected"),
    "path without end": (lambda one: one.predict_path([1.0, np.inf]), "time_s: expected"),
    "push of another shape": (lambda one: one.predict(1.0, np.zeros(3)), "push: expected finite forces of shape"),
    "push of no number": (
        lambda one: one.predict(1.0, lambda _t, _x: np.full((4, 2), np.nan)),
        "push: expected finite",
    ),
    "mark of no node": (lambda one: one.update([replace(MARK, node="M9")]), "mark M9: expected one of the marked"),
    "mark of the target": (
        lambda one: one.update([replace(MARK, node=HIDDEN)]),
        r"mark M2: expected one of the marked nodes \(M1, M3, M4\), found another",
    ),
    "mark twice": (lambda one: one.update([MARK, MARK]), "mark M1: expected one measurement, found 2"),
    "mark in space": (lambda one: one.update([MarkMeasurement("M1", np.zeros(3), np.eye(3))]), "mark M1 position"),
    "shared by some": (
        lambda one: one.update([replace(MARK, node=f"M{k}", shared=np.ones((2, 4 - k))) for k in (1, 3)]),
        "mark M3 shared: expected 3 directions, found 1",
    ),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_what_cannot_be_taken_in_is_an_error_and_leaves_the_state(seen_for, wrong):
    call, message = WRONG[wrong]
    tissue = seen_for(10)
    before = digest(tissue.snapshot())
    with pytest.raises(ValueError, match=message):
        call(tissue)
    assert digest(tissue.snapshot()) == before


def test_calls_before_the_first_frame_are_errors(phantom):
    tissue = TissueFilter(phantom, HIDDEN, OUTER)
    for call in (lambda: tissue.update([]), lambda: tissue.fix(np.zeros(2), np.eye(2)), lambda: tissue.predict_at(0.0)):
        with pytest.raises(ValueError, match="expected"):
            call()


def test_directions_of_a_calibration_are_those_that_were_announced(phantom):
    tissue = TissueFilter(phantom, HIDDEN, OUTER, n_calibration=3)
    tissue.predict(0.0)
    with pytest.raises(ValueError, match="mark M1 shared: expected 3 directions, found 2"):
        tissue.update([replace(MARK, shared=np.ones((2, 2)))])


def test_a_state_of_which_one_mode_has_no_covariance_is_an_error_of_its_own(seen_for, frames):
    tissue = seen_for(10)
    tissue.filter.covs[tissue.filter.weights.argmax()] *= -1e3
    before = digest(tissue.snapshot())
    with pytest.raises(CovarianceError, match="positive definite"):
        tissue.update(frames[9][1])
    assert digest(tissue.snapshot()) == before


@pytest.mark.parametrize("n", [0, 10])
@pytest.mark.parametrize("moment", ["means", "covs"])
def test_a_state_that_is_not_finite_is_an_error_of_its_own(phantom, seen_for, frames, n, moment):
    """At a start, and later."""
    tissue = seen_for(n) if n else TissueFilter(phantom, HIDDEN, OUTER)
    if not n:
        tissue.predict(0.0)
    getattr(tissue.filter, moment)[0] = np.nan
    with pytest.raises(CovarianceError, match="finite"):
        tissue.update(frames[n][1])


def test_far_ahead_nothing_is_known_but_the_prior(seen_for, phantom):
    """And it takes no steps to get there: a gap of a day costs what one of six seconds does."""
    tissue, new = seen_for(20), TissueFilter(phantom, HIDDEN, OUTER)
    steps = []
    tissue.process.linearize = lambda *own: steps.append(own)
    far = tissue.predict_at(tissue.time_s + 86400.0)
    assert not steps
    np.testing.assert_allclose(far.cov, new.place_of(new.target)[1], rtol=1e-9)
    assert far.model_only


def test_marks_are_expected_where_the_next_ones_are(phantom, frames):
    tissue, squared = TissueFilter(phantom, HIDDEN, OUTER), []
    for k, (time_s, marks) in enumerate(frames):
        tissue.predict(time_s)
        for mark in marks if k > 15 else ():
            mean, cov = tissue.expected(mark.node)
            y = mark.position - mean
            squared.append(float(y @ np.linalg.solve(cov + mark.cov, y)))
        tissue.update(marks)
    assert np.mean(np.array(squared) < 13.8) > 0.97  # 99.9 % of two coordinates


def test_a_fix_pulls_the_target_and_a_far_one_only_when_it_comes_again(seen_for):
    tissue = seen_for(30)
    before, cov = tissue.place_of(tissue.target)
    near = before + 2.0 * np.sqrt(np.diag(cov))
    then = tissue.snapshot()
    fixed = tissue.fix(near, 1e-2 * cov)
    assert np.linalg.norm(fixed.mean - near) < 0.1 * np.linalg.norm(before - near)
    tissue.restore(then)
    far = before + 0.05
    assert np.array_equal(tissue.fix(far, cov).mean, before)
    assert tissue.rejected["fix"] == 1
    twice = tissue.fix(far, cov).mean
    assert np.linalg.norm(twice - before) > 0.2 * np.linalg.norm(far - before)
    assert tissue.rejected["fix"] == 1


def test_information_shares_are_what_is_lost_without_the_mark(phantom, frames):
    """For a quiet frame, where one mode dominates; truth is the update without that mark."""
    still = [(k * HZ, frames[0][1]) for k in range(40)]
    tissue = TissueFilter(phantom, HIDDEN, OUTER)
    followed(tissue, still)
    tissue.predict(still[-1][0] + HZ)
    then = tissue.snapshot()
    whole = tissue.update(still[0][1])
    assert set(whole.information_share) == set(OUTER)
    for node in OUTER:
        tissue.restore(then)
        without = tissue.update([mark for mark in still[0][1] if mark.node != node])
        lost = np.trace(without.cov) / np.trace(whole.cov) - 1.0
        assert whole.information_share[node] == pytest.approx(lost, abs=0.02)


def test_one_shift_of_all_marks_is_said(seen_for, frames):
    tissue = seen_for(30)
    tissue.predict(frames[30][0])
    moved = [replace(mark, position=mark.position + np.array([0.02, 0.0])) for mark in frames[30][1]]
    shift = tissue.update(moved).shift
    assert shift.n_marks == 3
    assert shift.nis < 0.1 * shift.nis_of_one


def test_the_offset_of_the_target_is_no_doubt_of_the_tissue(phantom, frames):
    """How well the target's own place is known changes neither gain nor whether the model alone speaks."""
    plain, loose = (
        followed(TissueFilter(phantom, TargetPoint((HIDDEN,), sd_m=sd_m), OUTER), frames[:30])[-1]
        for sd_m in (0.0, 0.1)
    )
    assert (loose.gain, loose.model_only) == (pytest.approx(plain.gain, abs=1e-3), False)
    np.testing.assert_allclose(loose.cov - plain.cov, 1e-2 * np.eye(2), atol=1e-6)
