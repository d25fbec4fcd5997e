"""Tables and figures of a track whose estimates are no longer numbers."""

import json

import numpy as np
import pytest

from experiments.pipeline.line import FILTER
from experiments.pipeline.track import figures, table, write_tables
from tests.experiments.plots.tracks import made_track, phantom, small_errors


def test_a_singular_covariance_holds_no_error(tmp_path):
    """One frame in ten: its NEES is infinite and outside of the region, the other frames' are as they were."""
    sigmas = np.full(40, 1e-3)
    errors = small_errors(40, 2)
    usual = table(made_track(phantom(), errors, sigmas), FILTER)["nees"].to_numpy()
    np.testing.assert_allclose(usual, (errors**2).sum(axis=1) / 1e-6)
    sigmas[::10] = 0.0
    done = made_track(phantom(), errors, sigmas)
    nees = table(done, FILTER)["nees"].to_numpy()
    assert np.isposinf(nees[::10]).all()
    rest = np.arange(40) % 10 > 0
    np.testing.assert_allclose(nees[rest], usual[rest])
    assert figures(done, FILTER)["coverage95"] == pytest.approx((usual[rest] < 5.991).sum() / 40)
    assert figures(done, FILTER)["mean_nees"] is None


def test_a_summary_is_json_whatever_the_estimates_are(tmp_path):
    """No NaN and no Infinity, which JSON does not have: null."""
    errors = small_errors(40, 2)
    errors[3] = np.inf
    done = made_track(phantom(), errors, np.full(40, 1e-3))
    write_tables(done, tmp_path)
    read = json.loads((tmp_path / "summary.json").read_text(), parse_constant=pytest.fail)
    assert [read[FILTER][key] for key in ("mae_mm", "sd_mm", "rmse_mm")] == [None] * 3
    assert read[FILTER]["frames"] == 40
