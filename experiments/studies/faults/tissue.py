"""Faults of the marks, the tissue and the scene."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

import vision
from dynamics import MassSpringNetwork
from experiments.arrays import Floats
from experiments.formats.scene.scene import Scene
from experiments.studies.faults.judge import FOREVER, HIDDEN_S
from experiments.studies.faults.scripted import Moves, ScriptedFault


def _displaced(by: Callable[[float], tuple[float, float]]) -> Moves:
    """A fault that displaces the first measured mark; `by`: displacement [m] at a time since the onset [s]."""

    def moves(places: Floats, since_s: float, scene: Scene) -> Floats:
        moved = places.copy()
        moved[scene.network.index(scene.measured_nodes[0])] += by(since_s)
        return moved

    return moves


def _exchanged(places: Floats, _since_s: float, scene: Scene) -> Floats:
    """The positions after two marks have been exchanged."""
    one, other = (scene.network.index(node) for node in scene.measured_nodes[:2])
    moved = places.copy()
    moved[[one, other]] = places[[other, one]]
    return moved


_slides = _displaced(lambda since_s: (0.0, -min(6e-3 * since_s, 12e-3)))
_elsewhere = _displaced(lambda since_s: (1.0 if since_s < 1.0 else 12e-3, 0.0))
_falls = _displaced(lambda since_s: (0.0, -0.5 * 9.81 * since_s**2))


def _cut(network: MassSpringNetwork) -> MassSpringNetwork:
    """The network with its first spring practically cut."""
    stiffness, damping = network.stiffness.copy(), network.damping.copy()
    stiffness[0], damping[0] = 1e-3 * stiffness[0], 0.0
    return replace(network, stiffness=stiffness, damping=damping)


def _slipped(network: MassSpringNetwork) -> MassSpringNetwork:
    """The network with its first anchor 8 mm lower."""
    positions = network.positions.copy()
    positions[np.flatnonzero(network.fixed)[0]] += [0.0, -8e-3]
    return replace(network, positions=positions)


def _stiffer(scene: Scene) -> Scene:
    return replace(scene, network=replace(scene.network, stiffness=1.3 * scene.network.stiffness))


def _scaled(scene: Scene) -> Scene:
    """The scene with a camera whose scale [mm/px] is five per cent too large."""
    camera = scene.cameras[0]
    low, high = scene.network.positions.min(axis=0), scene.network.positions.max(axis=0)
    middle = 0.5 * (low + high)
    mm_per_px = tuple(1.05 * float(x) for x in camera.mm_per_px(middle))
    seen = vision.fronto_parallel_camera(
        camera.name, camera.size_px, (mm_per_px[0], mm_per_px[1]), (float(middle[0]), float(middle[1]))
    )
    return replace(scene, cameras=(seen,))


def _another(scene: Scene) -> Scene:
    """The scene with a body that is 30 % too large."""
    network = scene.network
    middle = network.positions.mean(axis=0)
    drawn = middle + 1.3 * (network.positions - middle)
    return replace(scene, network=replace(network, positions=drawn, rest_lengths=1.3 * network.rest_lengths))


TISSUE: tuple[ScriptedFault, ...] = (
    ScriptedFault("half covered", "half the marks are covered for 2 s", covered=("M1", "M3")),
    ScriptedFault("all covered", "all marks are covered for 5 s", 5.0, covered=("M1", "M2", "M3", "M4")),
    ScriptedFault("swapped", "two marks are exchanged", FOREVER, places=_exchanged),
    ScriptedFault("fallen off", "a mark falls off", FOREVER, places=_falls),
    ScriptedFault("sliding", "a mark slides by 12 mm in 2 s", FOREVER, HIDDEN_S, places=_slides),
    ScriptedFault(
        "stuck on elsewhere", "a mark falls off and is reattached 12 mm away", FOREVER, HIDDEN_S, places=_elsewhere
    ),
    ScriptedFault("cut spring", "a spring is cut", FOREVER, HIDDEN_S, becomes=_cut),
    ScriptedFault("slipped anchor", "an anchor slips by 8 mm", FOREVER, HIDDEN_S, becomes=_slipped),
    ScriptedFault("stiffness", "the scene's springs are 30 % too stiff", FOREVER, HIDDEN_S, assumed=_stiffer),
    ScriptedFault("scale", "the scene states 5 % more mm per pixel", FOREVER, HIDDEN_S, assumed=_scaled),
    ScriptedFault("wrong scene", "the scene's body is 30 % too large", FOREVER, HIDDEN_S, assumed=_another),
)
