"""Settings are read from docstrings, varied by paths, and their worth is told by the figure that changes most."""

from dataclasses import dataclass

import pytest

from experiments.studies.settings.sensitivity import Setting, changed, cost, settings_of, variants


@dataclass(frozen=True, slots=True)
class Inner:
    """Of a stage.

    reach_px: how far a mark is searched [px]; choice
    low, high: bounds of a share; source: [paper], table 2
    """

    reach_px: float = 4.0
    low: float = 0.2
    high: float = 0.8


@dataclass(frozen=True, slots=True)
class Outer:
    """Of a finder.

    frames: how many frames are kept, of which the median
        is taken; choice
    inner: the stage's own
    """

    frames: int = 5
    inner: Inner = Inner()


def test_settings_are_read_with_unit_and_origin() -> None:
    frames, reach, low, high = settings_of(Outer())
    assert frames == Setting("frames", "how many frames are kept, of which the median is taken", "", "choice", "", 5)
    assert reach == Setting("inner.reach_px", "how far a mark is searched [px]", "px", "choice", "", 4.0)
    assert (low.origin, low.reason, high.reason) == ("source", "[paper], table 2", "[paper], table 2")
    assert high.path == "inner.high"


def test_a_setting_is_changed_by_its_path() -> None:
    other = changed(Outer(), "inner.reach_px", 9.0)
    assert other.inner.reach_px == 9.0
    assert other.inner.low == 0.2
    assert other.frames == 5


@pytest.mark.parametrize(
    ("default", "expected"),
    [
        (4.0, {"half": 2.0, "twice": 8.0}),
        (5, {"half": 2, "twice": 10}),
        (1, {"twice": 2}),
        (0.0, {}),
        ((1.0, 4.0), {"half": (0.5, 2.0), "twice": (2.0, 8.0)}),
        (True, {}),
        ("FAST", {}),
        (None, {}),
    ],
)
def test_half_and_twice(default: object, expected: dict[str, object]) -> None:
    assert variants(Setting("x", "", "", "choice", "", default)) == expected


def test_the_cost_is_the_figure_that_changes_most() -> None:
    assert cost({"error_mm": 2.0, "covered": 0.95}, {"error_mm": 2.2, "covered": 0.94}) == "error_mm +10 %"
    assert cost({"error_mm": 2.0}, {"error_mm": 2.0001}) == "-"
    assert cost({"error_mm": 2.0}, "not allowed: go") == "not allowed: go"


@dataclass(frozen=True, slots=True)
class Needle:
    """Of a needle.

    radius_m: of the shaft [m]; source: 16 gauge
    cutting_N: force at the tip [N]; choice
    """

    radius_m: float = 8e-4
    cutting_N: float = 1.0  # noqa: N815


def test_names_with_units_in_capitals_are_read() -> None:
    radius, cutting = settings_of(Needle())
    assert (radius.origin, radius.reason) == ("source", "16 gauge")
    assert cutting == Setting("cutting_N", "force at the tip [N]", "N", "choice", "", 1.0)
