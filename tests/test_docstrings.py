"""Docstrings of public names: shapes and units of arrays, and names in backticks that exist."""

import pytest

from tests.docstrings import Public, constant_text, faults, public_names


def test_every_public_name_is_documented_by_the_conventions() -> None:
    assert len(list(public_names())) > 400
    assert faults() == []


def given(text: str, monkeypatch: pytest.MonkeyPatch, thing: object) -> list[str]:
    """The faults of one thing with this docstring."""
    one = Public("estimators.thing", thing, text, "estimators.guidance.hit_probability")
    monkeypatch.setattr("tests.docstrings.public_names", lambda: iter([one]))
    return faults()


def thing(points: "Floats", push: float) -> None:  # noqa: F821
    """Replaced in each test."""


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("", "expected a docstring, found none"),
        ("Moves points [m].", "expected shapes of points, as (n, dim), found none"),
        ("Moves points, (n, dim).", "expected units of points, as [m], found none"),
        ("Moves points [m], (n, dim), as `TissueFilter.predicted` does.", "`TissueFilter.predicted`: no such name"),
        ("Moves points [m], (n, dim), see `estimators.gone`.", "`estimators.gone`: no such name"),
        ("Moves points [m], (n, dim), see `GuidanceAdvice`.", "`GuidanceAdvice`: no such name"),
    ],
)
def test_what_is_not_stated_and_not_there_is_found(text: str, fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert given(text, monkeypatch, thing) == [f"estimators.thing: {fault}"]


def test_what_is_there_is_no_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    named = "`push`, `TissueFilter.predict`, `dynamics.forces`, `Lesion`, `ValueError`, `with`, `scene.toml`"
    assert given(f"Moves points [m], (n, dim); {named}.", monkeypatch, thing) == []


def test_a_constants_docstring_is_the_text_below_it() -> None:
    assert constant_text("dynamics", "SAME_STEP")[0].startswith("Relative excess of an interval")
    assert constant_text("dynamics", "SAME_STEP")[1] == "dynamics.integration.stepping"
    assert constant_text("dynamics", "NOT_THERE") == ("", "dynamics")
