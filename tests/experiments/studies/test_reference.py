"""The API reference: public names have docstrings with shapes and units, it is built, its links lead somewhere."""

import re
from pathlib import Path

import pytest

from experiments.studies.reference import (
    PACKAGES,
    Public,
    as_markdown,
    broken_links,
    build,
    constant_text,
    faults,
    public_names,
    short_types,
)


def test_every_public_name_is_documented_by_the_conventions() -> None:
    assert len(list(public_names())) > 400
    assert faults() == []


def test_it_is_built_without_a_warning_and_its_links_lead_somewhere(tmp_path: Path) -> None:
    """Warnings of pdoc are errors; types are named as in the code."""
    build(tmp_path)
    assert broken_links(tmp_path) == []
    page = (tmp_path / "estimators.html").read_text(encoding="utf-8")
    assert {path.stem for path in tmp_path.glob("*.html")} == {*PACKAGES, "index"}
    assert 'id="TissueFilter.predict"' in page
    assert "dtype" not in re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)


def given(text: str, monkeypatch: pytest.MonkeyPatch, thing: object) -> list[str]:
    """The faults of one thing with this docstring."""
    one = Public("estimators.thing", thing, text, "estimators.guidance.hit_probability")
    monkeypatch.setattr("experiments.studies.reference.public_names", lambda: iter([one]))
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


def test_links_that_lead_nowhere_are_found(tmp_path: Path) -> None:
    (tmp_path / "a.html").write_text('<a id="x" href="#x"><a href="#y"><a href="b.html"><a href="https://c.org/d">')
    assert broken_links(tmp_path) == ["a.html: #y", "a.html: b.html"]


def test_fields_and_names_become_lists() -> None:
    """A field may go on in the next line; a paragraph follows after a blank line."""
    text = "One.\n\n    A, B    two\n\nx, y: places [m],\n    (n, dim)\nRaises ValueError: never.\nNot a field."
    assert as_markdown(text).splitlines() == [
        "One.",
        "",
        "- `A`, `B`: two",
        "",
        "",
        "- **x, y**: places [m],",
        "  (n, dim)",
        "- **Raises ValueError**: never.",
        "",
        "Not a field.",
    ]


def test_types_of_arrays_are_short() -> None:
    spelt = "numpy.ndarray[tuple[typing.Any, ...], numpy.dtype[numpy.%s]]"
    assert short_types(f"x: {spelt % 'float64'} | None") == "x: Floats | None"
    assert short_types(f"x: {spelt % 'bool'}") == "x: NDArray[bool]"
