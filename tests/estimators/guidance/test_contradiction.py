"""A contradiction is raised by marks that contradict the model only, and stays until a reset."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from estimators import Balance, CommonShift, Contradiction, Status, TargetEstimate
from estimators.filters.kernels import nis_left

ALL = ("M1", "M2", "M3")


def seen(time_s: float, nodes=ALL, nis: float = 4.0, status: Status = Status.TRACKING) -> TargetEstimate:
    share = dict.fromkeys(nodes, 0.3)
    return TargetEstimate(time_s, np.zeros(2), np.eye(2), status, len(nodes), nis, information_share=share)


def after(*estimates: TargetEstimate) -> str | None:
    contradiction = Contradiction()
    for estimate in estimates:
        contradiction.update(estimate)
    return contradiction.reason


def test_a_divergence_is_kept_in_mind_when_all_looks_well_again():
    well = [seen(1.0 + 0.1 * k) for k in range(50)]
    assert after(*well) is None
    assert "contradicted the model" in (after(seen(0.0), seen(0.1, status=Status.DIVERGED), *well) or "")


def test_it_is_over_when_somebody_says_so():
    contradiction = Contradiction()
    contradiction.update(seen(0.0, status=Status.DIVERGED))
    contradiction.forget()
    assert contradiction.reason is None
    contradiction.update(seen(0.1))
    assert contradiction.reason is None


@pytest.mark.parametrize(("away_s", "p", "contradicted"), [(1.0, 1e-5, True), (1.0, 1e-3, False), (0.1, 1e-5, False)])
def test_a_mark_has_to_come_back_where_it_is_expected(away_s, p, contradicted):
    """By the tail of chi-square with two coordinates for each of three marks; a short absence proves nothing."""
    without = [seen(0.03 * k, ("M2", "M3")) for k in range(1, int(away_s / 0.03))]
    reason = after(seen(0.0), *without, seen(away_s, nis=float(chi2.isf(p, 6))))
    assert (reason is not None) == contradicted
    if reason is not None:
        assert reason.startswith("mark M1 came back elsewhere")


def test_a_mark_that_comes_back_without_a_measured_coordinate_contradicts_nothing():
    back = replace(seen(1.0, nis=0.1), measured=0)
    assert after(seen(0.0), *(seen(0.03 * k, ("M2", "M3")) for k in range(1, 33)), back) is None


def test_a_large_innovation_of_marks_that_were_never_away_is_a_poke():
    assert after(*(seen(0.03 * k, nis=60.0) for k in range(20))) is None


def test_a_mark_that_is_seen_for_the_first_time_is_not_back():
    without = [seen(0.03 * k, ("M2", "M3")) for k in range(20)]
    assert after(*without, seen(0.6, ALL, nis=60.0)) is None


def test_a_force_that_goes_on_and_that_nothing_explains_is_kept_in_mind():
    """Of one coordinate of two, variance 1: 6 sigma is a probability of 1.5e-8, 4 sigma of 3e-4."""
    contradiction = Contradiction()
    contradiction.update(seen(0.0), Balance(("M1", "M2"), np.array([[4.0], [0.0]]), np.eye(2)))
    assert contradiction.reason is None
    contradiction.update(seen(0.1), Balance(("M1", "M2"), np.array([[0.0], [6.0]]), np.eye(2)))
    contradiction.update(seen(0.2))
    assert (contradiction.reason or "").startswith("a persistent force on M2")


@pytest.mark.parametrize(
    ("moved_mm", "contradicted"),
    [
        ({}, False),
        (dict.fromkeys(range(4), (6.0, 8.0)), True),
        (dict.fromkeys(range(4), (1.5, 2.0)), False),
        ({0: (60.0, 80.0)}, False),
        ({0: (6.0, 8.0), 1: (-6.0, 8.0)}, False),
        ({0: (60.0, 80.0), 1: (60.0, 80.0), 2: (60.0, 80.0)}, False),
    ],
)
def test_a_shift_of_all_marks_is_kept_in_mind_and_no_other_innovation(moved_mm, contradicted):
    """Four marks in the plane, each to 1 mm, correlated by 0.5 with each other, as of one body."""
    S = np.kron(0.5 * np.eye(4) + 0.5, np.eye(2))
    for seed in range(20):
        y = np.linalg.cholesky(S) @ np.random.default_rng(seed).normal(size=8)
        for k, by in moved_mm.items():
            y[2 * k : 2 * k + 2] += by
        shift = CommonShift(4, *nis_left(y, np.linalg.inv(S), 2))
        reason = after(replace(seen(0.0), shift=shift), seen(0.1))
        assert (reason is not None) == contradicted
        if reason is not None:
            assert reason.startswith("all marks moved together")


@pytest.mark.parametrize("status", Status)
def test_marks_of_a_start_may_all_move_together(status):
    reason = after(replace(seen(0.0, status=status), shift=CommonShift(3, 4.0, 100.0)))
    assert (reason is None) == (status is Status.INITIALISING)
