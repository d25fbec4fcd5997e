"""One thread for linear algebra while a filter is at work: of matrices so small more threads only wait for each other.

A program sets OPENBLAS_NUM_THREADS before NumPy is loaded; of whom uses the library NumPy and SciPy are loaded already.
Their wheels bring OpenBLAS, which is asked here; another library's threads are its user's to set.
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
    """One thread until the end, then as many as before."""
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
    """What sets the number of threads of each OpenBLAS that NumPy and SciPy brought, and what tells it."""
    found = []
    for package in (numpy, scipy):
        home = Path(package.__path__[0])
        folders = home.parent / f"{package.__name__}.libs", home / ".dylibs"
        for path in (one for folder in folders for one in folder.glob("*openblas*")):
            for ending in ("64_", ""):
                with suppress(OSError, AttributeError):  # of other builds, which have other names
                    library = ctypes.CDLL(str(path))
                    put = getattr(library, f"scipy_openblas_set_num_threads{ending}")
                    found.append((put, getattr(library, f"scipy_openblas_get_num_threads{ending}")))
    return tuple(found)
