"""The API reference: a page for each room of the packages, and docstrings in the form that numpydoc reads."""

import ast
import inspect
import re
from importlib import import_module
from pkgutil import iter_modules

from sphinx.application import Sphinx
from sphinx.pycode import ModuleAnalyzer

import softaim

PACKAGES = ("dynamics", "estimators", "vision")
FIELD = re.compile(r"(Raises )?([A-Za-z_]\w*(?:, [a-z_]\w*)*): (.*)")
CITATION = re.compile(r"(?<![\w`])\[([a-z]+\d{4}[a-z]?)\](?!_)")


def rooms() -> dict[str, dict[str, object]]:
    """For each package its rooms, and for each room its title and the public names, each with its directive."""
    pages: dict[str, dict[str, object]] = {}
    for package in map(import_module, PACKAGES):
        inside = [f"{package.__name__}.{one.name}" for one in iter_modules(package.__path__) if one.ispkg]
        pages[package.__name__] = {"rooms": inside, "about": first_paragraph(package.__doc__)}
        for room in map(import_module, inside):
            names = {f"{(package if n in package.__all__ else room).__name__}.{n}": getattr(room, n) for n in room.__all__}
            pages[room.__name__] = {
                "names": {name: summary(name, thing) for name, thing in names.items()},
                "about": first_paragraph(room.__doc__),
                "directives": {name: directive(thing) for name, thing in names.items()},
            }
    own = {f"softaim.{name}": getattr(softaim, name) for name, home in softaim._HOMES.items() if home not in PACKAGES}
    listed = {f"{home}.{name}": getattr(softaim, name) for name, home in softaim._HOMES.items() if home in PACKAGES}
    pages["softaim"] = {
        "names": {name: summary(name, thing) for name, thing in (listed | own).items()},
        "about": first_paragraph(softaim.__doc__),
        "directives": {name: directive(thing) for name, thing in own.items()},
    }
    return pages


def first_paragraph(text: str | None) -> str:
    """The first paragraph of a docstring, as one line."""
    return " ".join((text or "").split("\n\n")[0].split())


def summary(name: str, thing: object) -> str:
    """The first sentence of a docstring."""
    text = first_paragraph("\n".join(constant(name)) if directive(thing) == "autodata" else thing.__doc__)
    return re.split(r"(?<=[.:;]) ", text, maxsplit=1)[0].rstrip(":;")


def directive(thing: object) -> str:
    """The directive of autodoc that documents a thing."""
    if inspect.isclass(thing):
        return "autoexception" if issubclass(thing, Exception) else "autoclass"
    return "autofunction" if inspect.isroutine(thing) else "autodata"


def constant(name: str) -> list[str]:
    """The docstring of a constant: autodoc finds it only in the module that defines the constant."""
    module, _, short = name.rpartition(".")
    return ModuleAnalyzer.for_module(home(module, short)).find_attr_docs().get(("", short), [])


def home(module: str, name: str) -> str:
    """The module that defines a name which a module hands on."""
    for node in ast.parse(inspect.getsource(import_module(module))).body:
        if isinstance(node, ast.ImportFrom) and node.module and name in {alias.name for alias in node.names}:
            return home(node.module, name)
    return module


def types(thing: object) -> dict[str, str]:
    """Annotations of the parameters of a function, or of the fields of a class."""
    own = getattr(thing, "__init__", thing) if inspect.isclass(thing) else thing
    return {**getattr(own, "__annotations__", {}), **getattr(thing, "__annotations__", {})}


def as_numpydoc(lines: list[str], thing: object) -> list[str]:
    """A docstring whose fields, `name: text`, are the sections of numpydoc."""
    known = types(thing)
    text: list[str] = []
    fields: list[str] = []
    raised: list[str] = []
    into = text
    for line in lines:
        found = FIELD.match(line)
        names = found[2].split(", ") if found else []
        if found and found[1]:
            into = raised
            into += [found[2], f"    {found[3]}"]
        elif found and names != ["State"] and (set(names) <= set(known) or inspect.isclass(thing)):
            into = fields
            kind = known.get(names[0], "")
            into += [f"{found[2]} : `{kind}`" if isinstance(kind, str) and kind else found[2], f"    {found[3]}"]
        elif into is not text and line.startswith("    "):
            into.append(line)
        else:
            text += ["", line] if into is not text else [line]
            into = text
    for title, section in (("Parameters", fields), ("Raises", raised)):
        text += ["", title, "-" * len(title), *section] if section else []
    return text


def read(app: Sphinx, what: str, name: str, thing: object, options: object, lines: list[str]) -> None:
    """Put a docstring into the form of numpydoc, before numpydoc reads it."""
    lines[:] = constant(name) if what == "data" else as_numpydoc(lines, thing)
    lines[:] = [CITATION.sub(r"[\1]", line) for line in lines]


def skip(app: Sphinx, what: str, name: str, thing: object, skipped: bool, options: object) -> bool | None:
    """Leave out the fields of a NamedTuple, whose docstrings say nothing."""
    return True if str(getattr(thing, "__doc__", "")).startswith("Alias for field number") else None


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the contents of the pages and the hooks."""
    app.config.autosummary_context = {"pages": rooms()}
    app.connect("autodoc-process-docstring", read, priority=400)
    app.connect("autodoc-skip-member", skip)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
