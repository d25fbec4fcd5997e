"""A quick form of the marks study; figures of docs/marks-study.md from all of it."""

import pandas as pd
import pytest

from experiments.studies.marks import figures, run


def reported_of(level, seeds, n_frames):
    """Figures of a few runs."""
    cases = [{"seed": seed, "level": level, "n_frames": n_frames} for seed in seeds]
    return figures(pd.DataFrame([case | row for case in cases for row in run(case)]))


def test_marks_in_good_light_are_found_to_a_fiftieth_of_a_pixel() -> None:
    reported = reported_of("good light", range(3), 4)
    assert reported["found"] == 1.0
    assert reported["rms_px"] < 0.03  # measured 0.016
    assert reported["false_per_1000_frames"] == 0.0
    assert 0.5 < reported["predicted_by_real"] < 2.0


@pytest.mark.slow
def test_marks_in_any_room_are_found() -> None:
    reported = reported_of("whole range", (1, 7), 3)
    assert reported["found"] == 1.0
    assert reported["rms_px"] < 0.35  # measured 0.15
    assert reported["swapped"] == 0
