"""A quick form of the marks study; figures of docs/marks-study.md from all of it."""

import pandas as pd
import pytest

from experiments.studies.marks import figures, run


def test_marks_in_good_light_are_found_to_a_fiftieth_of_a_pixel() -> None:
    reported = figures(pd.concat([run(seed, "good light", 4) for seed in range(3)]))
    assert reported["found"] == 1.0
    assert reported["rms_px"] < 0.03  # measured 0.016
    assert reported["false_per_1000_frames"] == 0.0
    assert 0.5 < reported["predicted_by_real"] < 2.0


@pytest.mark.slow
def test_marks_in_any_room_are_found() -> None:
    reported = figures(pd.concat([run(seed, "whole range", 3) for seed in (1, 7)]))
    assert reported["found"] == 1.0
    assert reported["rms_px"] < 0.35  # measured 0.15
    assert reported["swapped"] == 0
