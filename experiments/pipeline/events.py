"""Events of a run, reported on standard error, one line each."""

from __future__ import annotations

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
"""Steps that give a scene the tissue's constants: those of the simulation, or those identified from a recording."""

SAGS = 1e-3
"""There is a message if a node rests farther than this from its position in scene.toml; choice. The distance is divided
by the longest side of the network [1]."""


def report_event(time_s: float, kind: str, text: str) -> None:
    """Report an event: its time [s], its kind and a text."""
    LOG.warning("%.2f s: %s: %s", time_s, kind, text)


def rest_offsets(scene: Scene) -> Floats:
    """Distance of each node at rest from its position in scene.toml [m], (n_nodes,)."""
    network = scene.network
    return np.asarray(np.linalg.norm(rest_shape(network) - network.positions, axis=1))


def rest_is_known(scene: Scene) -> bool:
    """Whether rest lengths were identified from the tissue at rest, and the network has not been edited since then."""
    return any(step.step == "at-rest" for step in scene.steps) and not _edited(scene)


def _edited(scene: Scene) -> bool:
    return bool(scene.steps) and scene.steps[-1].network_sha256 != network_digest(scene)


def rest_line(scene: Scene) -> str | None:
    """A message if the network's shape at rest differs from its shape in scene.toml; otherwise None.

    If the rest lengths of the springs were identified, there is no message.
    """
    if rest_is_known(scene):
        return None
    network, offsets = scene.network, rest_offsets(scene)
    if offsets.max() <= SAGS * np.ptp(network.positions, axis=0).max():
        return None
    node, target = network.names[int(offsets.argmax())], network.index(scene.target.node)
    return (
        f"scene: the network rests up to {1e3 * offsets.max():.1f} mm from its drawing (node {node}; "
        f"target {1e3 * offsets[target]:.1f} mm). If it was drawn at rest: softaim identify RECORDING --at-rest"
    )


def scene_line(scene: Scene) -> str:
    """One line on a scene: network, marks, target, constants, noise levels, and the commands applied so far."""
    network, usual = scene.network, FilterSettings()
    known = "exact" if scene.uncertainty is None else f"uncertain in {len(scene.uncertainty.directions)} directions"
    solid = network.continuum
    held = f"{len(network.springs)} springs" if solid is None else f"a mesh in {len(solid.rates)} modes"
    own = (scene.settings.poked, scene.settings.discrepancy) != (usual.poked, usual.discrepancy)
    return (
        f"scene: {len(network.free)} free nodes and {held} in {network.dim} dimensions, "
        f"marks measured on {', '.join(scene.measured_nodes)}, target {scene.target.node}; constants {known}; "
        f"noise levels {'stated' if own else 'default'}; done: {', '.join(s.step for s in scene.steps) or 'nothing'}"
    )


Command = Literal["simulate", "identify", "tune", "track", "insert"]
"""Commands that require earlier steps."""


def steps_left_out(scene: Scene, before: Command) -> dict[str, str]:
    """Messages by step: one for each step that the command `before` requires and the scene lacks.

    There is also a message "hidden target" if the target has a measured mark, and a message "simulated truth" if the
    constants are those of a simulation.
    """
    lines = {"at-rest": rest_line(scene)}
    if before != "simulate":
        lines["simulated truth"] = _simulated(scene)
    if before != "simulate" and scene.target.node in scene.measured_nodes:
        lines["hidden target"] = (
            f"scene: the target {scene.target.node} is not hidden: it has a measured mark, which its estimate follows; "
            "measured = false keeps the mark for scoring"
        )
    if before in ("tune", "track"):
        lines["identify"] = _unidentified(scene)
    if before == "track":
        lines["tune"] = _untuned(scene)
    return {name: line for name, line in lines.items() if line is not None}


def is_identified(scene: Scene) -> bool:
    """Whether a scene's constants were identified from a recording, or are the true constants of a simulation."""
    return any(step.step in CONSTANTS for step in scene.steps) and not _edited(scene)


def _simulated(scene: Scene) -> str | None:
    """A message if the constants are the true constants of a simulation; otherwise None."""
    done = {step.step for step in scene.steps} & set(CONSTANTS)
    if done != {"simulate"} or _edited(scene):
        return None
    return (
        "scene: the constants are the simulated truth, so errors are smaller than with identified constants; "
        "--scene names another scene"
    )


def _unidentified(scene: Scene) -> str | None:
    """A message if the constants were not identified and have no stated uncertainty; otherwise None."""
    if scene.uncertainty is not None or is_identified(scene):
        return None
    found = any(step.step in CONSTANTS for step in scene.steps)
    since = f" since the network was changed after softaim {scene.steps[-1].step}" if found else ""
    return f"constants were not identified{since} (softaim identify): covariances do not include their errors"


def _untuned(scene: Scene) -> str | None:
    """A message if the noise levels are the defaults, or were tuned before `softaim identify`; otherwise None."""
    usual, names = FilterSettings(), [step.step for step in scene.steps]
    own = scene.settings
    if (own.poked, own.discrepancy) == (usual.poked, usual.discrepancy):
        why = "not tuned"
    elif "tune" in names and "identify" in names[names.index("tune") :]:
        why = "tuned before softaim identify, for other constants"
    else:
        return None
    return f"noise levels were {why} (softaim tune): covariances and probabilities may be wrong"


def report_swap(swap: IdentitySwap) -> None:
    """Report that two marks exchanged their names."""
    *first, last = swap.nodes
    report_event(
        swap.time_s,
        "swap",
        f"{', '.join(first)} and {last} had exchanged names since {swap.since_s:.2f} s; corrected",
    )


def pose_line(scene: Scene) -> str | None:
    """A message saying that a moved camera or tracker cannot be detected; None for a scene with reference marks."""
    return None if scene.reference.marks else "a move of the camera or tracker cannot be detected: no reference marks"


def report_move(moved: CameraMove, camera: str = "") -> None:
    """Report a move or drift of the camera or tracker; camera: name of the camera, if there are several."""
    text = (
        f"moved by {1e3 * moved.distance_m:.1f} mm, {np.degrees(moved.angle_rad):.1f} deg: corrected by reference marks"
    )
    report_event(moved.time_s, f"camera {camera}".rstrip(), text)


def distractor_line(came: Distractor) -> str:
    """The message on a distractor, an object with a mark's colour, and what to do about it."""
    u, v = (round(float(x)) for x in came.center_px)
    size = "a mark's size" if came.size < 1.5 else f"{came.size:.0f} marks' size"
    return (
        f"something in the colour of {came.like}'s mark, of {size}, appeared at ({u}, {v}) px: remove or cover it "
        "before it reaches that mark, or use marks of another hue"
    )


def report_source_events(frames: SourceOf[object], camera: str = "") -> None:
    """Report the pending events of a source; camera: name of its camera, if there are several."""
    for event in frames.take_events():
        text = f"camera {camera}: {event.text}" if camera else event.text
        report_event(event.time_s - frames.origin_s, event.kind, text)
