"""For all tests: examples of property-based ones, and the order in which workers take tests.

Property-based tests draw the same examples in every run, so that a red run is a changed line.
"""

from pathlib import Path

import pytest
from hypothesis import settings

settings.register_profile("softaim", derandomize=True, deadline=None)
settings.load_profile("softaim")

VISION = Path(__file__).parent / "vision"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the tests of vision at the start of the second half, where the second of two workers begins.

    Its kernels are others than those of dynamics and estimators, so that in a fresh clone neither worker compiles what
    the other is compiling.
    """
    vision = [item for item in items if item.path.is_relative_to(VISION)]
    others = [item for item in items if not item.path.is_relative_to(VISION)]
    half = len(items) // 2
    items[:] = [*others[:half], *vision, *others[half:]]
