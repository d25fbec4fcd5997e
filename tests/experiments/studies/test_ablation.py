"""The study of the filter's mechanisms: every switch acts, what would go is there, and the table is right."""

from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd
import pytest

from estimators.core import HypothesisFilter, tissue
from experiments.studies.ablation.__main__ import FIGURES, compared, main, markdown
from experiments.studies.ablation.recordings import Recording, recording
from experiments.studies.ablation.switches import SWITCHES, WHOLE

ACTS_ON = {
    "strengths raised for stiff bodies": ("block of 27", 6),
    "second linearisation": ("phantom", 40),
    "linearisation error as noise": ("phantom", 40),
    "outliers": ("four masses, outliers", 30),
    "considered constants": ("four masses, known to 10 %", 6),
}
"""Recordings on which a switch acts where it does not on the first frames of the phantom, and how many frames."""


@cache
def shortened(body: str, n_frames: int) -> Recording:
    whole = recording(body, 830, "")
    return replace(whole, frames=whole.frames[:n_frames])


@cache
def estimates(off: str, body: str, n_frames: int) -> tuple[np.ndarray, np.ndarray]:
    """Means and covariances of the first target."""
    given, switch = shortened(body, n_frames), SWITCHES[off]
    means, covs = [], []
    with switch.patched():
        filter_ = switch.filter(given)
        for time_s, marks in given.frames:
            filter_.predict(time_s)
            estimate = filter_.update(marks)
            means.append(estimate.mean)
            covs.append(estimate.cov)
    return np.array(means), np.array(covs)


@pytest.mark.parametrize("name", [name for name in SWITCHES if name != WHOLE])
def test_a_switch_changes_what_the_filter_gives(name):
    where = ACTS_ON.get(name, ("phantom", 6))
    means, covs = estimates(name, *where)
    before, own = estimates(WHOLE, *where)
    assert np.isfinite(means).all()
    assert not (np.array_equal(means, before) and np.array_equal(covs, own))


def test_constants_taken_as_exact_make_the_target_more_certain_in_every_frame_but_the_first():
    where = ACTS_ON["considered constants"]
    less, more = (estimates(off, *where)[1][1:] for off in ("considered constants", WHOLE))
    assert (less < more)[:, [0, 1], [0, 1]].all()


def test_each_switch_says_what_code_would_go():
    assert [name for name, one in SWITCHES.items() if not one.lines] == [WHOLE]


def test_the_filter_is_whole_again_afterwards():
    move, displaced = HypothesisFilter._move, tissue.DISPLACED
    for one in SWITCHES.values():
        with one.patched():
            assert (HypothesisFilter._move is move and displaced == tissue.DISPLACED) or one.patches
    assert HypothesisFilter._move is move
    assert displaced == tissue.DISPLACED


def table(**without):
    """Two bodies with the whole filter and without a mechanism, whose figures on the second body are these."""
    plain = dict(zip(FIGURES, (1e-3, 0.95, 1.0, 0, ""), strict=True)) | {"seed": 830, "frames": 90}
    rows = [{**plain, "body": body, "off": off} for off in (WHOLE, "outliers") for body in ("a", "b")]
    rows[-1] |= without
    return pd.DataFrame(rows)


def test_means_are_over_the_bodies_that_changed_and_the_worst_is_named():
    (row,) = compared(table(error_m=1.21e-3, covered=0.85)).itertuples()
    assert (row.error, row.covered) == pytest.approx((1.21, -10.0))
    assert (row.most, row.least) == ((pytest.approx(1.21), "b"), (pytest.approx(-10.0), "b"))
    assert (row.changed, row.bodies, row.failed) == (1, 2, 0)
    both = table(error_m=1.21e-3)
    both.loc[2, "nees"] = 1.1
    (row,) = compared(both).itertuples()
    assert (row.error, row.changed) == (pytest.approx(1.1), 2)


@pytest.mark.parametrize(
    ("without", "shown"),
    [({}, "| outliers | 1.000 (1.00 a) | +0.0 (+0.0) | 0/2 |"), ({"failed": "X"}, "| 1/2, 1 runs ended early |")],
)
def test_the_table_shows_what_had_no_effect_and_what_ended_early(without, shown):
    assert shown in markdown(table(**without))


def test_the_command_writes_its_table(tmp_path, capsys):
    options = ["--only", "outliers", "--bodies", "phantom", "--processes", "1"]
    assert main(["--out", str(tmp_path), *options]) == 0
    page = capsys.readouterr().out
    assert (tmp_path / "table.md").read_text() == page
    assert "| phantom | 0." in page
    assert "| outliers | " in page
