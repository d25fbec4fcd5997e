"""One run of a study: function, job, outcome and key."""

from __future__ import annotations

import hashlib
import importlib.util
import json
import sys
import time
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

Case = Mapping[str, Any]
"""The seed and the parameters of a run, in JSON types."""

Work = Callable[[Any], Any]
"""The function that does a run: a function of a module, or a `functools.partial` of such a function. Keyword arguments
of the partial must not change results."""

PACKAGES = ("dynamics", "estimators", "vision", "experiments")

KEY_DIGITS = 16
"""Number of hexadecimal digits of a key; with 64 bits, two of a million runs share a key with probability 3e-8."""


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """The outcome of one job.

    index: index of the job; seconds: duration of the job [s]
    result: what the function returned; None after a failure
    failure: last line of the traceback; None after a success
    """

    index: int
    seconds: float
    result: Any = None
    failure: str | None = None
    trace: str = ""


def perform(work: Work, index: int, job: object) -> Run:
    """Run the function on one job; any exception except an interrupt becomes a failure."""
    began = time.perf_counter()
    try:
        result = work(job)
    except (Exception, SystemExit) as fault:
        seconds = time.perf_counter() - began
        return Run(index, seconds, failure=last_line(fault), trace="".join(traceback.format_exception(fault)))
    return Run(index, time.perf_counter() - began, result)


def last_line(fault: BaseException) -> str:
    """Kind and message of an exception, on one line."""
    return " ".join("".join(traceback.format_exception_only(fault)).split())


def importable(work: Work) -> Work:
    """The function `work`, imported by the name of its module and not from `__main__`, for use in other processes.

    Raises ValueError if other processes cannot import the function.
    """
    if isinstance(work, partial):
        if work.args:
            raise ValueError(f"{work}: expected keywords, found positional arguments")
        return partial(importable(work.func), **work.keywords)
    name, module = getattr(work, "__qualname__", ""), getattr(work, "__module__", "")
    if module == "__main__":
        spec = getattr(sys.modules["__main__"], "__spec__", None)
        module = "" if spec is None else spec.name
    if not name.isidentifier() or not module:
        raise ValueError(f"{work}: expected a function at the top level of an importable module")
    return named_work(f"{module}:{name}")


def name_of(work: Work) -> str:
    """`module:function` of an importable function."""
    return name_of(work.func) if isinstance(work, partial) else f"{work.__module__}:{work.__qualname__}"


def module_of(work: Work) -> str:
    """Name of a function's module; for a partial, of the function among its keywords, otherwise of the one it calls."""
    if isinstance(work, partial):
        inner = [value for value in work.keywords.values() if callable(value)]
        return module_of(inner[0] if inner else work.func)
    return work.__module__


def named_work(name: str) -> Work:
    """The function with the name `module:function`. Raises ImportError or AttributeError if there is none."""
    module, _, function = name.partition(":")
    found: Work = getattr(importlib.import_module(module), function)
    return found


@cache
def program() -> str:
    """Digest of the source of the packages in PACKAGES; it shows which program produced results."""
    digest = hashlib.sha256()
    for package in PACKAGES:
        spec = importlib.util.find_spec(package)
        for folder in (spec and spec.submodule_search_locations) or ():
            for path in sorted(Path(folder).rglob("*.py")):
                digest.update(path.read_bytes())
    return digest.hexdigest()[:KEY_DIGITS]


def key_of(work: Work, case: Case) -> str:
    """Key of a run: digest of `work`'s name and `case`. Raises TypeError if JSON cannot represent the case."""
    text = json.dumps([name_of(work), case], sort_keys=True, ensure_ascii=False)
    return hashlib.sha256(text.encode("utf-8")).hexdigest()[:KEY_DIGITS]
