"""Simulated faults: of the camera, marks, tissue and scene file, of a tracked needle, and of the filter's state."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import cycle
from typing import cast

import cv2
import numpy as np

import vision
from dynamics import MassSpringNetwork, NeedlePose
from estimators import Insertion, TissueFilter
from experiments.arrays import Floats
from experiments.formats.scene.scene import Scene
from experiments.pipeline.live.session import Session
from experiments.studies.faults.judge import FOREVER, HIDDEN_S, LASTS_S, ONSET_S
from experiments.studies.faults.scripted import Alters, Arrives, Moves, ScriptedFault, TrackedNeedle
from experiments.studies.faults.world import BEGAN_S, INTERVAL_S, Arrival
from vision.arrays import Image

DEVICE_S = 3.0
"""Time on the camera's own clock at the first exposure [s]."""


def _within(arrival: Arrival, lasts_s: float) -> bool:
    return ONSET_S <= arrival.at_s - BEGAN_S < ONSET_S + lasts_s


def _each(change: Callable[[Arrival], Arrival]) -> Arrives:
    """A fault that changes each `Arrival`."""
    return lambda arrivals, _rng, lasts_s: [change(one) if _within(one, lasts_s) else one for one in arrivals]


_lag = _each(lambda one: replace(one, at_s=one.at_s + 1.0))


def _kept(keeps: Callable[[int, np.random.Generator], bool]) -> Arrives:
    """A fault that drops `Arrival`s; keeps: function that returns whether arrival k after the onset remains."""

    def arrives(arrivals: list[Arrival], rng: np.random.Generator, lasts_s: float) -> list[Arrival]:
        first = sum(one.at_s - BEGAN_S < ONSET_S for one in arrivals)
        return [one for k, one in enumerate(arrivals) if not _within(one, lasts_s) or keeps(k - first, rng)]

    return arrives


_blocked = _kept(lambda _k, _rng: False)


def _frozen(n_pictures: int) -> Arrives:
    """A fault that repeats the last `n_pictures` pictures before the onset, again and again in the same order."""

    def arrives(arrivals: list[Arrival], rng: np.random.Generator, lasts_s: float) -> list[Arrival]:
        turns = cycle([one.image for one in arrivals if one.at_s - BEGAN_S < ONSET_S][-n_pictures:])
        return _each(lambda one: replace(one, image=next(turns)))(arrivals, rng, lasts_s)

    return arrives


def _late(arrivals: list[Arrival], rng: np.random.Generator, lasts_s: float) -> list[Arrival]:
    at_s = np.array([one.at_s + (rng.exponential(0.05) if _within(one, lasts_s) else 0.0) for one in arrivals])
    in_order = np.maximum.accumulate(at_s)
    return [replace(one, at_s=float(at)) for one, at in zip(arrivals, in_order, strict=True)]


def _dated(fault_s: float, arrives: Arrives = lambda arrivals, _rng, _lasts_s: arrivals) -> Arrives:
    """A fault of a camera that states exposure times. During the fault, these times are wrong by fault_s [s]."""
    return lambda arrivals, rng, lasts_s: arrives(
        [
            replace(one, stated_s=DEVICE_S + k * INTERVAL_S + (fault_s if _within(one, lasts_s) else 0.0))
            for k, one in enumerate(arrivals)
        ],
        rng,
        lasts_s,
    )


def _noise(low: int, high: int) -> Alters:
    """A fault that replaces all pixels by random integers; smallest: `low`; largest: `high` - 1."""
    return lambda image, _since_s, rng: rng.integers(low, high, image.shape, dtype=np.uint8)


def _shifted_hue(image: Image, _since_s: float, _rng: np.random.Generator) -> Image:
    hsv = cv2.cvtColor(image, cv2.COLOR_BGR2HSV)
    hsv[..., 0] = (hsv[..., 0].astype(np.int16) + 15) % 180
    return np.asarray(cv2.cvtColor(hsv, cv2.COLOR_HSV2BGR), dtype=np.uint8)


def _dimmed(image: Image, _since_s: float, rng: np.random.Generator) -> Image:
    return np.clip(0.35 * image + rng.normal(0.0, 1.2, image.shape), 0, 255).astype(np.uint8)


def _bleeding(image: Image, since_s: float, _rng: np.random.Generator) -> Image:
    """The picture with a growing stain of blood beside the marks, as red as the red mark."""
    height, width = image.shape[:2]
    stained = image.copy()
    reach = int(height * min(0.2 + 0.2 * since_s, 0.6))
    cv2.ellipse(stained, (int(0.42 * width), int(0.35 * height)), (18, reach), 12.0, 0.0, 360.0, (24, 20, 190), -1)
    return stained


_PICTURES: tuple[tuple[str, str, float, Alters], ...] = (
    ("black", "black pictures for 2 s", LASTS_S, _noise(0, 4)),
    ("overexposed", "white pictures for 2 s", LASTS_S, _noise(250, 256)),
    (
        "another size",
        "pictures have 320 x 240 px for 2 s",
        LASTS_S,
        lambda image, _since_s, _rng: np.asarray(cv2.resize(image, (320, 240)), dtype=np.uint8),
    ),
    (
        "BGRA",
        "pictures have four channels for 2 s",
        LASTS_S,
        lambda image, _since_s, _rng: np.dstack([image, np.full(image.shape[:2], 255, np.uint8)]),
    ),
    (
        "16 bit",
        "pixels have 16 bits for 2 s",
        LASTS_S,
        lambda image, _since_s, _rng: cast(Image, image.astype(np.uint16) * 257),
    ),
    ("dimmed", "the lamp dims to a third", FOREVER, _dimmed),
    ("hue shifted", "all hues shift by 30 degrees", FOREVER, _shifted_hue),
    ("blood", "blood as red as a mark runs over the picture", FOREVER, _bleeding),
)

CAMERA: tuple[ScriptedFault, ...] = (
    ScriptedFault("unplugged", "the camera is unplugged for 2 s", arrivals=_each(lambda one: replace(one, image=None))),
    ScriptedFault("blocked", "reads block for 2 s", arrivals=_blocked),
    ScriptedFault("frozen", "one picture repeats for 2 s", arrivals=_frozen(1)),
    ScriptedFault("frozen in turn", "two pictures alternate for 2 s", arrivals=_frozen(2)),
    ScriptedFault("dropped frames", "every other frame is lost for 2 s", arrivals=_kept(lambda k, _rng: bool(k % 2))),
    ScriptedFault(
        "dropped at random",
        "a random half of the frames is lost for 2 s",
        within_s=HIDDEN_S,
        arrivals=_kept(lambda _k, rng: rng.random() > 0.5),
    ),
    ScriptedFault("late frames", "frames come 50 ms late on average, in bursts, for 2 s", arrivals=_late),
    ScriptedFault("lag", "all frames come 1 s late", FOREVER, arrivals=_lag),
    ScriptedFault("blocked, dated", "reads of timestamped frames block for 2 s", arrivals=_dated(0.0, _blocked)),
    ScriptedFault("lag, dated", "all timestamped frames come 1 s late", FOREVER, arrivals=_dated(0.0, _lag)),
    *(ScriptedFault(name, what, lasts_s, picture=alters) for name, what, lasts_s, alters in _PICTURES),
    ScriptedFault("clock ahead", "the camera's clock jumps ahead by 10 s", FOREVER, arrivals=_dated(10.0)),
    ScriptedFault("clock back", "the camera's clock jumps back by 10 s", FOREVER, arrivals=_dated(-10.0)),
    ScriptedFault("NaN times", "the camera's times are NaN", FOREVER, arrivals=_dated(np.nan)),
    ScriptedFault(
        "NaN pictures",
        "all pixels are NaN for 2 s",
        picture=lambda image, _since_s, _rng: np.full(image.shape, np.nan, dtype=np.float32),
    ),
)


def _displaced(by: Callable[[float], tuple[float, float]]) -> Moves:
    """A fault that displaces the first measured mark; by: displacement [m] as function of the time since the onset."""

    def moves(places: Floats, since_s: float, scene: Scene) -> Floats:
        moved = places.copy()
        moved[scene.network.index(scene.measured_nodes[0])] += by(since_s)
        return moved

    return moves


def _exchanged(places: Floats, _since_s: float, scene: Scene) -> Floats:
    """The positions of all nodes after the first two marks have exchanged their places."""
    one, other = (scene.network.index(node) for node in scene.measured_nodes[:2])
    moved = places.copy()
    moved[[one, other]] = places[[other, one]]
    return moved


_slides = _displaced(lambda since_s: (0.0, -min(6e-3 * since_s, 12e-3)))
_elsewhere = _displaced(lambda since_s: (1.0 if since_s < 1.0 else 12e-3, 0.0))
_falls = _displaced(lambda since_s: (0.0, -0.5 * 9.81 * since_s**2))


def _cut(network: MassSpringNetwork) -> MassSpringNetwork:
    """The network after its first spring has lost 99.9 % of its stiffness and all damping."""
    stiffness, damping = network.stiffness.copy(), network.damping.copy()
    stiffness[0], damping[0] = 1e-3 * stiffness[0], 0.0
    return replace(network, stiffness=stiffness, damping=damping)


def _slipped(network: MassSpringNetwork) -> MassSpringNetwork:
    """The network with its first fixed node 8 mm lower."""
    positions = network.positions.copy()
    positions[np.flatnonzero(network.fixed)[0]] += [0.0, -8e-3]
    return replace(network, positions=positions)


def _stiffer(scene: Scene) -> Scene:
    return replace(scene, network=replace(scene.network, stiffness=1.3 * scene.network.stiffness))


def _scaled(scene: Scene) -> Scene:
    """The scene with a camera whose scale [mm/px] is five per cent too large."""
    camera = scene.cameras[0]
    x, y = middle = 0.5 * (scene.network.positions.min(axis=0) + scene.network.positions.max(axis=0))
    across, up = 1.05 * camera.mm_per_px(middle)
    seen = vision.fronto_parallel_camera(camera.name, camera.size_px, (float(across), float(up)), (float(x), float(y)))
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
    ScriptedFault("scale", "the scene's scale [mm/px] is 5 % too large", FOREVER, HIDDEN_S, assumed=_scaled),
    ScriptedFault("wrong scene", "the scene's body is 30 % too large", FOREVER, HIDDEN_S, assumed=_another),
)


OUTSIDE_M = 0.02
"""Distance from the tip of a waiting needle to its entry [m]."""
GOES_IN_S = 0.5
"""Time from the needle's entry to the onset [s]."""
INSIDE_M = 0.005
"""Depth at which the inserted needle stops [m]."""
BEND_RAD = np.deg2rad(90.0)
"""Angle by which the needle bends [rad]; the bent needle misses the target by 25 mm, twice the lesion's radius."""
BESIDE_M = 0.025
"""Distance between a needle's line and the planned line [m]; on the planned line, the advice would be GO."""
DENT_M, DENT_N = 0.005, 2.0
"""For a needle that dents the skin without a puncture: depth of the dent [m], and the needle's force [N]."""
THROWN_M = 0.08
"""Displacement of all nodes in the filter's state on each axis [m]."""


def _at(plan: Insertion, depth_m: float, beside_m: float = 0.0, turned_rad: float = 0.0) -> NeedlePose:
    """Pose of a needle at rest: depth of its tip, distance from the planned line, and rotation about its tip."""
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
    """Pose of a needle that dents the skin beside the planned line. After the fault, it waits on the planned line."""
    if since_s < 0.0:
        return _at(plan, -OUTSIDE_M, BESIDE_M)
    return _at(plan, DENT_M, BESIDE_M) if since_s < LASTS_S else _at(plan, -OUTSIDE_M)


def _thrown(by_m: float) -> Callable[[Session], None]:
    """A function that adds by_m to all node positions in the filter's means [m]; the covariances do not change."""

    def upsets(session: Session) -> None:
        tissue = session.line.filter
        assert isinstance(tissue, TissueFilter)
        tissue.filter.means[:, tissue.process.parts["position"]] += by_m

    return upsets


LOOP: tuple[ScriptedFault, ...] = (
    ScriptedFault("needle bent", "after GO, the needle enters and bends by 90 degrees", needle=TrackedNeedle(_bends)),
    ScriptedFault(
        "needle unseen",
        "the needle bends, and its tracker loses it or sends NaN",
        needle=TrackedNeedle(_bends, seen=lambda since_s: not 0.0 <= since_s < LASTS_S),
    ),
    ScriptedFault(
        "touched early", "a needle presses 5 mm into the skin without GO", needle=TrackedNeedle(_touches, push_N=DENT_N)
    ),
    ScriptedFault("filter diverges", "the filter's nodes are displaced by 110 mm", FOREVER, upsets=_thrown(THROWN_M)),
    ScriptedFault("filter NaN", "the filter's state is NaN", FOREVER, upsets=_thrown(np.nan)),
)
