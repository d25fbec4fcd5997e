"""The picture of a comparison: one method that fails does not flatten the others; without truth it has no error."""

from dataclasses import replace

import numpy as np
import pytest

from estimators import METHODS, Status, TargetEstimate
from experiments.plots.compare import comparison_figure
from tests.experiments.plots.printed import check_printed, labels
from tests.experiments.plots.tracks import made_track, phantom, small_errors

N = 60
OTHER = next(iter(METHODS))


def with_other(usual, off_m):
    """The track with one more method, off by so much along both axes in each frame, of sigma 1 m."""
    steps = []
    for k, step in enumerate(usual.steps):
        mean = step.estimates["filter"].mean + off_m[k]
        estimate = TargetEstimate(usual.times_s[k], mean, np.eye(2), Status.TRACKING, 3)
        steps.append(replace(step, estimates=step.estimates | {OTHER: estimate}))
    return replace(usual, steps=tuple(steps))


def test_a_method_that_fails_leaves_the_scale_to_the_others():
    """With a method 1 km off for a third of the time, the scale is that of the rest, and its frames are counted."""
    usual = made_track(phantom(), np.zeros((N, 2)), np.full(N, 1e-3))
    figure = comparison_figure(with_other(usual, np.where(np.arange(N) < N // 3, 1e3, 1e-3)))
    names = [ax.get_title(loc="left").split(":")[0] for ax in figure.axes]
    assert names == ["open-loop", "filter", OTHER]
    before = comparison_figure(usual).axes[0].get_ylim()[1]
    assert [ax.get_ylim()[0] for ax in figure.axes] == [0.0] * 3
    size_mm = 1e3 * np.linalg.norm(np.ptp(phantom().network.positions, axis=0))
    assert 5.0 < before < 20.0  # the open loop's 3 mm an axis
    assert before < figure.axes[0].get_ylim()[1] < 1.1 * size_mm  # sigma 1 m all the time: up to the body's size
    assert ["outside" in ax.get_title(loc="left") for ax in figure.axes] == [False, False, True]
    assert figure.axes[2].get_title(loc="left").endswith("; outside the plot in 20 frames")


@pytest.mark.parametrize("with_truth", [True, False])
def test_each_method_has_what_is_known_of_it(with_truth):
    """Without truth the distance from the filter, sqrt(2) mm, in place of the error; none of the filter from itself."""
    track = with_other(made_track(phantom(), small_errors(N, 2), np.full(N, 1e-3), with_truth=with_truth), [1e-3] * N)
    figure = comparison_figure(track)
    check_printed(figure)
    assert [len(ax.lines) for ax in figure.axes] == ([1, 1, 1] if with_truth else [1, 0, 1])
    assert [len(ax.collections) for ax in figure.axes] == [0, 1, 1]  # the open loop predicts no error
    titles = [ax.get_title(loc="left") for ax in figure.axes]
    assert (titles[2] == f"{OTHER}: mean distance from the filter 1.41 mm") == (not with_truth)
    shown = {line.get_color() for ax in figure.axes for line in ax.lines}
    assert len(shown) == 1  # methods are distinguished by their names, not by seven colours
    assert labels(figure) == ["predicted rms error", "observed error" if with_truth else "distance from the filter"]
