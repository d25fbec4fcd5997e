"""Pictures of a track stay those of the body whatever the estimates are, and of a size that does not grow with it."""

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from estimators import Status
from experiments.pipeline.scores.fit import Withheld
from experiments.plots.consistency import consistency_figure, sigma_figure
from experiments.plots.path import FAINT, N_ELLIPSES, path_figure
from experiments.plots.space import two_views
from experiments.plots.track import error_figure, write_track_plots
from tests.experiments.plots.printed import check_printed, labels
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


def ellipses_in(figure: Figure) -> list[Ellipse]:
    """Those of the close-up of a path."""
    return [patch for patch in figure.axes[1].patches if isinstance(patch, Ellipse)]


def with_status(track, frames: range, status: Status):
    """The track with no marks taken in by the filter in these frames, and this status."""
    steps = list(track.steps)
    for k in frames:
        ours = replace(steps[k].estimates["filter"], status=status, nis=None, marks_used=0)
        steps[k] = replace(steps[k], estimates=steps[k].estimates | {"filter": ours})
    return replace(track, steps=tuple(steps))


@pytest.fixture(scope="module")
def usual():
    return made_track(phantom(), small_errors(N, 2), np.full(N, 1e-3))


@pytest.fixture(scope="module")
def of_usual(usual):
    """Figures of the usual track, each made once."""
    return cache(lambda figure: figure(usual))


@pytest.mark.parametrize(("far_m", "with_truth"), [(1e12, True), (np.nan, False)])
def test_estimates_that_run_away_leave_the_path_where_it_was(of_usual, far_m, with_truth):
    """Limits within a tenth of those without them, and how many frames are outside, in the legend."""
    errors = ran_away(small_errors(N, 2), far_m)
    found = path_figure(made_track(phantom(), errors, np.full(N, 1e-3), with_truth=with_truth))
    before = limits(of_usual(path_figure))
    np.testing.assert_allclose(limits(found), before, atol=0.1 * np.ptp(before[1, :2]))
    assert ("filter outside: 60 of 300 frames" in labels(found)) == (not np.isnan(far_m))


def test_ellipses_larger_than_the_picture_are_counted_and_not_drawn(usual):
    sigmas = np.full(N, 1e-3)
    sigmas[: N // 2] = 1e5
    for track, n in ((usual, N_ELLIPSES), (made_track(phantom(), small_errors(N, 2), sigmas), N_ELLIPSES // 2)):
        figure = path_figure(track)
        title, drawn = figure.axes[1].get_title(loc="left"), ellipses_in(figure)
        assert len(drawn) == n
        assert f"{n} frames" in title
        assert (f"{N_ELLIPSES - n} more are larger" in title) == (n < N_ELLIPSES)
        assert max(patch.width for patch in drawn) == pytest.approx(4.0)  # two sigmas of 1 mm to either side


@pytest.mark.parametrize("far_m", [1e12, np.nan])
def test_errors_that_run_away_leave_the_scale_to_the_others(of_usual, far_m):
    track = made_track(phantom(), ran_away(small_errors(N, 2), far_m), ran_away(np.full(N, 1e-3), far_m))
    figure = error_figure(track)
    for ax, before in zip(figure.axes, of_usual(error_figure).axes, strict=True):
        assert before.get_ylim()[1] <= ax.get_ylim()[1] <= 5.0 * before.get_ylim()[1]
        title = ax.get_title(loc="right")
        assert title.startswith("outside the plot: filter 60") == (not np.isnan(far_m))


def test_where_all_estimates_run_away_the_scale_is_the_bodys():
    figure = error_figure(made_track(phantom(), np.full((N, 2), 1e6), np.full(N, 1e6)))
    size_mm = 1e3 * np.linalg.norm(np.ptp(phantom().network.positions, axis=0))
    for ax in figure.axes:
        assert ax.get_ylim()[1] == pytest.approx(size_mm, rel=0.05)


def test_a_nees_beyond_all_bounds_does_not_flatten_the_others(usual, of_usual):
    ax = consistency_figure(made_track(phantom(), ran_away(small_errors(N, 2), 1e9), np.full(N, 1e-3))).axes[0]
    (low, high), before = ax.get_ylim(), of_usual(consistency_figure).axes[0].get_ylim()[1]
    assert max(high, before) < 100.0
    # squared errors by the variance of 1 mm an axis; nearly no error is off at the other end
    errors = np.array([e.mean for e in usual.estimates("filter")]) - usual.truth
    away = np.delete((1e6 * errors**2).sum(axis=1), RAN_AWAY)
    assert f"; {60 + int((away < low).sum())} frames outside" in ax.get_title(loc="left")


def test_a_nis_near_0_does_not_stretch_the_axis(usual):
    steps = list(usual.steps)
    ours = replace(steps[0].estimates["filter"], nis=2e-4)
    steps[0] = replace(steps[0], estimates=steps[0].estimates | {"filter": ours})
    before, after = (consistency_figure(one).axes[-1] for one in (usual, replace(usual, steps=tuple(steps))))
    assert after.get_ylim()[0] > 0.5 * before.get_ylim()[0]
    assert "outside the plot" in after.get_title(loc="left")


def test_the_pictures_of_a_large_body_and_a_long_recording_are_of_few_artists(monkeypatch):
    """48 nodes in space, five times as many frames as points of a line: no more is drawn than a picture can show."""
    n_drawn, n = 100, 500
    for module in ("series", "path"):
        monkeypatch.setattr(f"experiments.plots.{module}.N_DRAWN", n_drawn)
    track = made_track(block(), small_errors(n, 3), np.full(n, 1e-3))
    path, error = path_figure(track), error_figure(track)
    for figure in (path, error):
        for ax in figure.axes:
            assert len(ax.get_children()) < 80
            areas = [len(path.vertices) for area in ax.collections for path in area.get_paths()]
            # an area has two sides, and is closed
            assert max([*(len(line.get_xdata()) for line in ax.lines), *areas]) <= 2 * n_drawn + 3
    springs = next(one for one in path.axes[3].collections if isinstance(one, LineCollection))
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


def test_a_sigma_is_compared_only_where_there_is_one(tmp_path, monkeypatch):
    """Not of NaN and not of nothing; where there is none at all there is no such picture."""
    sigmas = np.full(N, 1e-3)
    sigmas[:10], sigmas[10:20] = np.nan, 0.0
    track = made_track(phantom(), small_errors(N, 2), sigmas)
    assert len(sigma_figure(track).axes[0].lines[0].get_xdata()) == N - 20
    nothing, written = made_track(phantom(), small_errors(N, 2), np.full(N, np.nan)), []
    monkeypatch.setattr("experiments.plots.track.write_picture", lambda _figure, path, _vector: [written.append(path)])
    write_track_plots(nothing, tmp_path)
    assert [path.name for path in written] == ["path.png", "error.png", "consistency.png"]
    assert sigma_figure(nothing) is None


@pytest.mark.slow
@pytest.mark.parametrize(("dim", "with_truth"), [(2, True), (3, False)])
def test_all_pictures_can_be_printed_and_have_no_empty_axes(tmp_path, monkeypatch, dim, with_truth):
    """In the plane and in space, with frames of every status; without truth those that need it are left out."""
    drawn = {}
    monkeypatch.setattr(
        "experiments.plots.track.write_picture", lambda figure, path, _vector: [drawn.setdefault(path.name, figure)]
    )
    scene = phantom() if dim == 2 else block()
    track = made_track(scene, small_errors(N, dim), np.full(N, 1e-3), with_truth=with_truth)
    for status, frames in {Status.COASTING: (50, 70), Status.LOST: (70, 80), Status.DIVERGED: (80, 90)}.items():
        track = with_status(track, range(*frames), status)
    withheld = {name: Withheld(9, 4.0, 2.0, 1.0) for name in scene.measured_nodes}
    write_track_plots(replace(track, withheld=withheld), tmp_path)
    both = {"path.png", "consistency.png", "withheld.png"}
    assert set(drawn) == both | ({"error.png", "sigma.png"} if with_truth else set())
    for figure in drawn.values():
        check_printed(figure, without_units=("mark",))
    assert len(drawn["consistency.png"].axes) == (2 if with_truth else 1)
    assert len(drawn["path.png"].axes) == (2 if dim == 2 else 7)


def test_a_path_in_space_is_x_y_z_over_time_beside_the_body_from_two_sides():
    """The band is two standard deviations to either side; truth, filter and open loop are the numbers of the track."""
    sigmas = np.linspace(1e-3, 2e-3, N)
    track = made_track(block(), small_errors(N, 3), sigmas)
    figure = path_figure(track)
    check_printed(figure)
    for axis, ax in enumerate(figure.axes[:3]):
        series = {line.get_label(): line.get_ydata() for line in ax.lines}
        for label, method in (("filter", "filter"), ("paper's open loop", "open-loop")):
            np.testing.assert_allclose(series[label], [1e3 * e.mean[axis] for e in track.estimates(method)])
        np.testing.assert_allclose(series["truth"], 1e3 * track.truth[:, axis])
        band = ax.collections[0].get_paths()[0].vertices
        for k in (0, 100, N - 1):
            own = band[np.isclose(band[:, 0], track.times_s[k], atol=1e-9), 1]
            assert np.ptp(own) == pytest.approx(4e3 * sigmas[k])
        assert ax.get_ylabel() == f"{'xyz'[axis]} [mm]"
    last, scene = track.estimates("filter")[-1], track.recording.scene
    for k, view in enumerate(two_views(scene)):
        for ax in figure.axes[3 + 2 * k : 5 + 2 * k]:
            lesion, ellipsoid = ax.patches
            np.testing.assert_allclose([lesion.center, ellipsoid.center], [view.seen_mm(last.mean)] * 2)
            assert lesion.radius == pytest.approx(1e3 * scene.target.radius_m)
            assert (ellipsoid.width, ellipsoid.height) == pytest.approx((8.0, 8.0))  # 2 mm an axis, from any side
        filtered, true = (line.get_xydata() for line in figure.axes[4 + 2 * k].lines if len(line.get_xdata()) == N)
        np.testing.assert_allclose(filtered, view.seen_mm(np.array([e.mean for e in track.estimates("filter")])))
        np.testing.assert_allclose(true, view.seen_mm(track.truth))


def test_estimates_that_run_away_leave_a_path_in_space_where_it_was():
    usual = small_errors(N, 3)
    tracks = (made_track(block(), errors, np.full(N, 1e-3)) for errors in (usual, ran_away(usual, np.inf)))
    before, found = (limits(path_figure(track))[:, 2:] for track in tracks)
    np.testing.assert_allclose(found, before, atol=0.15 * np.ptp(before[0]))


def test_the_path_is_coloured_by_time_and_nodes_have_names(usual, of_usual):
    """From the first exposure to the last; the network's names in the scene, and none close up."""
    whole, close = of_usual(path_figure).axes[:2]
    for ax in (whole, close):
        path = next(c for c in ax.collections if c.get_array() is not None)
        np.testing.assert_allclose(path.get_array(), usual.times_s[:-1])
        assert (path.norm.vmin, path.norm.vmax) == (usual.times_s[0], usual.times_s[-1])
        assert path.get_cmap().name == "viridis"
        two = [e.mean for e in usual.estimates("filter")[7:9]]
        np.testing.assert_allclose(path.get_segments()[7], 1e3 * np.array(two))
    assert {text.get_text() for text in whole.texts} == set(usual.recording.scene.network.names)
    assert not close.texts


def test_ellipses_of_frames_without_marks_are_faint(usual):
    figure = path_figure(with_status(usual, range(N // 2), Status.LOST))
    opacities = [patch.get_alpha() for patch in ellipses_in(figure)]
    assert opacities == [FAINT] * (N_ELLIPSES // 2) + [0.9] * (N_ELLIPSES // 2)


def test_a_consistent_filters_groups_lie_in_the_band_of_the_sigma_plot():
    """Sigmas from 0.5 to 4 mm, errors drawn by them, independent; of twice the size they are in no band."""
    rng = np.random.default_rng(5)
    sigmas = np.exp(rng.uniform(np.log(5e-4), np.log(4e-3), 4000))
    errors = rng.normal(0.0, 1.0, (4000, 2)) * sigmas[:, None]
    for scale, least, most in ((1.0, 7, 8), (2.0, 0, 0)):
        ax = sigma_figure(made_track(phantom(), scale * errors, sigmas)).axes[0]
        band = ax.collections[0].get_paths()[0].vertices
        predicted, found = next(line for line in ax.lines if len(line.get_xdata()) == 8).get_data()
        ratio = band[:, 1] / band[:, 0]
        low, high = np.quantile(ratio, [0.02, 0.98])
        assert 0.93 < low < 0.98
        assert 1.02 < high < 1.07  # a chi-square of 1000 degrees: 4.4 % to either side
        assert least <= ((found / predicted > low) & (found / predicted < high)).sum() <= most


def test_sigmas_that_hardly_vary_fill_the_width_of_the_picture_and_frames_outside_are_counted():
    """From 1 to 1.1 mm: groups and frames are spread, nine tenths of the frames inside; both axes are alike."""
    rng = np.random.default_rng(5)
    sigmas = rng.uniform(1e-3, 1.1e-3, N)
    figure = sigma_figure(made_track(phantom(), rng.normal(0.0, 1.0, (N, 2)) * sigmas[:, None], sigmas))
    ax = figure.axes[0]
    left, right = ax.get_xlim()
    assert ax.get_xscale() == ax.get_yscale() == "log"
    assert right < 1.4 * left
    assert sum(left < tick < right for tick in ax.get_xticks()) >= 3
    x, y = ax.lines[0].get_data()
    low, high = ax.get_ylim()
    n_out = int(((x < left) | (x > right) | (y < low) | (y > high)).sum())
    assert 0 < n_out <= 0.1 * N
    assert f"single frames ({n_out} of {N} outside)" in labels(figure)
