"""For all tests: examples of property-based ones, the workers' order, what is left to collect, and Ctrl-C.

Property-based tests draw the same examples in every run, so that a red run is a changed line.
"""

import gc
import os
import signal
from pathlib import Path

import pytest
from hypothesis import settings

settings.register_profile("softaim", derandomize=True, deadline=None)
settings.load_profile("softaim")

HERE = Path(__file__).parent
KERNELS = "baselines/test_registry.py", "guidance/test_advice.py", "core/test_ahead.py"
FIRST = tuple(HERE / "estimators" / name for name in KERNELS)
"""Files that call nearly all kernels of dynamics and estimators."""
SECOND = (HERE / "vision", HERE / "experiments/formats", HERE / "experiments/servers")
"""Where nearly all kernels that are called are those of vision."""
LONGEST = (HERE / "experiments/studies/faults/test_system.py", HERE / "experiments/pipeline/test_identify.py")
"""Files of half a minute and more."""


def pytest_configure() -> None:
    """Hear Ctrl-C, too, where a shell runs the tests in the background: it starts those with it ignored.

    Passes of the garbage collector come seldom: with Python's usual threshold they take one second of thirteen.
    """
    gc.set_threshold(50_000, 20, 20)
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


class LastFirst(pytest.Dir):
    """A folder whose tests are collected from the last to the first."""

    def collect(self) -> list[pytest.Item | pytest.Collector]:
        return [*super().collect()][::-1]


def pytest_collect_directory(path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    """The second worker imports a folder's last module first: in a fresh clone, each compiles half of them."""
    return LastFirst.from_parent(parent, path=path) if os.environ.get("PYTEST_XDIST_WORKER") == "gw1" else None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put tests of vision, then the longest, at the start of the second half, where the second of two workers begins.

    The kernels of vision are others than those of dynamics and estimators, with which the first worker begins, so that
    in a fresh clone neither worker compiles what the other is compiling: that takes minutes. What takes longest is
    neither left for the end, where the other worker would wait for it, nor split between two that make its fixtures
    twice.
    """
    items.sort(key=lambda item: item.path)  # both workers need the same order
    first, second = within(items, FIRST), within(items, (*SECOND, *LONGEST))
    placed = {*first, *second}
    others = [item for item in items if item not in placed]
    half = len(items) // 2 - len(first)
    items[:] = [*first, *others[:half], *second, *others[half:]]


def within(items: list[pytest.Item], places: tuple[Path, ...]) -> list[pytest.Item]:
    """The tests in these files and folders, place by place."""
    at = [(item, f"{item.path}/") for item in items]
    return [item for place in places for item, path in at if path.startswith(f"{place}/")]


def pytest_collection_finish() -> None:
    """Keep what imports and collection made out of the garbage collector's passes: it stays until the end anyway."""
    gc.collect()
    gc.freeze()
