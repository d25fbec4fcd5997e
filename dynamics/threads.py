"""Linear algebra in one thread while a filter runs or a mesh is reduced: for small matrices, more threads only wait.

OPENBLAS_NUM_THREADS has no effect after NumPy is loaded. The number of threads is therefore set in the loaded OpenBLAS
libraries of NumPy's and SciPy's wheels. Other libraries are not changed.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

import numpy
import scipy


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Use one thread inside the `with` block, and restore the previous number after it."""
    before = [(put, get()) for put, get in _libraries()]
    for put, n in before:
        if n != 1:
            put(1)
    try:
        yield
    finally:
        for put, n in before:
            if n != 1:
                put(n)


@cache
def _libraries() -> tuple[tuple[Callable[[int], object], Callable[[], int]], ...]:
    """Setter and getter of the number of threads, for each OpenBLAS library of NumPy and SciPy.

    The calls keep the interpreter's lock. If they released it, other Python threads might delay their return.
    """
    found = []
    for package in (numpy, scipy):
        home = Path(package.__path__[0])
        folders = home.parent / f"{package.__name__}.libs", home / ".dylibs"
        for path in (one for folder in folders for one in folder.glob("*openblas*")):
            for ending in ("64_", ""):
                with suppress(OSError, AttributeError):  # other builds have other names
                    library = ctypes.PyDLL(str(path))
                    put = getattr(library, f"scipy_openblas_set_num_threads{ending}")
                    found.append((put, getattr(library, f"scipy_openblas_get_num_threads{ending}")))
    return tuple(found)
