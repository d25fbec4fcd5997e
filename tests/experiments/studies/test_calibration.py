"""Runs before a camera that is off: what is drawn, and that it is the same in every frame."""

import numpy as np
import pytest

from dynamics import OUTER, four_mass_phantom
from experiments.studies.calibration import (
    CONSIDERED,
    FILTERS,
    INDEPENDENT,
    TURNED,
    WHOLE,
    figures,
    miscalibrated_camera,
    run,
)


@pytest.mark.parametrize(("kind", "n"), [(WHOLE, 15), (TURNED, 4)])
def test_marks_at_rest_are_off_by_so_much(kind, n):
    """Root mean square over draws of unit variance, marks and both axes together; by 20,000 draws to 2 %."""
    network, camera = four_mass_phantom(), miscalibrated_camera(0.002, kind)
    moved = camera.calibration_error([network.positions[network.index(node)] for node in OUTER])
    draws = moved @ np.random.default_rng(0).normal(size=(n, 20_000))
    assert np.sqrt((draws**2).sum(axis=1).mean()) == pytest.approx(0.002, rel=0.02)


def test_a_run_has_all_filters_on_the_same_marks(tmp_path):
    """One second: sigma is larger where the error is assumed constant; of the 15 settled frames, errors below 5 mm."""
    found = run(7000, (TURNED, "quiet", 0.002), tmp_path, duration_s=1.0)
    assert set(found) == set(FILTERS)
    rows = {name: figures([found], name) for name in FILTERS}
    assert rows[CONSIDERED]["sigma_mm"] > rows[INDEPENDENT]["sigma_mm"]
    assert all(row["error_mm"] < 5.0 for row in rows.values())
    assert len(found[INDEPENDENT][0]) == 15
