"""Events of a run, reported on standard error, a line each."""

from __future__ import annotations

import sys

import numpy as np

from dynamics import rest_shape
from estimators import IdentitySwap
from experiments.arrays import Floats
from experiments.formats.scene.scene import Scene
from vision import Source

SAGS = 1e-3
"""Share of the network's size by which it has to rest elsewhere than drawn to be told of: a drawing is no finer."""


def report_event(time_s: float, kind: str, text: str) -> None:
    """Report an event: its time [s], its kind and a text; replaces a status line on the terminal."""
    clear = "\r\x1b[K" if sys.stderr.isatty() else ""
    print(f"{clear}softaim: {time_s:.2f} s: {kind}: {text}", file=sys.stderr, flush=True)


def rest_offsets(scene: Scene) -> Floats:
    """By how much each node of the network rests elsewhere than it is drawn [m], (n_nodes,)."""
    network = scene.network
    return np.asarray(np.linalg.norm(rest_shape(network) - network.positions, axis=1))


def report_rest(scene: Scene) -> None:
    """Report where the network does not rest where it is drawn: its target is then expected elsewhere than drawn."""
    network, offsets = scene.network, rest_offsets(scene)
    if offsets.max() <= SAGS * np.ptp(network.positions, axis=0).max():
        return
    node, target = network.names[int(offsets.argmax())], network.index(scene.target.node)
    print(
        f"softaim: scene: the network rests up to {1e3 * offsets.max():.1f} mm from where it is drawn (node {node}; "
        f"the target's {1e3 * offsets[target]:.1f} mm). If it was drawn at rest: softaim identify RECORDING --at-rest",
        file=sys.stderr,
        flush=True,
    )


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
