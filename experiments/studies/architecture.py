"""Drawing and lists of docs/architecture.md: the sub-packages of the four packages, and the imports between them.

    python -m experiments.studies.architecture          # rewrites drawing and lists from the code
    python -m experiments.studies.architecture --check  # exit code 1 if the page differs from the code

The code calls a sub-package a room. The first line of its docstring states its content.
"""

from __future__ import annotations

import argparse
import ast
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.formats.outputs import write_whole
from experiments.formats.page import replaced

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.patches import Patch

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "architecture.md"
DRAWING = ROOT / "docs" / "images" / "rooms.png"
PACKAGES = ("dynamics", "vision", "estimators", "experiments")


@dataclass(frozen=True, slots=True)
class Room:
    """A sub-package: its name, its content, and the sub-packages that it imports."""

    name: str
    holds: str
    imports: frozenset[str]


@cache
def rooms_of(package: str) -> list[Room]:
    """The sub-packages of a package, sorted by name. A sub-package includes the modules of its sub-folders."""
    found = []
    for folder in sorted(path.parent for path in (ROOT / package).glob("*/__init__.py")):
        text = ast.get_docstring(ast.parse((folder / "__init__.py").read_text(encoding="utf-8"))) or ""
        first = text.split("\n\n", maxsplit=1)[0]
        name = f"{package}.{folder.name}"
        imported = {room for path in folder.rglob("*.py") for room in _imported(path)}
        found.append(Room(name, " ".join(first.split()), frozenset(imported - {name})))
    return found


def _imported(path: Path) -> Iterator[str]:
    """Names of the packages and sub-packages from which a module imports."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        names = []
        if isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names = [node.module]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        for name in names:
            parts = name.split(".")
            if parts[0] in PACKAGES:
                is_room = len(parts) > 1 and (ROOT / parts[0] / parts[1] / "__init__.py").exists()
                if is_room or len(parts) == 1:
                    yield ".".join(parts[:2]) if is_room else parts[0]


def layers_of(package: str) -> list[list[str]]:
    """Names of a package's sub-packages in the layers of the import contract, top layer first."""
    tools = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]
    own = next(one for one in tools["importlinter"]["contracts"] if one.get("containers") == [package])
    layers = [[name.strip() for name in layer.split("|")] for layer in own["layers"]]
    inside = [[name for name in layer if (ROOT / package / name / "__init__.py").exists()] for layer in layers]
    return [layer for layer in inside if layer]


def tables() -> str:
    """Lists of sub-packages in Markdown, from the top layer down, and a checksum of the imports between them."""
    parts, imports = [], []
    for package in PACKAGES:
        rooms = {room.name.split(".")[1]: room for room in rooms_of(package)}
        parts += [f"### `{package}/`", ""]
        for name in (name for layer in layers_of(package) for name in layer):
            room = rooms[name]
            parts.append(f"- `{name}/` {room.holds}")
            imports.append(f"{room.name}: {', '.join(sorted(room.imports))}")
        parts.append("")
    digest = sha256("\n".join(imports).encode()).hexdigest()
    return "\n".join([*parts, f"<!-- imports of the drawing: {digest[:16]} -->"])


def page() -> str:
    """The text of docs/architecture.md, with lists made from the code."""
    return replaced(PAGE.read_text(encoding="utf-8"), {"rooms": tables()})


FRAMES: dict[str, tuple[float, tuple[str, ...], float, str]] = {
    "dynamics": (0.0, (), 8.0, "#dbe9f6"),
    "estimators": (0.0, ("dynamics",), 8.0, "#fbe9d0"),
    "vision": (8.6, ("dynamics",), 8.0, "#e5f2dd"),
    "experiments": (0.0, ("estimators", "vision"), 16.6, "#eee3f3"),
}
"""Layout of each package in the drawing: left edge, packages below it, width, colour. Lower packages come first."""
HEIGHT, GAP, BETWEEN = 0.5, 0.36, 0.85


def draw(path: Path) -> None:
    """Draw packages as frames with their sub-packages in layers, and an arrow for each import within a package."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13, 10), layout="constrained")
    axes = figure.subplots()
    axes.axis("off")
    places: dict[str, tuple[float, float]] = {}
    tops: dict[str, float] = {}
    lows: dict[str, float] = {}
    for package, (left, below, broad, colour) in FRAMES.items():
        layers = layers_of(package)
        low = lows[package] = max((tops[other] + BETWEEN for other in below), default=0.2)
        tops[package] = low + len(layers) * (HEIGHT + GAP) + 0.15
        _box(axes, (left, low - 0.25), (broad, tops[package] - low + 0.35), colour)
        axes.text(left + 0.1, tops[package] + 0.06, package, fontsize=13, weight="bold", va="top")
        # a layer with one sub-package is not centred, so that arrows between layers do not cover each other
        alone = [k for k, layer in enumerate(layers) if len(layer) == 1]
        for k, layer in enumerate(layers):
            y = low + (len(layers) - 1 - k) * (HEIGHT + GAP) + HEIGHT / 2
            for j, name in enumerate(layer):
                x = left + broad * (j + 0.5) / len(layer)
                if k in alone and len(alone) > 1:
                    x = left + broad * (0.25 + 0.5 * alone.index(k) / (len(alone) - 1))
                places[f"{package}.{name}"] = (x, y)
    boxes = {}
    for name, (x, y) in places.items():
        boxes[name] = _box(axes, (x - 0.7, y - HEIGHT / 2), (1.4, HEIGHT), "white")
        axes.text(x, y, name.split(".")[1], ha="center", va="center", fontsize=10.5, zorder=4)
    for package in PACKAGES:
        for room in rooms_of(package):
            for other in sorted(room.imports & set(places)):
                if other.startswith(f"{package}."):
                    ends = {"patchA": boxes[room.name], "patchB": boxes[other]}
                    _arrow(axes, places[room.name], places[other], color="0.4", linewidth=1.0, **ends)
    for over, under in (("experiments", "estimators"), ("experiments", "vision"), ("estimators", "dynamics")):
        x = FRAMES[under][0] + FRAMES[under][2] / 2
        _arrow(axes, (x, lows[over] - 0.2), (x, tops[under] + 0.1), color="#b04a3a", linewidth=3.0)
    axes.set_xlim(-0.3, 16.9)
    axes.set_ylim(-0.3, tops["experiments"] + 0.4)
    figure.savefig(path, dpi=110)


def _box(axes: Axes, corner: tuple[float, float], size: tuple[float, float], colour: str) -> Patch:
    from matplotlib.patches import FancyBboxPatch

    zorder = 3 if colour == "white" else 1
    box = FancyBboxPatch(corner, *size, boxstyle="round,pad=0.04", facecolor=colour, edgecolor="0.4", zorder=zorder)
    axes.add_patch(box)
    return box


def _arrow(axes: Axes, start: tuple[float, float], end: tuple[float, float], **style: Any) -> None:
    from matplotlib.patches import FancyArrowPatch

    scale = 8.0 + 5.0 * style["linewidth"]
    style |= {"arrowstyle": "-|>", "mutation_scale": scale, "shrinkA": 0, "shrinkB": 0, "zorder": 2}
    axes.add_patch(FancyArrowPatch(start, end, **style))


def main() -> None:
    """Rewrite the page and its drawing; with --check, only compare the page with the code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--check", action="store_true")
    if parser.parse_args().check:
        if page() != PAGE.read_text(encoding="utf-8"):
            sys.exit(f"{PAGE.name}: expected the rooms and imports of the code; rewrite it: make architecture-page")
        return
    write_whole(PAGE, page())
    draw(DRAWING)


if __name__ == "__main__":
    main()
