"""Runs of drawn frames: seeds, motion, truth, and what each level holds."""

import itertools

import numpy as np
import pytest

from vision import MarkHue, RunFrame, detect_marks, synthetic_run

SMALL = (320, 240)


def run(seed: int, n_frames: int, level: str, **kwargs: object) -> list[RunFrame]:
    return list(synthetic_run(seed, n_frames, level, **kwargs))  # type: ignore[arg-type]


@pytest.mark.parametrize("level", ["good light", "whole range"])
def test_seeds_reproduce_and_differ(level: str) -> None:
    one, two, other = (run(seed, 2, level, size_px=SMALL) for seed in (3, 3, 4))
    for a, b in zip(one, two, strict=True):
        np.testing.assert_array_equal(a.frame.image, b.frame.image)
        np.testing.assert_array_equal(a.frame.centers_px, b.frame.centers_px)
    assert one[1].frame.image.shape == (240, 320, 3)
    assert (one[1].frame.image != other[1].frame.image).mean() > 0.5
    # A run is the beginning of a longer one.
    np.testing.assert_array_equal(run(3, 1, level, size_px=SMALL)[0].frame.image, one[0].frame.image)


@pytest.mark.parametrize("level", ["good light", "whole range"])
def test_marks_move_smoothly_by_up_to_20_px_and_stay_in_view(level: str) -> None:
    centers = np.array([f.frame.centers_px for f in run(0, 5, level)])
    steps = np.diff(centers, axis=0)
    # Perspective draws the near side at up to a third more than the mean scale.
    assert 8.0 < np.hypot(steps[..., 0], steps[..., 1]).max() < 27.0
    # Four marks sway at 1.5 Hz or less: a step changes by up to 2π 1.5 / 30 of the fastest.
    assert np.abs(np.diff(steps, axis=0)).max() < 2 * np.pi * 1.5 / 30.0 * 27.0
    assert (centers > 10).all()
    assert (centers < (630, 470)).all()


def test_marks_in_good_light_are_where_the_truth_says() -> None:
    errors = []
    for frame in itertools.chain(run(0, 3, "good light"), run(1, 2, "good light")):
        assert (frame.frame.visible > 0.999).all()
        found = np.array([d.center_px for d in detect_marks(frame.frame.image, [MarkHue(0.0)], min_area_px=80.0)])
        assert len(found) == 4
        off = np.hypot(*np.moveaxis(found[:, None] - frame.frame.centers_px, -1, 0)).min(axis=0)
        errors += list(off)
    # The finder knows of no gamma, mosaic or highlight; together they move it by 0.04 px rms here.
    assert max(errors) < 0.2


def test_the_whole_range_covers_marks_now_and_then() -> None:
    visible = np.array([f.frame.visible for seed in range(12) for f in run(seed, 1, "whole range", size_px=(160, 120))])
    assert 0.01 < (visible < 0.9).mean() < 0.4
    assert (visible == 1.0).mean() > 0.5


def test_the_truth_is_the_marks_middle_seen_by_the_view() -> None:
    for frame in run(5, 3, "whole range", size_px=SMALL, hues_deg=(0.0, 120.0, 240.0), radius_px=6.0):
        middles = np.array([m.path_m[len(m.path_m) // 2] for m in frame.marks])
        np.testing.assert_allclose(frame.frame.centers_px, frame.camera.view.project(middles), atol=1e-9)
        assert [m.hue_deg for m in frame.marks] == [0.0, 120.0, 240.0]
        assert frame.marks[0].radius_m == pytest.approx(6.0 * frame.camera.view.m_per_px((0.0, 0.0)))


def test_hues_all_round_leave_no_strays_and_no_error() -> None:
    assert len(run(0, 1, "whole range", size_px=SMALL, hues_deg=(0.0, 90.0, 180.0, 270.0))) == 1


def test_bad_runs_are_refused_before_the_first_frame() -> None:
    with pytest.raises(ValueError, match="level: expected good light or whole range, found dark"):
        synthetic_run(0, 3, "dark")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="run: expected frames and at least one hue"):
        synthetic_run(0, 3, hues_deg=())
