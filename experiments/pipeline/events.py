"""Events of a run, reported on standard error, a line each."""

from __future__ import annotations

import sys

from estimators import IdentitySwap
from vision import Source


def report_event(time_s: float, kind: str, text: str) -> None:
    """Report an event: its time [s], its kind and a text; replaces a status line on the terminal."""
    clear = "\r\x1b[K" if sys.stderr.isatty() else ""
    print(f"{clear}softaim: {time_s:.2f} s: {kind}: {text}", file=sys.stderr, flush=True)


def report_swap(swap: IdentitySwap) -> None:
    """Report which marks had exchanged identities."""
    *first, last = swap.nodes
    report_event(
        swap.time_s,
        "swap",
        f"{', '.join(first)} and {last} were taken for each other since {swap.since_s:.2f} s; undone",
    )


def report_source_events(frames: Source) -> None:
    """Report the events of a source that were not yet taken."""
    for event in frames.take_events():
        report_event(event.time_s, event.kind, event.text)
