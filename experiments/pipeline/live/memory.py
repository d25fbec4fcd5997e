"""Memory of this process, where the system tells it."""

from __future__ import annotations

import os
from pathlib import Path

STATM = Path("/proc/self/statm")


def memory_mb() -> float | None:
    """What is held in memory now [MB]; None where the system does not tell."""
    try:
        pages = int(STATM.read_text(encoding="ascii").split()[1])
        return pages * os.sysconf("SC_PAGE_SIZE") / 1e6
    except (OSError, AttributeError, ValueError, IndexError):
        return None
