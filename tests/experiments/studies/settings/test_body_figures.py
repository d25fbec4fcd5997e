"""Figures of stiff and large bodies follow their constants."""

from dataclasses import replace

import pytest

from experiments.studies.settings.body_figures import BodyConstants, body_figures

LINKS = {"chain2": 1.0}


@pytest.fixture(scope="module")
def default() -> dict[str, float]:
    return body_figures(BodyConstants(), (5,), LINKS)


def test_links_taken_as_exact_are_covered_less(default):
    exact = body_figures(BodyConstants(strain_sd=1e-9, quiet_white=0.03), (5,), LINKS)
    assert set(exact) == set(default) == {"chain2_mm", "chain2_coverage"}
    assert exact["chain2_coverage"] < default["chain2_coverage"] - 0.1


@pytest.mark.parametrize(
    "name", ["strain_length", "quiet_white", "poked_white", "led_white", "led_poke", "led_lasting_s"]
)
def test_constants_reach_the_filter(name, default):
    """Ten times of each gives other figures; two links have one mark, no crowd, and two directions of strain."""
    ten_times = replace(BodyConstants(), **{name: 10.0 * getattr(BodyConstants(), name)})
    assert body_figures(ten_times, (5,), LINKS) != default
