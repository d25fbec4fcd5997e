"""The figures that the filter's settings serve, and that each of these settings names its unit and origin."""

import pytest

from estimators import FilterSettings
from estimators.association import IdentitySettings
from experiments.studies.estimation.figures import CAMERAS, estimation_figures
from experiments.studies.settings.sensitivity import ORIGINS, settings_of


@pytest.mark.parametrize("record", [FilterSettings(), IdentitySettings()])
def test_every_setting_names_its_origin(record) -> None:
    for setting in settings_of(record):
        assert setting.meaning, setting.path
        assert setting.origin in ORIGINS, setting.path
        assert setting.reason or setting.origin == "choice", setting.path


def test_figures_of_one_second() -> None:
    """Errors below the noise of a mark at 4.14 mm, shares between 0 and 1, one of each for every camera and kind."""
    figures = estimation_figures(FilterSettings(), seeds=(11,), seconds=1.0)
    names = [f"{kind}_{camera}" for kind in ("quiet", "poked") for camera in CAMERAS] + ["poked_missing"]
    assert set(figures) == {f"{name}_{what}" for name in names for what in ("mm", "coverage")}
    assert all(0.0 < figures[f"{name}_mm"] < 4.14 for name in names)
    assert all(0.0 <= figures[f"{name}_coverage"] <= 1.0 for name in names)
