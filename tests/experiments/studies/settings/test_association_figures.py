"""Figures of identity and of live waits: what is mended and shown follows the settings, by scripts of their own."""

from dataclasses import replace

import numpy as np
import pytest

from estimators.association import IdentitySettings
from experiments.pipeline.live.session import LIVE_DEFAULTS
from experiments.studies.settings.identity_figures import identity_figures
from experiments.studies.settings.live_figures import INTERVAL_S, live_figures, script


@pytest.mark.slow
def test_who_asks_for_more_proof_has_wrong_names_for_longer() -> None:
    """With infinite odds asked for nothing is ever mended; with the usual ones names are right for most of the 4 s."""
    usual, never = (
        identity_figures(settings, seeds=(906,), motions=("poked",))
        for settings in (IdentitySettings(), replace(IdentitySettings(), decisive=1e9, max_hypotheses=1))
    )
    assert usual["mended"] == 1.0
    assert 0.0 < usual["wrong_s"] < 2.0
    assert never["mended"] == 0.0
    assert never["wrong_s"] == pytest.approx(4.0)
    assert never["false_swaps"] == 0.0


def test_the_script_has_stalls_and_gaps() -> None:
    """In turns, of 0.1 to 0.8 s; pictures come in order, and never before their exposure."""
    one = script(703, 4.0)
    assert (np.diff(one.arrivals_s) >= 0.0).all()
    assert (one.arrivals_s - one.exposures_s >= 0.02).all()
    assert (one.arrivals_s - one.exposures_s).max() > 0.1
    missing = np.diff(one.exposures_s).max()
    assert 0.1 < missing < 0.8 + 2 * INTERVAL_S


@pytest.mark.slow
def test_longer_waits_lose_less_and_show_less() -> None:
    """Until something new is shown it takes the wait; a filter that stays behind for 1 s loses no picture."""
    quick = live_figures(replace(LIVE_DEFAULTS, behind_s=0.0), seeds=(703,), duration_s=4.0)
    slow = live_figures(replace(LIVE_DEFAULTS, wait_s=0.2, behind_s=1.0), seeds=(703,), duration_s=4.0)
    assert quick["unshown_s"] == pytest.approx(LIVE_DEFAULTS.wait_s)
    assert slow["unshown_s"] == pytest.approx(0.2)
    assert slow["late_share"] == 0.0 < quick["late_share"]
    assert slow["coasted_per_s"] < quick["coasted_per_s"]
