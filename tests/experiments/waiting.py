"""Waiting for another thread or process, as short as it takes; a fault is a failure, not a hang."""

import time
from collections.abc import Callable

SOON_S = 60.0
"""For what comes at once; a busy machine takes long."""


def until(holds: Callable[[], object], within_s: float = SOON_S) -> None:
    """Wait for a condition."""
    end = time.monotonic() + within_s
    while not holds():
        assert time.monotonic() < end, "the condition did not come to hold"
        time.sleep(0.005)
