"""Faults of the marks, of the tissue, of its scene, of a tracked needle, and of the filter itself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

import vision
from dynamics import MassSpringNetwork, NeedlePose
from estimators import Insertion, TissueFilter
from experiments.arrays import Floats
from experiments.formats.scene.scene import Scene
from experiments.pipeline.live.session import Session
from experiments.studies.faults.judge import FOREVER, HIDDEN_S, LASTS_S
from experiments.studies.faults.scripted import Moves, ScriptedFault, TrackedNeedle

OUTSIDE_M = 0.02
"""Distance from the tip of a waiting needle to its entry [m]."""
GOES_IN_S = 0.5
"""Time before the onset at which the needle enters after GO [s]."""
INSIDE_M = 0.005
"""Depth at which the inserted needle stops [m]."""
BEND_RAD = np.deg2rad(90.0)
"""Angle by which the needle bends [rad]: it would miss by 25 mm, twice the lesion's radius, in any breath."""
BESIDE_M = 0.025
"""Distance of a needle's line from the line on which it would get GO [m]."""
DENT_M, DENT_N = 0.005, 2.0
"""Depth by which a needle dents the skin without puncture [m], and its force [N]."""
THROWN_M = 0.08
"""Displacement of all nodes in the filter's state on each axis [m]."""


def _displaced(by: Callable[[float], tuple[float, float]]) -> Moves:
    """A fault that displaces the first measured mark [m], as a function of the time since the onset [s]."""

    def moves(places: Floats, since_s: float, scene: Scene) -> Floats:
        moved = places.copy()
        moved[scene.network.index(scene.measured_nodes[0])] += by(since_s)
        return moved

    return moves


def _exchanged(places: Floats, _since_s: float, scene: Scene) -> Floats:
    """Positions in which two marks are exchanged."""
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
    """The scene with nodes drawn 30 mm farther apart than they are."""
    network = scene.network
    middle = network.positions.mean(axis=0)
    drawn = middle + 1.3 * (network.positions - middle)
    return replace(scene, network=replace(network, positions=drawn, rest_lengths=1.3 * network.rest_lengths))


def _at(plan: Insertion, depth_m: float, beside_m: float = 0.0, turned_rad: float = 0.0) -> NeedlePose:
    """A needle at rest at this depth [m], shifted sideways [m], with its direction rotated about its tip [rad]."""
    along = plan.axis
    across = np.array([-along[1], along[0]])
    direction = np.cos(turned_rad) * along + np.sin(turned_rad) * across
    return NeedlePose(plan.entry + beside_m * across + depth_m * along, direction, 0.0, max(depth_m, 0.0))


def _bends(since_s: float, plan: Insertion) -> NeedlePose:
    """Pose of a needle that waits outside, enters before the onset, bends, and is retracted."""
    if since_s < -GOES_IN_S or since_s >= LASTS_S:
        return _at(plan, -OUTSIDE_M)
    if since_s < 0.0:
        return _at(plan, INSIDE_M * (1.0 + since_s / GOES_IN_S))
    return _at(plan, INSIDE_M, turned_rad=BEND_RAD)


def _touches(since_s: float, plan: Insertion) -> NeedlePose:
    """Pose of a needle that presses on the skin beside its line, without GO, and is then retracted and aligned."""
    if since_s < 0.0:
        return _at(plan, -OUTSIDE_M, BESIDE_M)
    return _at(plan, DENT_M, BESIDE_M) if since_s < LASTS_S else _at(plan, -OUTSIDE_M)


def _thrown(by_m: float) -> Callable[[Session], None]:
    """A function that displaces all nodes by by_m [m] in the mean of each filter mode; covariances do not change."""

    def upsets(session: Session) -> None:
        tissue = session.line.filter
        assert isinstance(tissue, TissueFilter)
        tissue.filter.means[:, tissue.process.parts["position"]] += by_m

    return upsets


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

LOOP: tuple[ScriptedFault, ...] = (
    ScriptedFault("needle bent", "after GO the needle bends by 90 degrees inside", needle=TrackedNeedle(_bends)),
    ScriptedFault(
        "needle unseen",
        "the needle bends, and its tracker loses it or sends NaN",
        needle=TrackedNeedle(_bends, seen=lambda since_s: not 0.0 <= since_s < LASTS_S),
    ),
    ScriptedFault(
        "touched early",
        "without GO a needle presses 5 mm into the skin",
        needle=TrackedNeedle(_touches, push_N=DENT_N),
    ),
    ScriptedFault("filter diverges", "the filter's nodes are displaced by 110 mm", FOREVER, upsets=_thrown(THROWN_M)),
    ScriptedFault("filter NaN", "the filter's state is NaN", FOREVER, upsets=_thrown(np.nan)),
)
