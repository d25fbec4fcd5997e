"""The faults that a script can make: of the source, of the picture, of the marks, of the tissue and of the scene."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np

import vision
from dynamics import MassSpringNetwork
from experiments.arrays import Floats
from experiments.formats.scene.scene import Scene
from experiments.studies.faults.world import BEGAN_S, Arrival
from vision.arrays import Image

ONSET_S = 4.0
"""When a fault begins, from the first exposure on [s]: the breath is learnt by then."""
LASTS_S = 2.0
FRAME_S = 0.2
"""Within this, or three frames if that is longer, a fault that a frame shows has to be noticed [s]: asked for."""
HIDDEN_S = 2.0
"""Within this a fault that no single frame can show has to be noticed, or the covariance to cover it [s]: asked for."""

Alters = Callable[[Image, float, np.random.Generator], Image]
Moves = Callable[[Floats, float, Scene], Floats]


def _same_picture(image: Image, _since_s: float, _rng: np.random.Generator) -> Image:
    return image


def _same_places(places: Floats, _since_s: float, _scene: Scene) -> Floats:
    return places


def _same_arrivals(arrivals: list[Arrival], _rng: np.random.Generator) -> list[Arrival]:
    return arrivals


def _same_network(network: MassSpringNetwork) -> MassSpringNetwork:
    return network


def _same_scene(scene: Scene) -> Scene:
    return scene


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault, and how it is made.

    name: as the table has it; what: in a few words; lasts_s: from ONSET_S on [s], inf for one that stays
    within_s: when it has to be noticed, at the latest, or covered [s]
    picture: what becomes of a picture, since_s [s] after its onset; covered: nodes whose marks are hidden
    places: where the picture shows the nodes [m]; arrivals: what the reads give
    becomes: what becomes of the true network at the onset; believed: the scene that the filter is given
    """

    name: str
    what: str
    lasts_s: float = LASTS_S
    within_s: float = FRAME_S
    picture: Alters = _same_picture
    covered: tuple[str, ...] = ()
    places: Moves = _same_places
    arrivals: Callable[[list[Arrival], np.random.Generator], list[Arrival]] = _same_arrivals
    becomes: Callable[[MassSpringNetwork], MassSpringNetwork] = _same_network
    believed: Callable[[Scene], Scene] = _same_scene

    @property
    def ends_s(self) -> float:
        """When it is over, from the first exposure on [s]."""
        return ONSET_S + self.lasts_s

    def acts(self, time_s: float) -> bool:
        """Whether it acts at this time from the first exposure on [s]."""
        return ONSET_S <= time_s < self.ends_s


def _within(arrival: Arrival, lasts_s: float = LASTS_S) -> bool:
    return ONSET_S <= arrival.at_s - BEGAN_S < ONSET_S + lasts_s


def _unplugged(arrivals: list[Arrival], _rng: np.random.Generator) -> list[Arrival]:
    return [replace(one, image=None) if _within(one) else one for one in arrivals]


def _blocked(arrivals: list[Arrival], _rng: np.random.Generator) -> list[Arrival]:
    return [one for one in arrivals if not _within(one)]


def _frozen(arrivals: list[Arrival], n_pictures: int) -> list[Arrival]:
    before = [one.image for one in arrivals if one.at_s - BEGAN_S < ONSET_S][-n_pictures:]
    turns = iter(range(len(arrivals)))
    return [replace(one, image=before[next(turns) % n_pictures]) if _within(one) else one for one in arrivals]


def _dropped(arrivals: list[Arrival], rng: np.random.Generator) -> list[Arrival]:
    return [one for one in arrivals if not _within(one) or rng.random() > 0.5]


def _late(arrivals: list[Arrival], rng: np.random.Generator) -> list[Arrival]:
    at_s = np.array([one.at_s + (rng.exponential(0.05) if _within(one) else 0.0) for one in arrivals])
    in_order = np.maximum.accumulate(at_s)
    return [replace(one, at_s=float(at)) for one, at in zip(arrivals, in_order, strict=True)]


def _lag(arrivals: list[Arrival], _rng: np.random.Generator) -> list[Arrival]:
    return [replace(one, at_s=one.at_s + 1.0) if one.at_s - BEGAN_S >= ONSET_S else one for one in arrivals]


def _resized(image: Image, _since_s: float, _rng: np.random.Generator) -> Image:
    return np.asarray(cv2.resize(image, (320, 240)), dtype=np.uint8)


def _bgra(image: Image, _since_s: float, _rng: np.random.Generator) -> Image:
    return np.dstack([image, np.full(image.shape[:2], 255, np.uint8)])


def _sixteen_bit(image: Image, _since_s: float, _rng: np.random.Generator) -> Image:
    return image.astype(np.uint16) * 257  # type: ignore[return-value]


def _black(image: Image, _since_s: float, rng: np.random.Generator) -> Image:
    return rng.integers(0, 4, image.shape, dtype=np.uint8)


def _overexposed(image: Image, _since_s: float, rng: np.random.Generator) -> Image:
    return rng.integers(250, 256, image.shape, dtype=np.uint8)


def _dimmed(image: Image, _since_s: float, rng: np.random.Generator) -> Image:
    return np.clip(0.35 * image + rng.normal(0.0, 1.2, image.shape), 0, 255).astype(np.uint8)


def _shifted_hue(image: Image, _since_s: float, _rng: np.random.Generator) -> Image:
    hsv = cv2.cvtColor(image, cv2.COLOR_BGR2HSV)
    hsv[..., 0] = (hsv[..., 0].astype(np.int16) + 15) % 180
    return np.asarray(cv2.cvtColor(hsv, cv2.COLOR_HSV2BGR), dtype=np.uint8)


def _bleeding(image: Image, since_s: float, _rng: np.random.Generator) -> Image:
    """Blood that runs over the picture beside the marks, as red as the red one."""
    height, width = image.shape[:2]
    stained = image.copy()
    reach = int(height * min(0.2 + 0.2 * since_s, 0.6))
    cv2.ellipse(stained, (int(0.42 * width), int(0.35 * height)), (18, reach), 12.0, 0.0, 360.0, (24, 20, 190), -1)
    return stained


def _slides(places: Floats, since_s: float, scene: Scene) -> Floats:
    """The first measured mark slides on the skin, 6 mm/s, down to 12 mm."""
    moved = places.copy()
    moved[scene.network.index(scene.measured_nodes[0])] += [0.0, -min(6e-3 * since_s, 12e-3)]
    return moved


def _elsewhere(places: Floats, since_s: float, scene: Scene) -> Floats:
    """The first measured mark falls off and is stuck on 12 mm beside after a second."""
    moved = places.copy()
    away = [1.0, 0.0] if since_s < 1.0 else [12e-3, 0.0]
    moved[scene.network.index(scene.measured_nodes[0])] += away
    return moved


def _exchanged(places: Floats, _since_s: float, scene: Scene) -> Floats:
    """Two marks are taken off and stuck on in each other's place."""
    one, other = (scene.network.index(node) for node in scene.measured_nodes[:2])
    moved = places.copy()
    moved[[one, other]] = places[[other, one]]
    return moved


def _falls(places: Floats, since_s: float, scene: Scene) -> Floats:
    """The first measured mark falls to the ground."""
    moved = places.copy()
    moved[scene.network.index(scene.measured_nodes[0])] += [0.0, -0.5 * 9.81 * since_s**2]
    return moved


def _cut(network: MassSpringNetwork) -> MassSpringNetwork:
    """The first spring is as good as cut."""
    stiffness, damping = network.stiffness.copy(), network.damping.copy()
    stiffness[0], damping[0] = 1e-3 * stiffness[0], 0.0
    return replace(network, stiffness=stiffness, damping=damping)


def _slipped(network: MassSpringNetwork) -> MassSpringNetwork:
    """The first anchor is 8 mm lower."""
    positions = network.positions.copy()
    positions[np.flatnonzero(network.fixed)[0]] += [0.0, -8e-3]
    return replace(network, positions=positions)


def _stiffer(scene: Scene) -> Scene:
    return replace(scene, network=replace(scene.network, stiffness=1.3 * scene.network.stiffness))


def _scaled(scene: Scene) -> Scene:
    """Five in a hundred more millimetres a pixel than there are."""
    camera = scene.cameras[0]
    low, high = scene.network.positions.min(axis=0), scene.network.positions.max(axis=0)
    middle = 0.5 * (low + high)
    mm_per_px = tuple(1.05 * float(x) for x in camera.mm_per_px(middle))
    seen = vision.fronto_parallel_camera(
        camera.name, camera.size_px, (mm_per_px[0], mm_per_px[1]), (float(middle[0]), float(middle[1]))
    )
    return replace(scene, cameras=(seen,))


def _another(scene: Scene) -> Scene:
    """A scene whose nodes are drawn 30 mm from one another farther than they are."""
    network = scene.network
    middle = network.positions.mean(axis=0)
    drawn = middle + 1.3 * (network.positions - middle)
    return replace(scene, network=replace(network, positions=drawn, rest_lengths=1.3 * network.rest_lengths))


FOREVER = np.inf

FAULTS: tuple[Fault, ...] = (
    Fault("none", "nothing fails", 0.0),
    Fault("unplugged", "the camera is unplugged for 2 s", arrivals=_unplugged),
    Fault("blocked", "reads do not come back for 2 s", arrivals=_blocked),
    Fault("frozen", "the same picture for 2 s", arrivals=lambda arrivals, _rng: _frozen(arrivals, 1)),
    Fault("frozen in turn", "two pictures in turn for 2 s", arrivals=lambda arrivals, _rng: _frozen(arrivals, 2)),
    Fault("dropped frames", "every other frame is lost for 2 s", arrivals=_dropped),
    Fault("late frames", "frames come 50 ms late on average, in bursts, for 2 s", arrivals=_late),
    Fault("lag", "from now on all frames come 1 s late", FOREVER, arrivals=_lag),
    Fault("black", "black pictures for 2 s", picture=_black),
    Fault("overexposed", "white pictures for 2 s", picture=_overexposed),
    Fault("another size", "pictures of 320 x 240 for 2 s", picture=_resized),
    Fault("BGRA", "pictures of four channels for 2 s", picture=_bgra),
    Fault("16 bit", "pictures of 16 bit for 2 s", picture=_sixteen_bit),
    Fault("dimmed", "the lamp gives a third of its light from now on", FOREVER, picture=_dimmed),
    Fault("hue shifted", "all hues turn by 30 degrees from now on", FOREVER, picture=_shifted_hue),
    Fault("blood", "blood as red as a mark runs over the picture", FOREVER, picture=_bleeding),
    Fault("half covered", "half the marks are covered for 2 s", covered=("M1", "M3")),
    Fault("all covered", "all marks are covered for 5 s", 5.0, covered=("M1", "M2", "M3", "M4")),
    Fault("swapped", "two marks are exchanged", FOREVER, places=_exchanged),
    Fault("fallen off", "a mark falls off", FOREVER, places=_falls),
    Fault("sliding", "a mark slides by 12 mm in 2 s", FOREVER, HIDDEN_S, places=_slides),
    Fault("stuck on elsewhere", "a mark falls off and is stuck on 12 mm beside", FOREVER, HIDDEN_S, places=_elsewhere),
    Fault("cut spring", "a spring is cut", FOREVER, HIDDEN_S, becomes=_cut),
    Fault("slipped anchor", "an anchor slips by 8 mm", FOREVER, HIDDEN_S, becomes=_slipped),
    Fault("stiffness", "the scene's springs are 30 % too stiff", FOREVER, HIDDEN_S, believed=_stiffer),
    Fault("scale", "the scene's camera has 5 % more mm a pixel", FOREVER, HIDDEN_S, believed=_scaled),
    Fault("wrong scene", "the scene is of a body 30 % larger", FOREVER, HIDDEN_S, believed=_another),
)


def fault_of(name: str) -> Fault:
    """The fault of this name; KeyError where there is none."""
    return {fault.name: fault for fault in FAULTS}[name]
