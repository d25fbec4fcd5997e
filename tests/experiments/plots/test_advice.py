"""The picture of advice: bands of what was advised, lanes of reasons; few artists for a long recording, too."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from estimators import Advice, AdviceSettings, Guidance, Insertion, Lesion, Needle
from experiments.formats.needle_file import NeedlePlan
from experiments.formats.recording import Recording
from experiments.pipeline.advise import Advised
from experiments.plots.advice import COLOURS, advice_figure, reasons_of
from experiments.plots.space import NEEDLE, two_views
from tests.experiments.plots.printed import check_printed, labels
from tests.experiments.plots.tracks import block, phantom


def advised(advice: list[Advice], lateral_m: np.ndarray, reasons: list[str] | None = None) -> Advised:
    """Advised so and with such a miss in frames a second apart."""
    times_s = np.arange(float(len(advice)))
    insertion = Insertion(np.array([0.0, 0.2]), np.array([0.0, -1.0]), 0.2)
    plan = NeedlePlan(Needle(), insertion, Lesion.ball(5e-3, 2), AdviceSettings())
    guidance = tuple(
        Guidance(one, reason, arrival_s=1.0, probability=0.5, lateral_m=float(miss))
        for one, miss, reason in zip(advice, lateral_m, reasons or [""] * len(advice), strict=True)
    )
    recording = Recording(Path(), phantom(), times_s, None, (), None, ())
    return Advised(recording, plan, tuple(times_s), guidance)


def spans(bars) -> list[tuple[float, float]]:
    """From when to when each bar reaches."""
    return [(path.vertices[:, 0].min(), path.vertices[:, 0].max()) for path in bars.get_paths()]


def test_bands_cover_the_time_of_their_frames():
    """Half-way to the neighbours: GO from 0 to 1.5 s and from 3.5 s on, WAIT between."""
    miss = np.array([1e-3, 1e-3, 1e-3, 1e-3, 4e-3])
    figure = advice_figure(advised([Advice.GO] * 2 + [Advice.WAIT] * 2 + [Advice.GO], miss))
    for ax in figure.axes[:2]:
        assert [spans(bars) for bars in ax.collections] == [[(0.0, 1.5), (3.5, 4.0)], [(1.5, 3.5)]]


def test_each_reason_has_a_lane_of_its_own_with_its_words_and_its_times():
    """Two reasons to wait are two lanes; numbers that vary are one reason, from the least to the largest."""
    advice = [Advice.WAIT, Advice.GO, Advice.GO, Advice.WAIT, Advice.GO]
    probable = [f"a hit is {percent} % probable" for percent in (95, 9, 91)]
    reasons = ["no mark", *probable[:2], "a hit comes in 0.5 s", probable[2]]
    done = advised(advice, np.full(5, 1e-3), reasons)
    assert [(one, words, held) for one, words, held in reasons_of(done)] == [
        (Advice.GO, "a hit is 9 to 95 % probable", [False, True, True, False, True]),
        (Advice.WAIT, "no mark", [True, False, False, False, False]),
        (Advice.WAIT, "a hit comes in 0.5 s", [False, False, False, True, False]),
    ]
    lanes = advice_figure(done).axes[-1]
    assert [text.get_text() for text in lanes.texts] == [
        "GO: a hit is 9 to 95 % probable (3 frames)",
        "WAIT: no mark (1 frame)",
        "WAIT: a hit comes in 0.5 s (1 frame)",
    ]
    bars = [one for one in lanes.collections if len(one.get_facecolor())]
    assert [spans(one) for one in bars[:3]] == [[(0.5, 2.5), (3.5, 4.0)], [(0.0, 0.5)], [(2.5, 3.5)]]
    changes = lanes.collections[-1].get_segments()
    assert [segment[0][0] for segment in changes] == [0.5, 2.5, 3.5]
    assert lanes.get_title(loc="left") == "reasons of the advice; changes: 3"


def test_it_can_be_printed_where_no_needle_ever_arrives():
    """Without a miss there is no panel of it."""
    done = advised([Advice.NO_GUIDANCE] * 20, np.full(20, np.nan), ["the estimate is LOST"] * 20)
    figure = advice_figure(done)
    check_printed(figure)
    assert len(figure.axes) == 2
    check_printed(advice_figure(advised(list(COLOURS) * 4, np.full(20, 1e-3), [str(k) for k in range(5)] * 4)))


def test_advice_that_changes_with_each_frame_is_as_few_artists():
    advice = [Advice.GO, Advice.WAIT] * 1000
    figure = advice_figure(advised(advice, np.full(2000, 1e-3)))
    for ax in figure.axes:
        assert len(ax.get_children()) < 40
    assert len(figure.axes[-1].collections) == 2  # bars of two reasons, and no line for each of 1999 changes


def test_a_miss_beyond_the_body_leaves_the_scale_to_the_others():
    lateral = np.full(100, 2e-3)
    lateral[::10] = 1e6
    ax = advice_figure(advised([Advice.GO] * 100, lateral)).axes[1]
    assert ax.get_ylim() == (0.0, pytest.approx(1.2 * 20.0))  # ten times the median
    assert [line.get_marker() for line in ax.lines].count("^") == 1
    assert ax.get_title(loc="right") == "outside the plot in 10 of 100 frames"


def test_a_miss_that_changes_is_shown_by_the_lesion():
    """Up to 1.5 mm: the scale is that of the lesion's radius of 5 mm, which is a line of the picture."""
    figure = advice_figure(advised([Advice.GO] * 100, np.linspace(0.0, 1.5e-3, 100)))
    ax = figure.axes[1]
    assert ax.get_ylim() == (0.0, pytest.approx(6.0))
    line = next(line for line in ax.lines if line.get_label() == "radius of the lesion")
    np.testing.assert_allclose(line.get_ydata(), 5.0)
    assert "radius of the lesion" in labels(figure)


def test_what_never_changes_is_stated_in_words():
    """A miss between 2.0 and 2.9 mm has no panel; a later insertion that is as good as one now has no curve."""
    figure = advice_figure(advised([Advice.GO] * 10, np.linspace(2e-3, 2.9e-3, 10)))
    assert len(figure.axes) == 2
    assert figure.axes[0].get_title(loc="left") == "lateral miss 2.0 to 2.9 mm"
    assert labels(figure) == ["GO", "inserted now", "threshold of GO, 0.9"]
    assert list(figure.axes[0].lines[-1].get_ydata()) == [0.9, 0.9]


def test_a_curve_that_differs_is_drawn_and_named():
    done = advised([Advice.GO] * 10, np.full(10, 2e-3))
    later = [replace(one, best_probability=0.5 + 0.02 * (k == 7), best_in_s=0.1) for k, one in enumerate(done.guidance)]
    assert "insertion at the best later time" in labels(advice_figure(replace(done, guidance=tuple(later))))


def test_in_space_the_needle_stands_in_the_body_from_two_sides():
    """Its tip, its line ahead as far as it is to go, the lesion at the latest aim with its ellipsoid."""
    scene = block()
    aim, tip, axis = np.array([0.03, 0.02, 0.03]), np.array([0.03, 0.02, 0.06]), np.array([0.0, 0.0, -1.0])
    plan = NeedlePlan(Needle(), Insertion(tip, axis, 0.2), Lesion.ball(5e-3, 3), AdviceSettings())
    one = Guidance(Advice.GO, "", 1.0, 0.95, aim=aim, cov=np.diag([1e-6, 4e-6, 9e-6]), lateral_m=0.0, depth_m=0.03)
    recording = Recording(Path(), scene, np.arange(2.0), None, (), None, ())
    figure = advice_figure(Advised(recording, plan, (0.0, 1.0), (one, one)))
    check_printed(figure)
    views = two_views(scene)
    for view, ax in zip([view for view in views for _ in range(2)], figure.axes[2:], strict=True):
        shaft, ahead = (line.get_xydata() for line in ax.lines if line.get_color() == NEEDLE)
        np.testing.assert_allclose(shaft[0], view.seen_mm(tip), atol=1e-9)
        np.testing.assert_allclose(ahead, view.seen_mm(np.stack([tip, aim])), atol=1e-9)
        lesion, ellipsoid = ax.patches
        np.testing.assert_allclose([lesion.center, ellipsoid.center], [view.seen_mm(aim)] * 2, atol=1e-9)
        assert lesion.radius == pytest.approx(5.0)
    assert {"needle", "its line ahead", "lesion", "2-sigma ellipsoid"} <= set(labels(figure))
