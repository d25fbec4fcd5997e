"""Whatever is wrong with what a command is given: one line, exit code 2, and nothing lost or left behind."""

import re
import shutil
import tomllib
from collections import Counter
from pathlib import Path

import pytest

from experiments.commands.app import COMMANDS
from tests.experiments.command import softaim
from tests.experiments.commands.good_files import tree
from tests.experiments.rows import rows

INPUT = tomllib.loads((Path(__file__).parent / "bad_input.toml").read_text(encoding="utf-8"))
TABLE = [*({"call": call, "said": said} for call, said in rows(INPUT["calls"])), *INPUT["case"]]


def spoil(folder: Path, change: dict[str, str]) -> None:
    """Make one change of bad_input.toml; what it changes must be there."""
    if "remove" in change:
        path = folder / change["remove"]
        shutil.rmtree(path) if path.is_dir() else path.unlink()
        return
    if "folder" in change:
        (folder / change["folder"]).mkdir()
        return
    path = folder / change["file"]
    if "content" in change:
        path.write_text(change["content"], encoding="utf-8")
    elif "bytes" in change:
        path.write_bytes(bytes.fromhex(change["bytes"]))
    elif "append" in change:
        path.write_text(path.read_text(encoding="utf-8") + change["append"], encoding="utf-8")
    else:
        before, found, after = path.read_text(encoding="utf-8").partition(change.get("old") or change["from"])
        assert found
        path.write_text(before + change["new"] + (after if "old" in change else ""), encoding="utf-8")


def pattern(said: str) -> str:
    """A message as a regular expression; … stands for any text."""
    return ".*".join(re.escape(part) for part in said.split("…"))


@pytest.mark.parametrize("case", TABLE, ids=lambda case: f"{case['call'].split()[0]}: {case['said'][:60]}")
def test_bad_input_is_one_line_and_nothing_is_lost(here: Path, capfd: pytest.CaptureFixture[str], case: dict):
    for change in case.get("spoilt", ()):
        spoil(here, change)
    before = tree(here)
    code = softaim(*case["call"].split())
    shown = capfd.readouterr()
    assert re.fullmatch(f"softaim: {pattern(case['said'])}\n", shown.err), shown.err
    assert code == 2
    assert shown.out == ""
    assert tree(here) == before


def test_the_table_is_of_every_command_that_takes_input() -> None:
    kinds = Counter(case["call"].split()[0] for case in TABLE)
    assert {command.__name__ for command in COMMANDS} <= set(kinds)
    assert len({case["said"] for case in TABLE}) >= 60
