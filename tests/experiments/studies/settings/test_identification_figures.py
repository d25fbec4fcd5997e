"""Figures of identification and of constants of prediction, on short recordings, where a value is spoilt."""

from dataclasses import replace

import numpy as np
import pytest

from estimators.identification.constants import PRIOR_SD
from estimators.tissue.fast_prediction import SPEEDS_M_S
from experiments.studies.settings.constants_of_prediction import PredictionConstants, prediction_figures
from experiments.studies.settings.identification_figures import Identification, identification_figures, identified


def test_the_defaults_are_those_of_the_modules() -> None:
    assert Identification().prior_sd == PRIOR_SD
    assert PredictionConstants().speeds_m_s == pytest.approx(SPEEDS_M_S)


@pytest.mark.slow
def test_a_prior_that_excludes_the_truth_is_found_out() -> None:
    """A tenth of the spread of the true constants: their errors stay, and intervals no longer cover them."""
    usual, _ = found = identified(Identification(), 853, 2.0)
    narrow = identified(replace(Identification(), stiffness_sd=0.01), 853, 2.0)
    stiff = np.array([one.kind == "stiffness" for one in usual.parameters])
    worst = [float(np.abs(error / one.sd)[stiff].max()) for one, error in (found, narrow)]
    assert worst[0] < 3.5 < worst[1]


@pytest.mark.slow
def test_fewer_directions_are_kept_of_less_of_the_variance() -> None:
    settings = {"usual": Identification(), "half": Identification(kept=0.5)}
    found = {name: identification_figures(one, seeds=(853,), durations_s=(1.0, 0.5)) for name, one in settings.items()}
    assert found["half"]["directions"] < found["usual"]["directions"]
    assert found["half"]["level_score"] == found["usual"]["level_score"]  # noise levels do not depend on what is kept


@pytest.mark.slow
def test_a_spread_of_nothing_makes_predictions_too_certain() -> None:
    case = (("turned", "quiet", 0.002),)
    usual, none, schmidt = (
        prediction_figures(one, seeds=(813,), duration_s=2.5, calibrations=case)
        for one in (PredictionConstants(), PredictionConstants(spread=0.0), PredictionConstants(added_share=0.0))
    )
    assert none["sigma_ratio"] < 0.95 * usual["sigma_ratio"]
    assert none["calibrated_mm"] == usual["calibrated_mm"] != schmidt["calibrated_mm"]
    assert schmidt["sigma_ratio"] == usual["sigma_ratio"]
