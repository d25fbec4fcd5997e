"""The study of exchanged names, on one truth that turns over."""

import numpy as np
import pandas as pd
import pytest

from experiments.studies import identity
from experiments.studies.identity import FRAMES_PER_S, figures, named_run, reported_names, run, world

SECONDS = 2.5
"""Length of a truth [s]; names are exchanged from 1.5 s on."""


@pytest.fixture(autouse=True)
def _short(monkeypatch):
    monkeypatch.setattr(identity, "DURATION_S", SECONDS)
    monkeypatch.setattr(identity, "END_S", 0.8)


def test_names_from_a_turned_start_are_right(monkeypatch):
    """The rest shape says that two are exchanged, the motion that they are not: no swap; and the other way round.

    The close masses, let go from a shape that is turned over; a seed whose outcome does not hang on rounding.
    """
    monkeypatch.setattr(identity, "DURATION_S", 1.2)
    turned, alike = world("close", "quiet", 0), [("M1", "M3", "M4")]
    reported = reported_names("never", np.random.default_rng(0))
    right = named_run(turned, "never", reported, alike)
    assert (right["swaps"], right["wrong_frames"]) == (0, 0)
    exchanged = reported[:, [0, 2, 1]]
    found = named_run(turned, "from the start", exchanged, alike)
    assert (found["swaps"], found["wrong_end"]) == (1, False)
    assert found["wrong_frames"] < 0.6 * FRAMES_PER_S


def test_figures_of_a_run_are_reported_by_kind(monkeypatch):
    """One run without names, of every sixth frame."""
    monkeypatch.setattr(identity, "REPORTED", ("never", "for good", "from the start"))
    monkeypatch.setattr(identity, "NAMELESS", {"hidden": 6})
    rows = pd.DataFrame(run(0, "phantom", "quiet"))
    reported = figures(rows)
    assert reported["phantom quiet never"]["swaps"] == 0
    good = reported["phantom quiet for good"]
    assert (good["swaps"], good["late_most"]) == (1, 0)
    assert (good["runs_wrong_in_the_end"], good["runs_wrong_in_the_end_else"]) == (0, 1)
    assert good["end_mm"] == pytest.approx(good["end_mm_unswapped"], rel=0.02)
    assert good["end_mm_else"] > 1.05 * good["end_mm"]  # both marks are outliers then
    start = reported["phantom quiet from the start"]
    assert start["runs_wrong_in_the_end"] == 0
    assert start["end_mm_else"] > 3 * start["end_mm"]
    assert start["wrong_frames_else"] == SECONDS * FRAMES_PER_S
    assert reported["phantom quiet hidden"]["runs"] == 1
