"""The documentation site: pages have their place, Python examples are run, fields of docstrings become sections."""

from __future__ import annotations

import re
import tomllib
from collections import Counter
from fnmatch import fnmatchcase
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path, PurePosixPath
from posixpath import normpath
from typing import Any

import pytest

ROOT = Path(__file__).parent.parent
START = "docs/index"
PAGES = {
    path.relative_to(ROOT).with_suffix("").as_posix(): path.read_text(encoding="utf-8")
    for path in (*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"))
}
SECTIONS = ["docs/tutorials", "docs/how-to", "docs/explanation", "docs/reference", "docs/studies"]


def listed(page: str, text: str) -> list[str]:
    """Entries of the tables of contents of a page, from the root of the repository."""
    blocks = re.findall(r"^```\{toctree\}\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)
    lines = [line for block in blocks for line in block.splitlines() if line and not line.startswith(":")]
    entries = [re.sub(r".*<(.*)>", r"\1", line) for line in lines]
    return [normpath((PurePosixPath(page).parent / entry).as_posix()) for entry in entries]


def placed() -> Counter[str]:
    """How often each page is in a table of contents: once for all entries of a page that match it."""
    return Counter(
        name
        for page, text in PAGES.items()
        for name in PAGES
        if any(fnmatchcase(name, entry) for entry in listed(page, text))
    )


def test_each_page_is_in_one_table_of_contents() -> None:
    assert placed() == dict.fromkeys(PAGES.keys() - {START}, 1)


def test_each_entry_has_a_page() -> None:
    entries = [entry for page, text in PAGES.items() for entry in listed(page, text)]
    assert [entry for entry in entries if not any(fnmatchcase(name, entry) for name in PAGES)] == []


def test_the_kinds_of_pages_are_apart() -> None:
    assert listed(START, PAGES[START]) == SECTIONS


@pytest.mark.parametrize("section", SECTIONS)
def test_the_table_of_a_section_links_its_pages(section: str) -> None:
    links = re.findall(r"\]\(([^)#]+)\.md\)", PAGES[section])
    linked = [normpath(f"docs/{link}") for link in links]
    entries = listed(section, PAGES[section])
    assert [entry for entry in entries if "*" not in entry and entry not in linked] == []
    assert [name for name in linked if not any(fnmatchcase(name, entry) for entry in entries)] == []


def test_python_examples_of_pages_are_run() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    options = project["tool"]["pytest"]["ini_options"]
    examples = {f"{name}.md" for name, text in PAGES.items() if re.search(r"^>>> ", text, flags=re.MULTILINE)}
    assert examples == {path for path in options["testpaths"] if path.endswith(".md")}
    assert {f"--doctest-glob={Path(path).name}" for path in examples} <= set(options["addopts"])


def test_targets_of_make_that_pages_name_exist() -> None:
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), flags=re.MULTILINE))
    released = "CHANGELOG"  # names what was there
    text = "\n".join(text for name, text in PAGES.items() if name != released)
    assert set(re.findall(r"(?:^|`)make ([a-z-]+)", text, flags=re.MULTILINE)) <= targets


def fields() -> Any:
    """The module of the site that converts docstrings; it needs no Sphinx."""
    spec = spec_from_file_location("fields_of_docstrings", ROOT / "docs" / "_extensions" / "fields.py")
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def pushed(points: Any, force: float = 0.0) -> None:
    """Has annotations as text, as all functions of the packages."""


def test_fields_become_sections() -> None:
    """A field may continue in the next line; other text, such as a word before a colon, stays where it is."""
    text = "One.\n\npoints: places [m],\n    (n, dim)\nforce: on each [N]\nRaises ValueError: never.\nTwo: three."
    assert fields().as_numpydoc(text.splitlines(), pushed) == [
        *("One.", "", "", "Two: three."),
        *("", "Parameters", "----------", "points : `Any`", "    places [m],", "    (n, dim)"),
        *("force : `float`", "    on each [N]"),
        *("", "Raises", "------", "ValueError", "    never."),
    ]


def test_fields_in_one_line_and_in_lines_that_are_not_indented() -> None:
    text = "One.\n\npoints: a; force: on each,\nwhich is small; other: no field\nNo field, either."
    assert fields().as_numpydoc(text.splitlines(), pushed) == [
        *("One.", "", "", "No field, either."),
        *("", "Parameters", "----------", "points : `Any`", "    a"),
        *("force : `float`", "    on each,", "    which is small; other: no field"),
    ]


def test_keys_of_sources_lead_to_the_references() -> None:
    assert fields().with_links("See [blom1988], x [m].") == "See :doc:`[blom1988] </REFERENCES>`, x [m]."
