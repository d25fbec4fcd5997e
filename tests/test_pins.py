"""What is pinned is pinned in one way, and names no host."""

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parent.parent
PINS = [line for line in (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines() if line]


def test_pins_are_exact_versions_and_name_no_host() -> None:
    assert PINS
    for pin in PINS:
        assert re.fullmatch(r"[A-Za-z0-9_.-]+==[0-9][A-Za-z0-9.]*", pin), pin


def test_uv_and_pip_get_the_same_versions() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert project["tool"]["uv"]["constraint-dependencies"] == PINS


def test_every_dependency_is_pinned() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    named = [line for group in (project["dependencies"], *project["optional-dependencies"].values()) for line in group]
    wanted = {re.split(r"[<>=\[ ]", line)[0].lower().replace("_", "-") for line in named}
    pinned = {pin.split("==")[0].lower().replace("_", "-") for pin in PINS}
    assert wanted <= pinned
