"""Limits of plots against known numbers."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

from estimators import MarkMeasurement
from experiments.plots.series import N_CARETS, N_DRAWN, body_box, highest, mark_beyond, thinned, widened, within
from tests.experiments.plots.tracks import made_track, phantom, small_errors


def test_neither_estimates_nor_single_marks_far_away_widen_the_bodys_box():
    """The phantom's corners to the marks' 2 mm, though estimates are 1 km away, and one mark in 200."""
    scene = phantom()
    done = made_track(scene, np.full((200, 2), 1e3), np.full(200, 1e3))
    far = MarkMeasurement("M1", np.array([1e3, -1e3]), 1e-6 * np.eye(2))
    done = replace(done, steps=(replace(done.steps[0], marks=(far,)), *done.steps[1:]))
    low, high = body_box(done)
    np.testing.assert_allclose(low, scene.network.positions.min(axis=0), atol=2e-3)
    np.testing.assert_allclose(high, scene.network.positions.max(axis=0), atol=2e-3)


def test_a_truth_beyond_the_network_widens_it():
    done = made_track(phantom(), small_errors(10, 2), np.full(10, 1e-3))
    truth = done.truth.copy()
    truth[3], truth[4] = [2.0, 3.0], [np.nan, 0.0]
    np.testing.assert_allclose(body_box(replace(done, truth=truth))[1], [2.0, 3.0])


def test_a_box_is_widened_by_its_longest_side_and_holds_no_nan():
    box = widened(np.array([[0.0, 0.0], [4.0, 1.0]]), 0.5)
    np.testing.assert_array_equal(box, [[-2.0, -2.0], [6.0, 3.0]])
    points = np.array([[5.0, 2.0], [5.0, 4.0], [np.nan, 1.0], [np.inf, 1.0]])
    np.testing.assert_array_equal(within(points, box), [[5.0, 2.0]])


@pytest.mark.parametrize(
    ("series", "expected"),
    [
        ([np.array([1.0, -3.0, 2.0])], 1.2 * 2.98),  # nearly the largest: 0.99 of the way from 1, 2 to 3
        ([np.r_[np.ones(80), np.full(20, 1e6)]], 1.2 * 10.0),  # a fifth ran away: ten times the median
        ([np.ones(100), np.full(100, 5.0)], 1.2 * 5.0),
        ([np.full(100, 1e9)], 50.0),  # all ran away: no further than asked for
        ([np.array([np.nan, np.inf, -1.0])], 1.2),
        ([np.full(3, np.nan)], 50.0),
        ([np.zeros(3)], 50.0),
    ],
)
def test_an_axis_shows_what_is_usual_of_each_series(series, expected):
    assert highest(50.0, *series) == pytest.approx(expected)


def test_a_thinned_series_keeps_its_peaks_and_its_gaps():
    """100,000 values as few points as a picture shows, in order of time; each peak of one frame stays."""
    n = 100_000
    times, values = np.arange(n) / 30.0, np.random.default_rng(1).normal(0.0, 1.0, n)
    peaks = {12_345: 50.0, 54_321: -60.0, 99_999: 70.0}
    for k, peak in peaks.items():
        values[k] = peak
    values[30_000:40_000] = np.nan
    at, drawn = thinned(times, values)
    assert len(at) == len(drawn) <= N_DRAWN
    assert (np.diff(at) > 0.0).all()
    assert {(times[k], peak) for k, peak in peaks.items()} <= set(zip(at, drawn, strict=True))
    inside = (at > times[30_100]) & (at < times[39_900])
    assert inside.any()
    assert np.isnan(drawn[inside]).all()


def test_what_leaves_a_picture_has_carets_at_its_edge():
    ax = Figure().subplots()
    ax.set_ylim(-1.0, 1.0)
    times = np.arange(5_000.0)
    values = np.select([times < 3.0, times >= 4_000.0], [-2.0, 1e30], default=0.5)
    values[10], values[20] = np.inf, np.nan
    assert mark_beyond(ax, times, values, "blue") == 3 + 1_000 + 1
    assert ax.get_ylim() == (-1.0, 1.0)
    carets = {line.get_marker(): line.get_xdata() for line in ax.lines}
    np.testing.assert_array_equal(carets["v"], [0.0, 1.0, 2.0])
    assert carets["^"][0] == 10.0
    assert len(carets["^"]) <= N_CARETS
    assert mark_beyond(ax, times, np.zeros(5_000), "blue") == 0
    assert len(ax.lines) == 2
