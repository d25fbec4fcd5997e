"""A quick form of the study: a few runs of some of its parts, with figures that the whole one has to keep."""

import re
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd
import pytest

from estimators import IdentificationSettings
from experiments.studies.estimation import study as module
from experiments.studies.estimation.study import (
    PARTS,
    bound_row,
    by_start,
    figures,
    hard_trial,
    identified_rows,
    perturbed,
    row_of,
)
from experiments.studies.estimation.trials import Model, Outcome, Trial
from experiments.studies.grid import DOCS


def outcome(errors_mm, status="TRACKING"):
    """A run of 10 frames/s with these errors of the filter, and twice as large ones of the open loop; NEES is 2."""
    errors = 1e-3 * np.array(errors_mm, dtype=float)
    n = len(errors)
    return Outcome(np.arange(n) / 10, 2.0 * errors, errors, np.full(n, 2.0), (status,) * n, turned=False)


def test_figures_are_those_of_all_frames():
    """Two frames of 1 and 3 mm, and six of 5 mm."""
    found = figures(pd.DataFrame([row_of(outcome(errors)) for errors in ([1.0, 3.0], [5.0] * 6)]))
    assert found["runs"] == 2
    assert found["filter_mm"] == pytest.approx(34.0 / 8.0)
    assert (found["ratio"], found["coverage95"], found["nees"]) == pytest.approx((0.5, 1.0, 2.0))


@pytest.mark.parametrize(
    ("errors_mm", "status", "diverged"),
    [
        ([50.0] * 6 + [1.0], "TRACKING", 1),
        ([50.0] * 4 + [1.0], "TRACKING", 0),
        ([1.0] * 6 + [50.0], "TRACKING", 1),
        ([50.0] * 7, "DIVERGED", 0),
    ],
)
def test_a_run_diverged_where_it_was_far_off_and_did_not_say_so(errors_mm, status, diverged):
    found = figures(pd.DataFrame([row_of(outcome(errors_mm, status))]))
    assert (found["runs_diverged"], found["runs_ever_far"]) == (diverged, 1)


@pytest.mark.slow
def test_the_bound_lies_below_and_not_far(tmp_path, monkeypatch):
    """One quiet run of 2.5 s: RMSE 0.8 to 1.3 of the bound (100 runs: 1.05)."""
    monkeypatch.setattr("experiments.studies.estimation.study.Trial", partial(Trial, duration_s=2.5))
    runs = pd.DataFrame(bound_row({"seed": 100}, tmp_path))
    assert 0.8 < by_start(runs)["from the first frame"]["ratio"] < 1.3


def test_constants_that_are_off_are_off():
    """10 % of every stiffness, one draw a seed."""
    off, again = perturbed(3), perturbed(3)
    usual = Model()
    ratio = np.log(off.network.stiffness / usual.network.stiffness)
    assert 0.05 < ratio.std() < 0.2
    np.testing.assert_array_equal(off.network.stiffness, again.network.stiffness)


def test_hard_trials_are_as_hard_as_is_said():
    trials = [hard_trial(k) for k in range(300)]
    assert {trial.frames_per_s for trial in trials} == {5, 10, 15, 30, 60, 120}
    assert {trial.strength for trial in trials} == {1.0, 1.25, 1.5}
    noises = np.array([trial.mark_sd_m for trial in trials])
    assert 0.0005 <= noises.min() < 0.001
    assert 0.006 < noises.max() <= 0.008
    assert len({trial.seed for trial in trials}) == 300


def test_the_page_has_room_for_every_table_and_its_tables_are_whole():
    page = (DOCS / "estimation-study.md").read_text(encoding="utf-8")
    for name in PARTS:
        inside = re.search(f"<!-- {name} -->\n(.*)\n<!-- end of {name} -->", page, flags=re.DOTALL)
        assert inside, name
        lines = [line for line in inside[1].splitlines() if line.startswith("|")]
        assert len({line.count("|") for line in lines}) == 1
        assert len(lines) >= 3


def two_frames(case, cache):
    """A run of two frames for each seed."""
    return row_of(outcome([1.0, 3.0 + case["seed"] - 100]))


def test_the_command_puts_the_tables_of_its_parts_into_the_page(tmp_path, monkeypatch, capsys):
    page = tmp_path / "estimation-study.md"
    page.write_text("a\n<!-- unidentified -->\nold\n<!-- end of unidentified -->\nz", encoding="utf-8")
    monkeypatch.setattr("experiments.studies.grid.DOCS", tmp_path)
    monkeypatch.setitem(PARTS, "unidentified", replace(PARTS["unidentified"], work=two_frames))
    options = ["--out", str(tmp_path / "study"), "--page", "--runs", "2", "--processes", "1"]
    assert module.main(["unidentified", *options]) == 0
    new = page.read_text(encoding="utf-8")
    assert new.startswith("a\n<!-- unidentified -->\n|  | filter [mm] |")
    assert "| considered, all | 2.25 | 0.500 | 100.0% | 2.00 |\n| ignored, all | 2.25 |" in new
    assert new.endswith("\n<!-- end of unidentified -->\nz")
    assert "old" not in new
    assert "| ignored, all | 2.25 |" in capsys.readouterr().out


@pytest.mark.slow
def test_identified_runs_hold_their_figures(tmp_path, monkeypatch):
    """One phantom 10 % off, identified from 2 s, tracked for 2.5 s, by the open loop's error.

    The search has one start.
    """

    def short(name, seed, duration_s=2.5):
        return Trial(name, seed, duration_s=2.0 if duration_s > 2.5 else duration_s)

    monkeypatch.setattr(module, "Trial", short)
    monkeypatch.setattr(module, "SCENARIOS", ("poked",))
    one_start = IdentificationSettings(n_starts=1)
    monkeypatch.setattr("estimators.identification.constants.IdentificationSettings", lambda: one_start)
    found = pd.DataFrame(identified_rows({"seed": 100}, tmp_path))
    assert found["scenario"].tolist() == ["poked"]
    assert (found["filter_mm"] / found["open_loop_mm"] < 0.4).all()
