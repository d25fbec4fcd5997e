"""The figures that the filter's settings serve, and that each of these settings names its unit and origin."""

import numpy as np
import pytest

from estimators import FilterSettings
from estimators.association import IdentitySettings
from experiments.studies.estimation.figures import CAMERAS, HARD, estimation_figures
from experiments.studies.estimation.trials import Trial, seen
from experiments.studies.settings.constants import Constants, constants_figures
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
    names = [f"{kind}_{camera}" for kind in ("quiet", "poked") for camera in CAMERAS]
    names += [f"poked_{name}" for name in HARD]
    assert set(figures) == {f"{name}_{what}" for name in names for what in ("mm", "coverage")}
    assert all(0.0 < figures[f"{name}_mm"] < 4.14 for name in names if name != "poked_outliers")
    assert all(0.0 <= figures[f"{name}_coverage"] <= 1.0 for name in names)


def test_outliers_are_as_many_and_as_far_as_stated(tmp_path) -> None:
    """A tenth of 1,083 marks within three standard deviations of a binomial; 30 to 150 mm, but for noise of 0.1 mm."""
    rest, wild = (
        np.array([[mark.position for mark in marks] for _, marks in frames])
        for frames in (
            seen(Trial("quiet", 1, 12.0, mark_sd_m=1e-4, outliers=share), tmp_path, np.random.default_rng(1))[0]
            for share in (0.0, 0.1)
        )
    )
    away = np.linalg.norm(wild - rest, axis=-1)
    far = away > 0.01
    assert abs(far.mean() - 0.1) < 3.0 * np.sqrt(0.1 * 0.9 / far.size)
    assert 0.029 < away[far].min() < 0.04
    assert 0.14 < away[far].max() < 0.151
    assert away[~far].max() < 0.001


def test_constants_are_varied_and_put_back() -> None:
    """The module has another step while the figures are computed, and its own again after."""
    from estimators.process import process_model

    before = process_model.LONGEST_STEP
    assert Constants().longest_step_s == before
    with pytest.MonkeyPatch.context() as patched:
        steps = []
        patched.setattr(
            "experiments.studies.settings.constants.estimation_figures",
            lambda _settings: steps.append(process_model.LONGEST_STEP) or {},
        )
        constants_figures(Constants(longest_step_s=10.0 * before))
    assert steps == [10.0 * before]
    assert before == process_model.LONGEST_STEP
