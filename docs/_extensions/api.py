"""The API reference: a page for each sub-package, with its public names, their docstrings and links between them."""

import ast
import inspect
import re
import typing
from importlib import import_module
from pkgutil import iter_modules
from types import ModuleType, SimpleNamespace

import sphinx.util.inspect
from docutils import nodes
from fields import as_numpydoc, with_links
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.pycode import ModuleAnalyzer

import softaim

PACKAGES = ("dynamics", "estimators", "vision")


def pages() -> dict[str, dict[str, object]]:
    """Content of each page: the packages and their sub-packages, by the names from which users import."""
    found = {}
    for package in map(import_module, PACKAGES):
        parts = [f"{package.__name__}.{part.name}" for part in iter_modules(package.__path__) if part.ispkg]
        found[package.__name__] = {"about": first_paragraph(package.__doc__), "parts": parts}
        for part in map(import_module, parts):
            names = [f"{(package if name in package.__all__ else part).__name__}.{name}" for name in part.__all__]
            found[part.__name__] = page(part, names, names)
    names = [f"{place if place in PACKAGES else 'softaim'}.{name}" for name, place in softaim._HOMES.items()]
    found["softaim"] = page(softaim, names, [name for name in names if name.startswith("softaim.")])
    return found


def page(module: ModuleType, listed: list[str], documented: list[str]) -> dict[str, object]:
    """The first paragraph of a module, the names in its table, and the directives of those that it documents."""
    summaries = {name: summary(name) for name in listed}
    directives = {name: directive(value(name)) for name in documented}
    return {"about": first_paragraph(module.__doc__), "names": summaries, "directives": directives}


def value(name: str) -> object:
    """The object that a dotted name refers to."""
    module, _, short = name.rpartition(".")
    return getattr(import_module(module), short)


def first_paragraph(text: str | None) -> str:
    """The first paragraph of a docstring, as one line."""
    return " ".join((text or "").split("\n\n")[0].split())


def summary(name: str) -> str:
    """The first sentence of a docstring."""
    thing = value(name)
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
    """The module that defines a name which another module re-exports."""
    for node in ast.parse(inspect.getsource(import_module(module))).body:
        if isinstance(node, ast.ImportFrom) and node.module and name in {alias.name for alias in node.names}:
            return home(node.module, name)
    return module


def read(app: Sphinx, what: str, name: str, thing: object, options: object, lines: list[str]) -> None:
    """Put a docstring into the form of numpydoc, before numpydoc reads it."""
    text = constant(name) if what == "data" else as_numpydoc(lines, thing)
    lines[:] = map(with_links, text)


def public(app: Sphinx, env: BuildEnvironment, node: addnodes.pending_xref, shown: nodes.Node) -> nodes.Node | None:
    """A link to a public name of another package; public names are unique (`tests/test_public_names.py`)."""
    first, _, rest = node.get("reftarget", "").partition(".")
    places = env.config.autosummary_context["places"]
    if node.get("refdomain") != "py" or first not in places:
        return None
    place = ".".join((places[first], rest)) if rest else places[first]
    return env.domains["py"].resolve_xref(env, node["refdoc"], app.builder, "obj", place, node, shown)


def link_names(app: Sphinx, document: nodes.document, page: str) -> None:
    """Link names of classes, methods and functions in the text of a page; a plain word may mean something else."""
    for literal in list(document.findall(nodes.literal)):
        name = literal.astext().removesuffix("()")
        if re.fullmatch(r"\w*[A-Z_]\w*(\.\w+)?", name) and not isinstance(literal.parent, nodes.reference):
            target = addnodes.pending_xref(refdomain="py", reftarget=name, refdoc=page)
            literal.replace_self(public(app, app.env, target, literal.deepcopy()) or literal)


def trim(app: Sphinx, document: nodes.document, page: str) -> None:
    """Remove the empty last line of an example, which only pytest needs."""
    for block in document.findall(nodes.literal_block):
        if block.rawsource == block.astext():
            block.rawsource = block.rawsource.rstrip()
            block[:] = [nodes.Text(block.rawsource)]


def as_written(*_: object) -> dict[str, object]:
    """Refuse to evaluate annotations, so that Sphinx writes them as in the code."""
    raise TypeError


def skip(app: Sphinx, what: str, name: str, thing: object, skipped: bool, options: object) -> bool | None:
    """Skip the fields of a NamedTuple, whose generated docstrings say nothing."""
    return True if str(getattr(thing, "__doc__", "")).startswith("Alias for field number") else None


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the contents of the pages and the hooks."""
    found = pages()
    places = {name.rpartition(".")[2]: name for one in found.values() for name in one.get("directives", {})}
    app.config.autosummary_context = {"pages": found, "places": places}
    # Evaluated, ArrayLike would take three lines; Sphinx has no setting for this
    sphinx.util.inspect.typing = SimpleNamespace(**{**vars(typing), "get_type_hints": as_written})
    app.connect("autodoc-process-docstring", read, priority=400)
    app.connect("autodoc-skip-member", skip)
    app.connect("missing-reference", public)
    app.connect("doctree-resolved", link_names)
    app.connect("doctree-resolved", trim)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
