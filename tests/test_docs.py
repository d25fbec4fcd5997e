"""Whatever the pages name exists: links, pictures, paths, modules and subcommands."""

import importlib.util
import re
from itertools import pairwise
from pathlib import Path

import pytest

from experiments.commands import page as commands_page
from experiments.commands.app import COMMANDS

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
FOLDERS = "dynamics|estimators|vision|experiments|tests|docs"
SUFFIXES = "py|md|toml|csv|png|json"


def missing_links(page: Path) -> list[str]:
    """Targets of relative links and pictures that are not there, and anchors without their heading."""
    missing = []
    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
        if re.match(r"[a-z]+:", target):
            continue
        path, _, anchor = target.partition("#")
        linked = (page.parent / path).resolve() if path else page
        if not linked.is_file() or (anchor and anchor not in anchors(linked)):
            missing.append(target)
    return missing


def anchors(page: Path) -> set[str]:
    """Names under which the headings of a page are linked."""
    headings = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def missing_paths(page: Path) -> list[str]:
    """Paths of the repository in backticks that are not there."""
    named = re.findall(rf"`((?:{FOLDERS})/[\w./-]*\.(?:{SUFFIXES}))`", page.read_text(encoding="utf-8"))
    return [path for path in named if not (ROOT / path).is_file()]


def missing_modules(page: Path) -> list[str]:
    """Modules that a command of a page runs and that are not there; a part in capitals stands for any name."""
    named = re.findall(r"python -m ((?:experiments|tests)[\w.]*\w)", page.read_text(encoding="utf-8"))
    return [name for name in named if not is_module(name) and not any(part.isupper() for part in name.split("."))]


def is_module(name: str) -> bool:
    """Whether a module of this name can be imported."""
    try:
        return importlib.util.find_spec(name) is not None
    except ModuleNotFoundError:
        return False


def missing_subcommands(page: Path) -> list[str]:
    """Subcommands that a page names, in backticks or at the start of a line of a block, and that are not registered."""
    named = re.findall(r"(?:`|^)softaim ([a-z][\w-]*)", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
    known = {command.__name__.replace("_", "-") for command in COMMANDS}
    return [name for name in named if name not in known]


def crooked_tables(page: Path) -> list[str]:
    """Rows of a table that have another number of cells than the row before."""
    lines = page.read_text(encoding="utf-8").splitlines()
    pairs = [(a, b) for a, b in pairwise(lines) if a.startswith("|") and b.startswith("|")]
    return [b for a, b in pairs if cells(a) != cells(b)]


def cells(row: str) -> int:
    """How many cells a row of a table has; a bar in backticks or escaped ends none."""
    return re.sub(r"`[^`]*`|\\\|", "", row).count("|")


CHECKS = (missing_links, missing_paths, missing_modules, missing_subcommands, crooked_tables)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_what_a_page_names_is_there_and_its_tables_are_straight(page: Path) -> None:
    assert {check.__name__: check(page) for check in CHECKS} == {check.__name__: [] for check in CHECKS}


def test_what_is_missing_is_found(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(
        "# One\n[a](gone.md) [b](#one) [c](#two) [d](https://example.org/x)\n"
        "`dynamics/gone.py`, `dynamics/__init__.py`, `python -m experiments.studies.NAME`\n"
        "`python -m experiments.gone`, `python -m experiments.studies.readme`\n`softaim vanish`, `softaim track rec`\n"
        "| a | b |\n| --- | --- |\n| 1 |\n",
        encoding="utf-8",
    )
    expected = [["gone.md", "#two"], ["dynamics/gone.py"], ["experiments.gone"], ["vanish"], ["| 1 |"]]
    assert [check(page) for check in CHECKS] == expected


def test_every_picture_is_shown_on_a_page() -> None:
    text = "".join(page.read_text(encoding="utf-8") for page in PAGES)
    pictures = sorted((ROOT / "docs" / "images").iterdir())
    assert [path.name for path in pictures if f"images/{path.name})" not in text] == []


def test_the_page_of_commands_is_what_their_help_says() -> None:
    text = commands_page.PAGE.read_text(encoding="utf-8")
    assert commands_page.page(text) == text, "python -m experiments.commands.page"
