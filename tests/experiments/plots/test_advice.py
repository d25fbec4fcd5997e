"""The picture of advice: bands of what was advised, of as many artists for a long recording as for a short one."""

from pathlib import Path

import numpy as np
import pytest

from estimators import Advice, AdviceSettings, Guidance, Insertion, Lesion, Needle
from experiments.formats.needle_file import NeedlePlan
from experiments.formats.recording import Recording
from experiments.pipeline.advise import Advised
from experiments.plots.advice import advice_figure
from tests.experiments.plots.tracks import phantom


def advised(advice: list[Advice], lateral_m: np.ndarray) -> Advised:
    """Advised so and with such a miss in frames a second apart."""
    times_s = np.arange(float(len(advice)))
    insertion = Insertion(np.array([0.0, 0.2]), np.array([0.0, -1.0]), 0.2)
    plan = NeedlePlan(Needle(), insertion, Lesion.ball(5e-3, 2), AdviceSettings())
    guidance = tuple(
        Guidance(one, "", arrival_s=1.0, probability=0.5, lateral_m=float(miss))
        for one, miss in zip(advice, lateral_m, strict=True)
    )
    recording = Recording(Path(), phantom(), times_s, None, (), None, ())
    return Advised(recording, plan, tuple(times_s), guidance)


def test_bands_cover_the_time_of_their_frames():
    """Half-way to the neighbours: GO from 0 to 1.5 s and from 3.5 s on, WAIT between."""
    figure = advice_figure(advised([Advice.GO] * 2 + [Advice.WAIT] * 2 + [Advice.GO], np.full(5, 1e-3)))
    for ax in figure.axes:
        spans = [
            [(path.vertices[:, 0].min(), path.vertices[:, 0].max()) for path in bands.get_paths()]
            for bands in ax.collections
        ]
        assert [one for one in spans if one] == [[(0.0, 1.5), (3.5, 4.0)], [(1.5, 3.5)]]


def test_advice_that_changes_with_each_frame_is_as_few_artists():
    advice = [Advice.GO, Advice.WAIT] * 1000
    for ax in advice_figure(advised(advice, np.full(2000, 1e-3))).axes:
        assert len(ax.get_children()) < 40


def test_a_miss_beyond_the_body_leaves_the_scale_to_the_others():
    lateral = np.full(100, 2e-3)
    lateral[::10] = 1e6
    ax = advice_figure(advised([Advice.GO] * 100, lateral)).axes[1]
    assert ax.get_ylim() == (0.0, pytest.approx(1.2 * 20.0))  # ten times the median
    assert [line.get_marker() for line in ax.lines].count("^") == 1
