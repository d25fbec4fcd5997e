"""Figures of needles: arrivals and plans by simulated insertions, spoilt where their noise is."""

from dataclasses import replace

import numpy as np
import pytest

from estimators import NeedleNoise, PlannedNeedle
from experiments.studies.settings.needle_figures import AIM_M, SPEEDS_M_S, needle_figures, pushed
from experiments.studies.settings.planning_figures import planning_figures


def test_an_insertion_starts_at_the_skin_at_rest_and_reaches_the_target() -> None:
    one = pushed(600)
    assert one.tips[0] == pytest.approx([0.0, 0.0])
    assert np.interp(one.arrival_s, one.times_s, one.tips[:, 1]) == pytest.approx(AIM_M)
    assert AIM_M / (1.5 * SPEEDS_M_S[1]) < one.arrival_s < AIM_M / (0.5 * SPEEDS_M_S[0])
    assert np.std(one.seen - one.tips) == pytest.approx(0.5e-3, rel=0.2)


def test_arrivals_are_covered_by_the_default_and_not_by_a_needle_of_constant_speed() -> None:
    """A 95 % interval covers 85 % or more of the arrivals; of one that excludes wavering far fewer."""
    usual = needle_figures(NeedleNoise(), seeds=range(560, 570))
    stiff = needle_figures(replace(NeedleNoise(), acceleration=1e-4, bending=1e-6), seeds=range(560, 570))
    assert usual["arrival_coverage"] > 0.85
    assert stiff["arrival_coverage"] < 0.6
    assert stiff["tip_coverage"] < 0.5 * usual["tip_coverage"]
    assert stiff["arrival_ms"] > usual["arrival_ms"]


def test_a_plan_by_other_forces_is_worth_less_to_the_needle_stated() -> None:
    usual = planning_figures(PlannedNeedle(), n_entries=10)
    other = planning_figures(replace(PlannedNeedle(), cutting_N=4.0), n_entries=10)
    assert usual["stated_hit"] == pytest.approx(usual["best_hit"], abs=1e-12)
    assert other["shift_mm"] > 1.5 * usual["shift_mm"]
    assert other["stated_hit"] < usual["stated_hit"] - 0.1
    assert planning_figures(replace(PlannedNeedle(), force_sd=0.0), n_entries=10)["best_hit"] > usual["best_hit"]
