"""The picture of a comparison: one method that fails does not flatten the others."""

from dataclasses import replace

import numpy as np

from estimators import METHODS, Status, TargetEstimate
from experiments.plots.compare import comparison_figure
from tests.experiments.plots.tracks import made_track, phantom, small_errors

N = 60


def test_a_method_that_fails_leaves_the_scale_to_the_others():
    """Of a method 1 km off a third of the time the scale is that of the rest, and its frames are counted."""
    usual = made_track(phantom(), small_errors(N, 2), np.full(N, 1e-3))
    other = next(iter(METHODS))
    steps = []
    for k, step in enumerate(usual.steps):
        mean = usual.truth[k] + (1e3 if k < N // 3 else 1e-3)
        estimate = TargetEstimate(usual.times_s[k], mean, np.eye(2), Status.TRACKING, 3)
        steps.append(replace(step, estimates=step.estimates | {other: estimate}))
    figure = comparison_figure(replace(usual, steps=tuple(steps)))
    names = [ax.get_title(loc="left").split(":")[0] for ax in figure.axes]
    assert names == ["open-loop", "filter", other]
    before = comparison_figure(usual).axes[0].get_ylim()[1]
    assert [ax.get_ylim()[0] for ax in figure.axes] == [0.0] * 3
    size_mm = 1e3 * np.linalg.norm(np.ptp(phantom().network.positions, axis=0))
    assert 5.0 < before < 20.0  # the open loop's 3 mm an axis
    assert before < figure.axes[0].get_ylim()[1] < 1.1 * size_mm  # sigma 1 m all the time: up to the body's size
    beyond = ["beyond" in ax.get_title(loc="left") for ax in figure.axes]
    assert beyond == [False, False, True]
    assert figure.axes[2].get_title(loc="left").endswith("; beyond the picture in 20 frames")
