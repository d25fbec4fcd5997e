"""The check of a wheel finds what is missing and what does not belong; `make wheel` runs it on the real one."""

from pathlib import Path
from zipfile import ZipFile

from tests.wheel import PACKAGES, faults, tracked

ENTRY = "softaim-0.1.0.dist-info/entry_points.txt"


def wheel(
    path: Path, names: list[str], entry: str = "[console_scripts]\nsoftaim = experiments.commands.app:main\n"
) -> Path:
    with ZipFile(path, "w") as archive:
        for name in names:
            archive.writestr(name, "")
        archive.writestr(ENTRY, entry)
    return path


def test_scenarios_labels_and_types_belong_in_it() -> None:
    belongs = set(tracked())
    assert {"softaim.py", "experiments/scenarios/poked.toml", "experiments/labels/balls.csv"} <= belongs
    assert {f"{package}/py.typed" for package in PACKAGES} <= belongs
    assert not any(name.startswith("tests/") for name in belongs)


def test_a_wheel_of_all_files_has_no_faults(tmp_path: Path) -> None:
    assert faults(wheel(tmp_path / "one.whl", tracked()), tracked()) == []


def test_what_is_missing_and_what_does_not_belong_is_told(tmp_path: Path) -> None:
    found = faults(
        wheel(tmp_path / "one.whl", ["softaim.py", "tests/x.py"], entry=""), ["softaim.py", "vision/py.typed"]
    )
    assert found == [
        "vision/py.typed: expected in the wheel, found none",
        "tests/x.py: found in the wheel, where it does not belong",
        "entry_points.txt: expected the command softaim, found none",
    ]
