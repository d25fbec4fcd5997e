"""Verdict of marks predicted as if hidden on the target, against known numbers."""

import numpy as np
import pytest

from estimators import LeaveOneOutCheck
from experiments.pipeline.scores.fit import Withheld, withheld_of, withheld_words


def test_errors_of_one_mark():
    """3-4-5 mm and 6-8-10 mm, NEES 2 and 6 in the plane: twice the variance that was predicted."""
    checks = [LeaveOneOutCheck(np.array([3e-3, 4e-3]), 2.0), LeaveOneOutCheck(np.array([-6e-3, 8e-3]), 6.0)]
    one = withheld_of(checks)
    assert (one.frames, one.mean_nees) == (2, 4.0)
    assert one.mean_error_mm == pytest.approx(7.5)
    assert one.ratio == pytest.approx(np.sqrt(2.0))


@pytest.mark.parametrize(
    ("ratios", "scale", "words"),
    [
        (
            (0.9, 0.8),
            1.0,
            "0.90 times as large as predicted, mark noise included (A): the target's sigma is plausible; the target's",
        ),
        (
            (0.9, 1.5),
            2.25,
            "1.50 times as large as predicted, mark noise included (B): the hidden target's error may also be larger",
        ),
    ],
)
def test_the_worst_mark_speaks_for_the_target(ratios, scale, words):
    withheld = {name: Withheld(5, 1.0, 2.0 * ratio**2, ratio) for name, ratio in zip("AB", ratios, strict=True)}
    reported = withheld_words(withheld, scale)
    assert words in reported
    assert reported.endswith("is unchanged" if scale == 1.0 else "was multiplied by 1.50 on average")


def test_no_predictions_say_nothing():
    assert withheld_words({}, 1.0).endswith("the check has no result")
