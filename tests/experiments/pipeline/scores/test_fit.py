"""Verdicts without truth, for constructed estimates: bands from SciPy, words for each case."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from estimators import LeaveOneOutCheck, Status, TargetEstimate
from experiments.pipeline.scores.fit import (
    TruthScore,
    Withheld,
    fit_of,
    frames_by_status,
    sigmas_m,
    verdict,
    withheld_of,
    withheld_words,
)


def estimates(nis, marks_used=3, status=Status.TRACKING, dim=2):
    """Frames a second apart with these NIS, None where there is none."""
    cov = np.diag(np.arange(1.0, dim + 1.0))
    return [
        TargetEstimate(float(k), np.zeros(dim), cov, status, 0 if one is None else marks_used, nis=one)
        for k, one in enumerate(nis)
    ]


@pytest.mark.parametrize("dim", [2, 3])
def test_the_band_is_that_of_the_mean_of_as_many_chi_squares(dim):
    """200 frames of two marks and 100 of one: degrees of freedom add up."""
    frames = [*estimates(np.full(200, 5.0), 2, dim=dim), *estimates(np.full(100, 2.0), 1, dim=dim)]
    fit = fit_of(frames)
    degrees = 2 * dim * 200 + dim * 100
    assert fit.mean_nis == pytest.approx(4.0)
    np.testing.assert_allclose([fit.low, fit.high], chi2.ppf([0.025, 0.975], degrees) / 300)
    assert fit.ratio == pytest.approx(np.sqrt(4.0 / (degrees / 300)))


def test_starts_and_frames_without_marks_do_not_count():
    """Nor does a NIS that is no number; a diverged frame does."""
    tracked = estimates([6.0] * 10)
    others = estimates([1e6] * 5, status=Status.INITIALISING) + estimates([None] * 5, status=Status.COASTING)
    others += estimates([np.nan, np.inf])
    assert fit_of([*tracked, *others]).mean_nis == 6.0
    assert fit_of([*tracked, *estimates([17.0], status=Status.DIVERGED)]).mean_nis == pytest.approx(7.0)
    assert fit_of(others) is None


def test_frames_whose_marks_measure_no_coordinate_do_not_count():
    unmeasured = [replace(one, measured=0) for one in estimates([0.1] * 5)]
    assert fit_of(unmeasured) is None
    assert fit_of([*estimates([6.0] * 5), *unmeasured]).degrees == 6.0


def test_sigma_is_of_an_axis_and_of_frames_that_have_one():
    """Variances 1 and 2 m² in the plane: the root of their mean."""
    without = replace(estimates([6.0])[0], cov=None)
    endless = replace(estimates([6.0])[0], cov=np.diag([np.inf, 1.0]))
    assert sigmas_m([*estimates([6.0, 6.0]), without, endless]) == pytest.approx([np.sqrt(1.5)] * 2)


@pytest.mark.parametrize(
    ("mean", "words"),
    [
        (6.0, "marks scatter as predicted: NIS 6.00 in its band 5.61 to 6.40; this does not test"),
        (24.0, "marks scatter 2 times as much as predicted, NIS 24.00 above its"),
        (8.64, "marks scatter 20 % more than predicted, NIS 8.64 above"),
        (1.5, "marks scatter 50 % less than predicted, NIS 1.50 below"),
    ],
)
def test_a_verdict_says_whether_the_marks_fit_and_what_to_do(mean, words):
    frames = estimates([mean] * 300)
    reported = verdict(fit_of(frames), frames_by_status(frames))
    assert reported.startswith(words)
    assert reported.endswith("none of 300 frames coasting, lost or diverged")
    assert ("softaim identify" in reported) == (mean > 6.4)
    assert ("softaim tune" in reported) == (mean != 6.0)


@pytest.mark.parametrize("mean", [1.5, 6.0, 24.0])
@pytest.mark.parametrize(
    ("coverage95", "nees", "words"),
    [
        (0.85, 4.2, "the 95 % region in 85 % of frames (NEES 4.2, expected 2): the target's covariance is too small"),
        (0.95, 2.1, "in 95 % of frames (NEES 2.1, expected 2): the target's covariance holds"),
        (0.99, 11.2, "in 99 % of frames (NEES 11.2, expected 2): the target's covariance is too small in some frames"),
        (1.0, 0.1, "in 100 % of frames (NEES 0.1, expected 2): the target's covariance is larger than the errors"),
    ],
)
def test_a_verdict_never_contradicts_the_truth(mean, coverage95, nees, words):
    frames = estimates([mean] * 300)
    found = verdict(fit_of(frames), frames_by_status(frames), truth=TruthScore(coverage95, nees, 2))
    assert words in found
    assert "does not test" not in found
    assert "fit the model" not in found
    assert ("too high" in found) == (mean == 1.5 and coverage95 > 0.9 and nees < 4.0)


def test_one_error_of_all_frames_is_no_proof_against_the_covariance():
    assert "cannot be tested by one recording" in TruthScore(0.0, 9.6, 3, one_error=True).words
    assert TruthScore(0.0, 98.6, 3, one_error=True).words.endswith("the target's covariance is too small")


def test_a_verdict_names_no_test_of_the_target_that_was_made():
    frames = estimates([6.0] * 300)
    assert "test" not in verdict(fit_of(frames), frames_by_status(frames), checked=True)


@pytest.mark.parametrize("noise", [1.1, 2.98])
def test_a_verdict_names_marks_that_are_noisier_than_stated(noise):
    frames = [replace(one, noise=noise) for one in estimates([6.0] * 300)]
    fit = fit_of(frames)
    assert fit.noise == pytest.approx(noise)
    assert ("at least 3.0 times as noisy as stated" in verdict(fit, frames_by_status(frames))) == (noise > 2.0)


def test_a_verdict_never_calls_noise_both_too_low_and_too_high():
    frames = [replace(one, noise=2.98) for one in estimates([1.5] * 300)]
    found = verdict(fit_of(frames), frames_by_status(frames))
    assert "less than predicted" in found
    assert "state a larger sd" in found
    assert "too high" not in found


def test_a_verdict_counts_what_was_missed():
    frames = estimates([6.0] * 590) + estimates([None] * 2, status=Status.COASTING)
    frames += estimates([None] * 7, status=Status.LOST) + estimates([6.0], status=Status.DIVERGED)
    by_status = frames_by_status(frames)
    assert by_status == {"INITIALISING": 0, "TRACKING": 590, "COASTING": 2, "LOST": 7, "DIVERGED": 1}
    reported = verdict(fit_of(frames), by_status, refused=5)
    assert reported.endswith("; 2 of 600 frames coasting, 7 lost, 1 diverged; 5 marks refused")


def test_a_run_without_any_mark_is_said_to_be_the_models_alone():
    frames = estimates([None] * 20, status=Status.INITIALISING)
    reported = verdict(fit_of(frames), frames_by_status(frames))
    assert reported.startswith("no marks were used after the start: the estimate is a prediction by the model")


def test_errors_of_one_mark():
    """3-4-5 mm and 6-8-10 mm, NEES 2 and 6 in the plane: twice the variance that was predicted."""
    checks = [LeaveOneOutCheck(np.array([3e-3, 4e-3]), 2.0), LeaveOneOutCheck(np.array([-6e-3, 8e-3]), 6.0)]
    one = withheld_of(checks)
    assert (one.frames, one.mean_nees) == (2, 4.0)
    assert one.mean_error_mm == pytest.approx(7.5)
    assert one.ratio == pytest.approx(np.sqrt(2.0))


@pytest.mark.parametrize(
    ("worst", "scale", "words"),
    [
        (0.8, 1.0, "0.90 times as large as predicted, mark noise included (A): the target's sigma is plausible;"),
        (1.5, 2.25, "1.50 times as large as predicted, mark noise included (B): the hidden target's error may also be"),
    ],
)
def test_the_worst_mark_speaks_for_the_target(worst, scale, words):
    reported = withheld_words({name: Withheld(5, 1.0, 2.0, ratio) for name, ratio in (("A", 0.9), ("B", worst))}, scale)
    assert words in reported
    assert reported.endswith("is unchanged" if scale == 1.0 else "was multiplied by 1.50 on average")


def test_no_predictions_say_nothing():
    assert withheld_words({}, 1.0).endswith("the check has no result")
