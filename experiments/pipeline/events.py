"""Events of a run, reported on standard error, a line each."""

from __future__ import annotations

from typing import Literal

import numpy as np

from dynamics import rest_shape
from estimators import FilterSettings, IdentitySwap
from experiments.arrays import Floats
from experiments.formats.scene.scene import Scene, network_digest
from experiments.log import LOG
from vision import Source

CONSTANTS = ("simulate", "identify")
"""Steps after which the constants are those of the tissue: its truth was made with them, or they were found."""

SAGS = 1e-3
"""Share of the network's size by which it has to rest elsewhere than drawn to be told of: a drawing is no finer."""


def report_event(time_s: float, kind: str, text: str) -> None:
    """Report an event: its time [s], its kind and a text."""
    LOG.warning("%.2f s: %s: %s", time_s, kind, text)


def rest_offsets(scene: Scene) -> Floats:
    """By how much each node of the network rests elsewhere than it is drawn [m], (n_nodes,)."""
    network = scene.network
    return np.asarray(np.linalg.norm(rest_shape(network) - network.positions, axis=1))


def report_rest(scene: Scene) -> bool:
    """Report whether the network rests elsewhere than it is drawn: its target is then expected elsewhere, too."""
    network, offsets = scene.network, rest_offsets(scene)
    if offsets.max() <= SAGS * np.ptp(network.positions, axis=0).max():
        return False
    node, target = network.names[int(offsets.argmax())], network.index(scene.target.node)
    LOG.warning(
        "scene: the network rests up to %.1f mm from where it is drawn (node %s; the target's %.1f mm). "
        "If it was drawn at rest: softaim identify RECORDING --at-rest",
        1e3 * offsets.max(),
        node,
        1e3 * offsets[target],
    )
    return True


Command = Literal["simulate", "identify", "tune", "track"]
"""What the steps come before: simulation, identification, tuning, and all that estimates."""


def report_steps(scene: Scene, before: Command) -> tuple[str, ...]:
    """Report which steps were not done on a scene before this one, and what that means, a line each; their names."""
    left_out = ["at-rest"] if report_rest(scene) else []
    if before == "simulate":
        return tuple(left_out)
    if scene.target.node in scene.measured_nodes:
        LOG.warning(
            "scene: the target %s has a measured mark: its estimate follows that mark, and nothing is hidden; "
            "measured = false keeps the mark for scoring",
            scene.target.node,
        )
    if before == "identify":
        return tuple(left_out)
    edited = bool(scene.steps) and scene.steps[-1].network != network_digest(scene)
    found = any(step.name in CONSTANTS for step in scene.steps) and not edited
    if not found and scene.uncertainty is None:
        after = f" since softaim {scene.steps[-1].name} the network was changed:" if edited else ""
        LOG.warning(
            "constants were not identified (softaim identify):%s they are taken as exact, so that no covariance has "
            "their errors",
            after,
        )
        left_out.append("identify")
    if before == "track" and (why := _untuned(scene)) is not None:
        LOG.warning("settings were %s: covariances may be too large, probabilities too low", why)
        left_out.append("tune")
    return tuple(left_out)


def _untuned(scene: Scene) -> str | None:
    """In what way the noise levels are not those of the tissue; None where they were found or stated."""
    usual, names = FilterSettings(), [step.name for step in scene.steps]
    if (scene.settings.quiet, scene.settings.poked) == (usual.quiet, usual.poked):
        return "not tuned (softaim tune)"
    if "tune" in names and "identify" in names[names.index("tune") :]:
        return "tuned before softaim identify, for other constants (softaim tune)"
    return None


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
