"""The check of a wheel finds what is missing and what does not belong; `make wheel` runs it on the real one."""

from pathlib import Path
from zipfile import ZipFile

import pytest

from tests.wheel import PACKAGES, faults, tracked

ROOT = Path(__file__).parent.parent
ENTRY = "softaim-1.2.3.dist-info/entry_points.txt"


def wheel(
    path: Path, names: list[str], entry: str = "[console_scripts]\nsoftaim = experiments.commands.app:main\n"
) -> Path:
    with ZipFile(path, "w") as archive:
        for name in names:
            archive.writestr(name, "")
        archive.writestr(ENTRY, entry)
    return path


in_a_clone = pytest.mark.skipif(not (ROOT / ".git").exists(), reason="what belongs in a wheel is what git knows")


@in_a_clone
def test_scenarios_labels_and_types_belong_in_it() -> None:
    belongs = set(tracked())
    assert {"softaim.py", "experiments/scenarios/poked.toml", "experiments/labels/balls.csv"} <= belongs
    assert {f"{package}/py.typed" for package in PACKAGES} <= belongs
    assert not any(name.startswith("tests/") for name in belongs)


def test_a_wheel_of_all_files_has_no_faults(tmp_path: Path) -> None:
    names = ["softaim.py", "vision/py.typed"]
    assert faults(wheel(tmp_path / "one.whl", names), names) == []


def test_what_is_missing_and_what_does_not_belong_is_reported(tmp_path: Path) -> None:
    found = faults(
        wheel(tmp_path / "one.whl", ["softaim.py", "tests/x.py"], entry=""), ["softaim.py", "vision/py.typed"]
    )
    assert found == [
        "vision/py.typed: expected in the wheel, found none",
        "tests/x.py: found in the wheel, where it does not belong",
        "entry_points.txt: expected the command softaim, found none",
    ]
