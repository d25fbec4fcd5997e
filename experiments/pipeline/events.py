"""Events of a run, reported on standard error, a line each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from dynamics import rest_shape
from estimators import CameraMove, FilterSettings, IdentitySwap
from experiments.arrays import Floats
from experiments.formats.scene.scene import Scene, network_digest
from experiments.log import LOG
from vision import Distractor, SourceOf

DISTRACTOR = "distractor"

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


def rest_is_known(scene: Scene) -> bool:
    """Whether rest lengths were found from the tissue at rest, and the network was not changed by hand since."""
    return any(step.name == "at-rest" for step in scene.steps) and not _edited(scene)


def _edited(scene: Scene) -> bool:
    return bool(scene.steps) and scene.steps[-1].network != network_digest(scene)


def rest_line(scene: Scene) -> str | None:
    """Where the network rests elsewhere than it is drawn: its target is then expected elsewhere, too; None if it does.

    Of a network drawn at rest the rest lengths are then those of the drawing, in which gravity does not pull. None,
    too, where they were found since: then other constants may move the rest.
    """
    if rest_is_known(scene):
        return None
    network, offsets = scene.network, rest_offsets(scene)
    if offsets.max() <= SAGS * np.ptp(network.positions, axis=0).max():
        return None
    node, target = network.names[int(offsets.argmax())], network.index(scene.target.node)
    return (
        f"scene: the network rests up to {1e3 * offsets.max():.1f} mm from where it is drawn (node {node}; "
        f"the target's {1e3 * offsets[target]:.1f} mm). If it was drawn at rest: softaim identify RECORDING --at-rest"
    )


def scene_line(scene: Scene) -> str:
    """What is assumed: the network, its marks and target, how well constants are known, noise levels, steps done."""
    network, usual = scene.network, FilterSettings()
    known = "exact" if scene.uncertainty is None else f"uncertain in {len(scene.uncertainty.directions)} directions"
    own = (scene.settings.poked, scene.settings.discrepancy) != (usual.poked, usual.discrepancy)
    return (
        f"scene: {len(network.free)} free nodes and {len(network.springs)} springs in {network.dim} dimensions, "
        f"marks measured on {', '.join(scene.measured_nodes)}, target {scene.target.node}; constants {known}; "
        f"levels {'its own' if own else 'the usual'}; done: {', '.join(s.name for s in scene.steps) or 'nothing'}"
    )


Command = Literal["simulate", "identify", "tune", "track", "insert"]
"""What the steps come before: simulation, identification, tuning, and all that estimates."""


def steps_left_out(scene: Scene, before: Command) -> dict[str, str]:
    """Steps that were not done on a scene before this one, and what else limits what it tells: a line each, by name."""
    lines = {"at-rest": rest_line(scene)}
    if before != "simulate" and scene.target.node in scene.measured_nodes:
        lines["hidden target"] = (
            f"scene: the target {scene.target.node} has a measured mark: its estimate follows that mark, nothing is "
            "hidden; measured = false keeps the mark for scoring"
        )
    if before in ("tune", "track"):
        lines["identify"] = _unidentified(scene)
    if before == "track":
        lines["tune"] = _untuned(scene)
    return {name: line for name, line in lines.items() if line is not None}


def is_identified(scene: Scene) -> bool:
    """Whether the constants are those of the tissue: found from it, or of the truth."""
    return any(step.name in CONSTANTS for step in scene.steps) and not _edited(scene)


def _unidentified(scene: Scene) -> str | None:
    """Why the constants are not those of the tissue; None where they were found, or are stated with uncertainty."""
    if scene.uncertainty is not None or is_identified(scene):
        return None
    found = any(step.name in CONSTANTS for step in scene.steps)
    since = f" since the network was changed after softaim {scene.steps[-1].name}" if found else ""
    return f"constants were not identified{since} (softaim identify): no covariance has their errors"


def _untuned(scene: Scene) -> str | None:
    """Why the noise levels are not those of the tissue; None where they were found or stated."""
    usual, names = FilterSettings(), [step.name for step in scene.steps]
    own = scene.settings
    if (own.poked, own.discrepancy) == (usual.poked, usual.discrepancy):
        why = "not tuned"
    elif "tune" in names and "identify" in names[names.index("tune") :]:
        why = "tuned before softaim identify, for other constants"
    else:
        return None
    return f"settings were {why} (softaim tune): covariances may be too large, probabilities too low"


def report_swap(swap: IdentitySwap) -> None:
    """Report which marks had exchanged identities."""
    *first, last = swap.nodes
    report_event(
        swap.time_s,
        "swap",
        f"{', '.join(first)} and {last} were taken for each other since {swap.since_s:.2f} s; undone",
    )


def pose_line(scene: Scene) -> str | None:
    """That nothing shows a move of the camera or tracker; None where reference marks do."""
    return None if scene.reference.marks else "a moved camera or tracker cannot be noticed: no reference marks"


def report_move(moved: CameraMove) -> None:
    """Report that the camera or tracker was moved, or has drifted."""
    report_event(moved.time_s, "camera", move_line(moved))


def move_line(moved: CameraMove) -> str:
    """By how much the camera or tracker has moved, and that it is corrected."""
    distance_mm, angle_deg = 1e3 * moved.distance_m, np.degrees(moved.angle_rad)
    return f"moved by {distance_mm:.1f} mm, {angle_deg:.1f} deg: corrected by reference marks"


def distractor_line(came: Distractor) -> str:
    """What came into the picture, and what to do about it."""
    u, v = (round(float(x)) for x in came.center_px)
    size = "a mark's size" if came.size < 1.5 else f"{came.size:.0f} marks' size"
    return (
        f"something of the colour of {came.like}'s mark and of {size} came at ({u}, {v}) px: wipe it off or cover it "
        "before it reaches that mark, or use marks of another hue"
    )


def report_distractors(time_s: float, came: Sequence[Distractor]) -> None:
    """Report what came into the picture at this time [s]."""
    for one in came:
        report_event(time_s, DISTRACTOR, distractor_line(one))


def report_source_events(frames: SourceOf[object]) -> None:
    """Report the events of a source that were not yet taken."""
    for event in frames.take_events():
        report_event(event.time_s - frames.origin_s, event.kind, event.text)
