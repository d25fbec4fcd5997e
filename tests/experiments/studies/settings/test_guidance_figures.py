"""The settings of guidance and the figures they serve: every field has its origin, thresholds move the figures."""

from dataclasses import replace

import pytest

from experiments.studies.settings.guidance_figures import GuidanceSettings, guidance_figures
from experiments.studies.settings.sensitivity import ORIGINS, settings_of

SHORT = {"poked": 6.0, "breathing": 9.0}


def test_every_field_has_a_meaning_and_an_origin():
    for one in settings_of(GuidanceSettings()):
        assert one.meaning, one.path
        assert one.origin in ORIGINS, one.path


@pytest.fixture(scope="module")
def figures():
    """Of the defaults, of a go of one half, and of a breath that has to explain more than there is; two seeds."""
    usual = GuidanceSettings()
    settings = {
        "usual": usual,
        "bold": replace(usual, advice=replace(usual.advice, go=0.5)),
        "strict": replace(usual, breathing=replace(usual.breathing, explained=1.0)),
    }
    return {name: guidance_figures(one, seeds=(801, 802), durations_s=SHORT) for name, one in settings.items()}


@pytest.mark.slow
def test_the_figures_are_of_advised_insertions(figures):
    """Shares lie in 0 to 1; of insertions begun at 90 % or more most hit; probabilities are right within 0.25."""
    for name in ("go_hit_rate", "go_share", "calibration_error", "breathing_share"):
        assert 0.0 <= figures["usual"][name] <= 1.0
    assert figures["usual"]["go_hit_rate"] > 0.6
    assert figures["usual"]["calibration_error"] < 0.25


def test_a_lower_threshold_starts_more_insertions(figures):
    assert figures["bold"]["go_share"] > figures["usual"]["go_share"] > 0.0


def test_without_a_breath_nothing_of_it_is_counted(figures):
    """Nine seconds hold one and a half breaths of up to six; none explains all of the track."""
    assert figures["strict"]["breathing_share"] == figures["strict"]["breathing_error_mm"] == 0.0
