"""Figures of stiff and large bodies follow their constants."""

from dataclasses import replace
from functools import cache

import pytest

from experiments.studies.settings.body_figures import BodyConstants, body_figures

CABLE = {"cable-slow": 0.4}


@cache
def usual(name: str, seconds: float) -> dict[str, float]:
    """Figures of a body by the constants as they are."""
    return body_figures(BodyConstants(), (5,), {name: seconds})


def test_a_cable_taken_as_exact_is_covered_less():
    default = usual("cable-slow", 0.4)
    exact = body_figures(BodyConstants(strain_sd=1e-9, quiet_white=0.03, undirected=0.0), (5,), CABLE)
    assert set(exact) == set(default) == {"cable-slow_mm", "cable-slow_coverage"}
    assert exact["cable-slow_coverage"] < default["cable-slow_coverage"] - 0.1


@pytest.mark.parametrize(
    "name",
    [
        "strain_length",
        "quiet_white",
        "poked_white",
        "led_white",
        "led_poke",
        "led_lasting_s",
        "hidden_share",
    ],
)
def test_constants_reach_the_filter(name):
    """Ten times of each gives other figures, of a block that is pressed and pulled."""
    ten_times = replace(BodyConstants(), **{name: 10.0 * getattr(BodyConstants(), name)})
    assert body_figures(ten_times, (5,), {"block27": 0.2}) != usual("block27", 0.2)


@pytest.mark.parametrize("changed", [{"turned": 1e-3}, {"hidden_share": 3.0}])
def test_constants_of_large_bodies_reach_the_filter(changed):
    """A sheet of 25 free nodes: more passes, and pokes on nodes within, give other figures."""
    sheet = {"sheet": 0.2}
    assert body_figures(replace(BodyConstants(), **changed), (5,), sheet) != usual("sheet", 0.2)


@pytest.mark.parametrize("name", ["led_poke", "led_lasting_s", "undirected"])
def test_constants_of_a_led_body_reach_the_filter(name):
    """The end of a cable is led, so that no mode of a hand is left, and innovations inflate what is reported."""
    cable = {"cable-fast": 0.3}
    ten_times = replace(BodyConstants(), **{name: 10.0 * getattr(BodyConstants(), name)})
    assert body_figures(ten_times, (5,), cable) != usual("cable-fast", 0.3)
