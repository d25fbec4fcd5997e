"""What happened during a run, a line each on standard error."""

from __future__ import annotations

import sys

from estimators import IdentitySwap
from vision import Source


def tell(time_s: float, kind: str, text: str) -> None:
    """Say what kind of event came at this time [s], over a line that renews itself where there is one."""
    clear = "\r\x1b[K" if sys.stderr.isatty() else ""
    print(f"{clear}softaim: {time_s:.2f} s: {kind}: {text}", file=sys.stderr, flush=True)


def tell_swap(swap: IdentitySwap) -> None:
    """Say which marks had been taken for each other."""
    *first, last = swap.nodes
    tell(
        swap.time_s,
        "swap",
        f"{', '.join(first)} and {last} were taken for each other since {swap.since_s:.2f} s; undone",
    )


def tell_events(frames: Source) -> None:
    """What happened to the source, a line each, on standard error."""
    for event in frames.take_events():
        tell(event.time_s, event.kind, event.text)
