"""For all tests: examples of property-based ones, the workers' order, what is left to collect, and Ctrl-C.

Property-based tests draw the same examples in every run, so that a red run is a changed line.
"""

import gc
import signal
from pathlib import Path

import pytest
from hypothesis import settings

settings.register_profile("softaim", derandomize=True, deadline=None)
settings.load_profile("softaim")

HERE = Path(__file__).parent
VISION = HERE / "vision"
LONGEST = (HERE / "experiments/studies/test_readme.py", HERE / "experiments/pipeline/test_identify.py")
"""Files of half a minute and more."""


def pytest_configure() -> None:
    """Hear Ctrl-C, too, where a shell runs the tests in the background: it starts those with it ignored."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put tests of vision, then the longest, at the start of the second half, where the second of two workers begins.

    The kernels of vision are others than those of dynamics and estimators, so that in a fresh clone neither worker
    compiles what the other is compiling. What takes longest is neither left for the end, where the other worker would
    wait for it, nor split between two that make its fixtures twice.
    """
    vision = [item for item in items if item.path.is_relative_to(VISION)]
    longest = [item for path in LONGEST for item in items if item.path == path]
    others = [item for item in items if not item.path.is_relative_to(VISION) and item.path not in LONGEST]
    half = len(items) // 2
    items[:] = [*others[:half], *vision, *longest, *others[half:]]


def pytest_collection_finish() -> None:
    """Keep what imports and collection made out of the garbage collector's passes: it stays until the end anyway."""
    gc.collect()
    gc.freeze()
