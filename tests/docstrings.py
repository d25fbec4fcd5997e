"""Faults of the docstrings of public names: what `softaim`, `dynamics`, `estimators` and `vision` name in `__all__`.

Each fault has a line: no docstring, no shapes or units of arrays, a name in backticks that does not exist.
"""

from __future__ import annotations

import ast
import builtins
import importlib
import inspect
import keyword
import re
from collections.abc import Iterator
from functools import cache
from itertools import pairwise
from pathlib import Path
from pkgutil import resolve_name
from typing import Any, NamedTuple

PACKAGES = ("softaim", "dynamics", "estimators", "vision")
ROOT = Path(__file__).parents[1]

ARRAYS = re.compile(r"Floats|ArrayLike|NDArray|Image\b|ndarray")
SHAPE = re.compile(r"\((?:n|k|m|d|r|dim|\.\.\.|(?:\.\.\.|[\w ]+),[\w .,]*|columns \* rows, 3)\)")
UNIT = re.compile(r"\[[^\]]+\]")
OF_ANY_UNIT = ("estimators.filters", "estimators.consistency", "vision")
"""Rooms whose arrays have whatever unit they are given, or the one that their names end in: _px, _m."""

FILES = (".toml", ".csv", ".md", ".json", ".yaml")

NAMED = re.compile(r"(?<!`)`([A-Za-z_][\w.]*)(?:\(\))?`(?!`)")


class Public(NamedTuple):
    """A public name: its place, such as `estimators.TissueFilter.predict`, its docstring, where it is defined."""

    place: str
    thing: Any
    text: str
    module: str
    owner: type | None = None


def public_names() -> Iterator[Public]:
    """All public names and the public members of public classes, each once."""
    seen: set[int] = set()
    for package in PACKAGES:
        module = importlib.import_module(package)
        for name in module.__all__:
            thing = getattr(module, name)
            if not (inspect.isclass(thing) or inspect.isfunction(thing)):
                yield Public(f"{package}.{name}", thing, *constant_text(package, name))
                continue
            if id(thing) in seen:
                continue
            seen.add(id(thing))
            owner = thing if inspect.isclass(thing) else None
            yield Public(f"{package}.{name}", thing, thing.__doc__ or "", thing.__module__, owner)
            yield from _members(f"{package}.{name}", thing)


def _members(place: str, owner: Any) -> Iterator[Public]:
    for name, member in vars(owner).items() if inspect.isclass(owner) else ():
        function = member.fget if isinstance(member, property) else getattr(member, "__func__", member)
        if not name.startswith("_") and inspect.isfunction(function):
            inherited = inspect.getdoc(member) or ""
            yield Public(f"{place}.{name}", function, function.__doc__ or inherited, owner.__module__, owner)


@cache
def _constants(source: Path) -> dict[str, str]:
    """Docstrings of a module's constants: the texts that follow them."""
    body = ast.parse(source.read_text(encoding="utf-8")).body
    found: dict[str, str] = {}
    for before, after in pairwise(body):
        targets = before.targets if isinstance(before, ast.Assign) else [getattr(before, "target", None)]
        if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant) and isinstance(after.value.value, str):
            found |= {target.id: after.value.value for target in targets if isinstance(target, ast.Name)}
    return found


def constant_text(package: str, name: str) -> tuple[str, str]:
    """The docstring of a constant and the module of its package that defines it; empty where there is no docstring."""
    if name == "__version__":
        return "Version of the program that is installed.", package
    for file in sorted((ROOT / package).rglob("*.py")):
        if name in _constants(file):
            return _constants(file)[name], ".".join(file.relative_to(ROOT).with_suffix("").parts)
    return "", package


def faults() -> list[str]:
    """A line for each fault of a docstring."""
    found = []
    for one in public_names():
        if not one.text.strip():
            found.append(f"{one.place}: expected a docstring, found none")
            continue
        found += [f"{one.place}: {what}" for what in _unstated(one)]
        found += [f"{one.place}: `{name}`: no such name" for name in NAMED.findall(one.text) if not _known(name, one)]
    return found


def _unstated(one: Public) -> list[str]:
    """What a docstring does not state of the arrays that go in and out."""
    annotations = dict(getattr(one.thing, "__annotations__", {}))
    if inspect.isclass(one.thing):
        annotations |= getattr(vars(one.thing).get("__init__"), "__annotations__", {})
    arrays = [name for name, kind in annotations.items() if ARRAYS.search(str(kind)) and not name.startswith("_")]
    if not arrays:
        return []
    named = ", ".join(arrays)
    context = one.text + (one.owner.__doc__ or "" if one.owner is not None else "")
    unstated = [] if SHAPE.search(one.text) else [f"expected shapes of {named}, as (n, dim), found none"]
    physical = any("bool" not in str(annotations[name]) and "int" not in str(annotations[name]) for name in arrays)
    if physical and not UNIT.search(context) and not one.module.startswith(OF_ANY_UNIT):
        unstated.append(f"expected units of {named}, as [m], found none")
    return unstated


def _known(name: str, one: Public) -> bool:
    """Whether a name in backticks is one that a reader can look up from where it is named."""
    first, *rest = name.split(".")
    if Path(name).suffix in FILES:
        return True
    if rest and (ROOT / first).exists():
        return _resolves(name)
    return _beside(first, one) or _imported(name, one.module) or (not rest and _written(first, one.module))


def _beside(name: str, one: Public) -> bool:
    """Whether it is a member of the class, a parameter of the function, or Python's own."""
    if one.owner is not None and (name in dir(one.owner) or f"self.{name}" in inspect.getsource(one.owner)):
        return True
    if hasattr(builtins, name) or keyword.iskeyword(name):
        return True
    return callable(one.thing) and name in inspect.signature(one.thing).parameters


def _imported(name: str, module: str) -> bool:
    """Whether it is public, or a name of the module in which it is named."""
    first, *rest = name.split(".")
    for place in map(importlib.import_module, (module, *PACKAGES)):
        if hasattr(place, first):
            thing = getattr(place, first)
            return not rest or hasattr(thing, rest[0]) or rest[0] in getattr(thing, "__annotations__", {})
    return False


def _resolves(dotted: str) -> bool:
    try:
        resolve_name(dotted)
    except (ImportError, AttributeError):
        return False
    return True


@cache
def _source(package: str) -> str:
    return "".join(path.read_text(encoding="utf-8") for path in (ROOT / package).rglob("*.py"))


def _written(word: str, module: str) -> bool:
    """Whether it is a word that the program writes: a key of a count, a column, a subcommand."""
    return any(f'"{word}"' in _source(package) for package in (module.partition(".")[0], "experiments"))
