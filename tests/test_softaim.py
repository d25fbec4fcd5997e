"""`import softaim`: the names to start with, each that of its package, loaded when used; the version; types."""

import ast
import importlib
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import softaim

ROOT = Path(__file__).parent.parent
NAMES = [name for name in softaim.__all__ if name != "__version__"]


def seen_by_type_checkers() -> dict[str, str]:
    """Name to module of what stands under `if TYPE_CHECKING`."""
    tree = ast.parse((ROOT / "softaim.py").read_text(encoding="utf-8"))
    block = next(node for node in tree.body if isinstance(node, ast.If))
    imports = [node for node in block.body if isinstance(node, ast.ImportFrom)]
    return {alias.name: str(node.module) for node in imports for alias in node.names}


def listed() -> list[str]:
    """The names that the docstring lists."""
    block = (softaim.__doc__ or "").split("\n\n")[2]
    return [name for line in block.splitlines() for name in re.split(r"  +", line.strip())[0].split(", ")]


def test_the_names_are_listed_alike_in_all_places() -> None:
    assert 20 <= len(NAMES) <= 40
    assert sorted(listed()) == sorted(NAMES) == sorted(softaim._HOMES)
    assert seen_by_type_checkers() == softaim._HOMES


@pytest.mark.parametrize("name", NAMES)
def test_a_name_is_that_of_its_module(name: str) -> None:
    module = importlib.import_module(seen_by_type_checkers()[name])
    assert getattr(softaim, name) is getattr(module, name)
    assert name in dir(softaim)


def test_other_names_are_not_there() -> None:
    with pytest.raises(AttributeError, match="module 'softaim' has no attribute 'TissueFilters'"):
        softaim.TissueFilters  # noqa: B018


def test_the_version_is_that_of_the_project_and_of_the_newest_release() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    newest = re.search(r"^## \[(\d[\d.]*)\]", changelog, flags=re.MULTILINE)
    assert newest is not None
    assert softaim.__version__ == newest[1] == project["version"]


def test_importing_it_loads_nothing_else() -> None:
    """What is loaded is what takes time: numba alone half a second."""
    code = "import sys; import softaim; print(*sorted({name.split('.')[0] for name in sys.modules}))"
    loaded = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    assert not {"numpy", "numba", "cv2", "pandas", "dynamics", "estimators", "vision", "experiments"} & set(
        loaded.split()
    )


def test_every_package_has_types_for_others() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]
    packages = [pattern.rstrip("*") for pattern in project["packages"]["find"]["include"]]
    assert all((ROOT / package / "py.typed").is_file() for package in packages)
    assert project["package-data"]["*"] == ["py.typed"]
    assert project["py-modules"] == ["softaim"]


def test_the_module_runs_the_command(tmp_path: Path) -> None:
    run, env = [sys.executable, "-m", "softaim", "check", "none.toml"], os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(run, cwd=tmp_path, env=env, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "softaim: none.toml: expected a file, found none\n"
