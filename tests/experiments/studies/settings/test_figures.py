"""Figures of settings: as computed by hand where that can be done, and worse where a setting is spoilt."""

import numpy as np
import pytest

from experiments.studies.settings import calibration_figures as cameras
from experiments.studies.settings.source_figures import source_figures
from vision import CalibrationSettings, SourceSettings


def test_figures_of_sources_follow_their_settings() -> None:
    figures = source_figures(SourceSettings())
    assert figures == pytest.approx(source_figures(SourceSettings()))  # no figure depends on the machine's speed
    assert figures["lost_in_pause"] == 90 - 64
    assert 2.0 < figures["back_after_hang_s"] <= 2.25
    assert 22.0 < figures["back_after_opening_hang_s"] <= 22.5
    assert figures["openings_of_a_slow_device"] == 1
    assert figures["hangs_survived"] == 3
    # 0.5 s at 30 and 10 frames/s, three intervals at 1 frame/s
    assert figures["noticed_s"] == pytest.approx((0.5 + 0.5 + 3.0) / 3.0, abs=2e-3)
    assert figures["exposure_error_ms"] < 8.0
    assert source_figures(SourceSettings(clock_error_s=0.005))["exposure_error_ms"] > 8.0


def test_drawn_boards_are_where_they_are_projected(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cameras, "SEEDS", range(9200, 9201))
    default = cameras._corner_error_px(CalibrationSettings())
    assert default < 0.07
    assert cameras._corner_error_px(CalibrationSettings(corner_window=0.1)) > 1.2 * default


def test_an_outlier_that_is_kept_costs_the_focal_length(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cameras, "SEEDS", range(9200, 9203))
    kept, left_out = (cameras._focal_error_with_outlier(CalibrationSettings(outlier_ratio=r)) for r in (100.0, 3.0))
    assert left_out < 0.8 * kept
    assert np.isclose(cameras.film_focal_sd(40) / cameras.film_focal_sd(10), 0.5, rtol=0.2)  # 1 / sqrt(n)
