"""Pictures of a track stay those of the body whatever the estimates are, and of a size that does not grow with it."""

import cv2
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from experiments.plots.limits import N_DRAWN
from experiments.plots.track import (
    MOST_SHOWN,
    N_ELLIPSES,
    consistency_figure,
    error_figure,
    path_figure,
    sigma_figure,
    write_track_plots,
)
from tests.experiments.plots.tracks import block, made_track, phantom, small_errors

N = 300
RAN_AWAY = slice(100, 160)


def ran_away(values: np.ndarray, to: float) -> np.ndarray:
    """The values with a fifth of the frames at this size, from one frame to the next on the other side."""
    values = values.copy()
    n = len(values[RAN_AWAY])
    values[RAN_AWAY] = (to * (-1.0) ** np.arange(n)).reshape(n, *[1] * (values.ndim - 1))
    return values


def limits(figure: Figure) -> np.ndarray:
    """Limits of all axes, (n_axes, 4)."""
    return np.array([(*ax.get_xlim(), *ax.get_ylim()) for ax in figure.axes])


def points_of(ax: Axes) -> list[int]:
    """How many points each line has, and each area's outline."""
    areas = [len(path.vertices) for area in ax.collections for path in area.get_paths()]
    return [*(len(line.get_xdata()) for line in ax.lines), *areas]


@pytest.fixture(scope="module")
def usual():
    return made_track(phantom(), small_errors(N, 2), np.full(N, 1e-3))


@pytest.mark.parametrize("far_m", [1e3, 1e12, np.inf, np.nan])
@pytest.mark.parametrize("with_truth", [True, False])
def test_estimates_that_run_away_leave_the_path_where_it_was(usual, far_m, with_truth):
    """Limits within a tenth of those without them, and how many frames are outside, in the legend."""
    errors = ran_away(small_errors(N, 2), far_m)
    found = path_figure(made_track(phantom(), errors, np.full(N, 1e-3), with_truth=with_truth))
    before = limits(path_figure(usual))
    np.testing.assert_allclose(limits(found), before, atol=0.1 * np.ptp(before[1, :2]))
    labels = [text.get_text() for text in found.legends[0].get_texts()]
    assert ("filter outside: 60 of 300 frames" in labels) == (not np.isnan(far_m))


def test_no_legend_is_placed_by_a_search_among_what_is_drawn(usual):
    """It takes forever among thousands of ellipses: the place is fixed, outside of the axes where curves may be."""
    for made in (path_figure, error_figure):
        figure = made(usual)
        assert len(figure.legends) == 1
        assert all(ax.get_legend() is None for ax in figure.axes)


def test_ellipses_larger_than_the_picture_are_counted_and_not_drawn(usual):
    sigmas = np.full(N, 1e-3)
    sigmas[: N // 2] = 1e5
    for track, n in ((usual, N_ELLIPSES), (made_track(phantom(), small_errors(N, 2), sigmas), N_ELLIPSES // 2)):
        close = path_figure(track).axes[1]
        drawn = [patch for patch in close.patches if isinstance(patch, Ellipse)]
        assert len(drawn) == n
        assert f"{n} frames" in close.get_title()
        assert (f"{N_ELLIPSES - n} more are larger" in close.get_title()) == (n < N_ELLIPSES)
        assert max(patch.width for patch in drawn) == pytest.approx(4.0)  # two sigmas of 1 mm to either side


@pytest.mark.parametrize("far_m", [1e3, 1e12, np.nan])
def test_errors_that_run_away_leave_the_scale_to_the_others(usual, far_m):
    track = made_track(phantom(), ran_away(small_errors(N, 2), far_m), ran_away(np.full(N, 1e-3), far_m))
    figure = error_figure(track)
    for ax, before in zip(figure.axes, error_figure(usual).axes, strict=True):
        assert before.get_ylim()[1] <= ax.get_ylim()[1] <= 5.0 * before.get_ylim()[1]
        title = ax.get_title(loc="right")
        assert title == ("" if np.isnan(far_m) else "filter beyond the picture in 60 of 300 frames")


def test_where_all_estimates_run_away_the_scale_is_the_bodys():
    figure = error_figure(made_track(phantom(), np.full((N, 2), 1e6), np.full(N, 1e6)))
    size_mm = 1e3 * np.linalg.norm(np.ptp(phantom().network.positions, axis=0))
    for ax in figure.axes:
        assert ax.get_ylim()[1] == pytest.approx(size_mm, rel=0.05)


def test_a_nees_beyond_all_bounds_does_not_flatten_the_others(usual):
    figure = consistency_figure(made_track(phantom(), ran_away(small_errors(N, 2), 1e9), np.full(N, 1e-3)))
    assert figure.axes[0].get_ylim()[1] == MOST_SHOWN
    assert figure.axes[0].get_title().endswith("; 60 frames beyond the picture")
    assert consistency_figure(usual).axes[0].get_ylim()[1] < 100.0
    assert "beyond" not in consistency_figure(usual).axes[0].get_title()


def test_the_pictures_of_a_large_body_and_a_long_recording_are_of_few_artists():
    """48 nodes in space, 10,000 frames: no more is drawn than a picture can show."""
    n = 10_000
    track = made_track(block(), small_errors(n, 3), np.full(n, 1e-3))
    path, error = path_figure(track), error_figure(track)
    for figure in (path, error):
        for ax in figure.axes:
            assert len(ax.get_children()) < 80
            assert max(points_of(ax)) <= 2 * N_DRAWN + 3  # an area has two sides, and is closed
    springs = path.axes[0].collections[0]
    assert len(springs.get_segments()) == len(track.recording.scene.network.springs) > 200


def test_all_pictures_are_written_whatever_the_estimates_are(tmp_path):
    """Frames that are a kilometre away, beyond all numbers' squares, infinite, NaN, of no covariance, all in one."""
    errors, sigmas = small_errors(N, 2), np.full(N, 1e-3)
    for start, far_m in ((100, 1e3), (120, 1e100), (140, np.inf), (160, np.nan)):
        errors[start : start + 20], sigmas[start : start + 20] = far_m, far_m
    sigmas[200:210] = 0.0
    written = write_track_plots(made_track(phantom(), errors, sigmas), tmp_path)
    assert [path.name for path in written] == ["path.png", "error.png", "sigma.png", "consistency.png"]
    for path in written:
        assert cv2.imread(str(path)).std() > 10.0


def test_a_sigma_is_compared_only_where_there_is_one():
    """Not of NaN and not of nothing; where there is none at all the picture says so."""
    sigmas = np.full(N, 1e-3)
    sigmas[:10], sigmas[10:20] = np.nan, 0.0
    track = made_track(phantom(), small_errors(N, 2), sigmas)
    assert len(sigma_figure(track).axes[0].lines[0].get_xdata()) == N - 20
    nothing = sigma_figure(made_track(phantom(), small_errors(N, 2), np.full(N, np.nan)))
    assert [text.get_text() for text in nothing.axes[0].texts] == ["not known"]
