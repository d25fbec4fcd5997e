"""The page of the architecture is made from the code, and tells of a new import or room."""

from collections import Counter
from pathlib import Path

import pytest

from experiments.studies import architecture
from experiments.studies.architecture import PACKAGES, PAGE, draw, layers_of, page, rooms_of


def test_the_page_is_what_the_code_is() -> None:
    assert page() == PAGE.read_text(encoding="utf-8"), "python -m experiments.studies.architecture"


def test_every_room_stands_in_a_layer_of_the_contract_and_says_what_it_holds() -> None:
    for package in PACKAGES:
        named = {f"{package}.{name}" for layer in layers_of(package) for name in layer}
        assert named == {room.name for room in rooms_of(package)}
        for room in rooms_of(package):
            assert room.holds.endswith("."), room.name


def test_folders_hold_at_most_fifteen_modules_and_modules_350_lines() -> None:
    root = Path(architecture.__file__).parents[2]
    for package in (*PACKAGES, "tests"):
        paths = list((root / package).rglob("*.py"))
        for folder, n_modules in Counter(path.parent for path in paths).items():
            assert n_modules <= 15, folder.relative_to(root)
        for path in paths:
            if path.name != "kernels.py":
                assert len(path.read_text(encoding="utf-8").splitlines()) <= 350, path.relative_to(root)


def test_imports_are_read_from_code(tmp_path: Path) -> None:
    path = tmp_path / "one.py"
    path.write_text("from dynamics.forces.energy import node_forces\nimport vision\nimport numpy\n")
    assert set(architecture._imported(path)) == {"dynamics.forces", "vision"}


def test_a_page_of_other_code_is_not_taken(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    other = tmp_path / "architecture.md"
    other.write_text(PAGE.read_text(encoding="utf-8").replace("- `guidance/`", "- `guide/`"))
    monkeypatch.setattr(architecture, "PAGE", other)
    monkeypatch.setattr("sys.argv", ["architecture", "--check"])
    with pytest.raises(SystemExit) as stopped:
        architecture.main()
    assert "make architecture-page" in str(stopped.value.code)


@pytest.mark.slow
def test_the_drawing_is_a_picture(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(architecture, "rooms_of", lambda package: rooms_of(package)[:2])  # arrows of these alone
    draw(tmp_path / "rooms.png")
    assert (tmp_path / "rooms.png").read_bytes().startswith(b"\x89PNG")
