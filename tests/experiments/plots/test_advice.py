"""The picture of advice: bands of what was advised, lanes of reasons; few artists for a long recording, too."""

from pathlib import Path

import numpy as np
import pytest

from estimators import Advice, AdviceSettings, Guidance, Insertion, Lesion, Needle
from experiments.formats.needle_file import NeedlePlan
from experiments.formats.recording import Recording
from experiments.pipeline.advise import Advised
from experiments.plots.advice import COLOURS, advice_figure, reasons_of
from tests.experiments.plots.printed import check_printed
from tests.experiments.plots.tracks import phantom


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
    figure = advice_figure(advised([Advice.GO] * 2 + [Advice.WAIT] * 2 + [Advice.GO], np.full(5, 1e-3)))
    for ax in figure.axes[:2]:
        assert [spans(bars) for bars in ax.collections] == [[(0.0, 1.5), (3.5, 4.0)], [(1.5, 3.5)]]


def test_each_reason_has_a_lane_of_its_own_with_its_words_and_its_times():
    """Two reasons to wait are two lanes; numbers that vary are one reason, from the least to the largest."""
    advice = [Advice.WAIT, Advice.GO, Advice.GO, Advice.WAIT, Advice.GO]
    reasons = [
        "no mark",
        "a hit is 95 % probable",
        "a hit is 9 % probable",
        "a hit comes in 0.5 s",
        "a hit is 91 % probable",
    ]
    done = advised(advice, np.full(5, 1e-3), reasons)
    found = [(one, words, held) for one, words, held in reasons_of(done)]
    assert found == [
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


def test_the_threshold_stands_in_the_picture_and_is_named():
    figure = advice_figure(advised([Advice.WAIT] * 5, np.full(5, 1e-3)))
    ax = figure.axes[0]
    line = next(line for line in ax.lines if line.get_label() == "threshold of GO, 0.9")
    assert list(line.get_ydata()) == [0.9, 0.9]
    assert "threshold of GO, 0.9" in [text.get_text() for text in figure.legends[0].get_texts()]


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


def test_misses_of_a_well_aimed_needle_are_shown_by_the_lesion():
    """For a hundredth of a millimetre: twice the target's radius of 5 mm, not a picture of nothing but noise."""
    ax = advice_figure(advised([Advice.GO] * 100, np.full(100, 1e-5))).axes[1]
    assert ax.get_ylim() == (0.0, pytest.approx(10.0))
