"""The plots of insertions, for constructed trials: what is drawn, what is only counted."""

from dataclasses import replace

import numpy as np
import pytest

from estimators import Advice
from experiments.formats.scenario import read_scenario
from experiments.plots.insertion import (
    hits_figure,
    misses_figure,
    reliabilities,
    reliability_figure,
    write_insertion_plots,
)
from experiments.simulation.advised import AdvisedInsertion
from experiments.simulation.cases import case_of
from experiments.simulation.closed_loop import Tried
from experiments.simulation.insert import Trials
from experiments.simulation.policies import POLICIES
from tests.experiments.plots.printed import check_printed, labels


@pytest.fixture(scope="module")
def trials():
    """40 runs: misses of 1, 2, ... 40 mm in a lesion of 5 mm, predicted as 95 % probable, but 3 of them as 25 %.

    And of 20 insertions that advice gave 55 %, 11 that hit.
    """
    runs = []
    for k in range(40):
        miss_m, reported = 1e-3 * (k + 1), 0.25 if k < 3 else 0.95
        runs.append(tuple(Tried(policy, k < 5, miss_m, 1.0, 1, reported, reported, 5e-3, k < 5) for policy in POLICIES))
    of_advice = [AdvisedInsertion(float(k), Advice.WAIT, 0.55, k < 11, 0.0) for k in range(20)]
    return Trials(case_of(read_scenario("quiet")), tuple(runs), (tuple(of_advice),))


def test_they_can_be_printed(trials):
    reliable = [reliability_figure(*one) for one in reliabilities(trials).values()]
    for figure in (hits_figure(trials), misses_figure(trials), *reliable):
        check_printed(figure, without_units=("policy",))


def test_misses_beyond_the_picture_are_counted_and_their_share_stays(trials):
    """20 of 40 within 20 mm: a line to one half, and 20 farther for each policy."""
    figure = misses_figure(trials)
    ax = figure.axes[0]
    steps = [line for line in ax.lines if len(line.get_xdata()) > 2]
    assert len(steps) == len(POLICIES)
    for line in steps:
        x, y = line.get_data()
        assert (x[-1], y[-1]) == (20.0, 50.0)
        assert y[np.searchsorted(x, 10.0)] == 25.0
    assert len({(line.get_color(), line.get_linestyle()) for line in steps}) == len(POLICIES)
    first, *_, last = labels(figure)
    assert (first, last) == (f"{POLICIES[0]} (20 farther)", "radius of the lesion, 5 mm")


def test_tenths_of_few_insertions_are_counted_and_not_drawn(trials):
    """37 predicted as 95 % probable, of which 2 hit: beyond its interval; 3 predicted as 25 % are left out."""
    figure = reliability_figure(*reliabilities(trials)["reliability"])
    ax = figure.axes[0]
    assert [text.get_text() for text in ax.texts] == ["37", "3 in bins of fewer than 5 left out"]
    assert labels(figure) == ["as predicted", "99 % interval excludes the prediction"]


def test_reliable_advice_contains_its_prediction(trials):
    figure = reliability_figure(*reliabilities(trials)["advised"])
    ax = figure.axes[0]
    assert [text.get_text() for text in ax.texts] == ["20"]
    assert np.ravel(ax.containers[0].lines[0].get_data()) == pytest.approx([0.55, 0.55])
    assert labels(figure) == ["as predicted", "99 % interval contains the prediction"]


def test_of_few_insertions_there_is_no_picture_of_their_reliability(trials, tmp_path):
    """Three runs and an insertion by advice: no bin has five. The axis of misses ends beyond the largest."""
    few = replace(trials, runs=trials.runs[3:6], advised=(trials.advised[0][:1],))
    write_insertion_plots(few, tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"hits.png", "misses.png"}
    ax = misses_figure(few).axes[0]
    assert ax.get_xlim() == (0.0, pytest.approx(1.2 * 6.0))


def test_of_curves_that_coincide_the_upper_is_narrower(trials):
    widths = [line.get_linewidth() for line in misses_figure(trials).axes[0].lines if len(line.get_xdata()) > 2]
    assert widths[2] > widths[3] > widths[4]
