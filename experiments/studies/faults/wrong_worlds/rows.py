"""The wrong worlds: what differs from what the scene states, one row of the table each."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from dynamics import MassSpringNetwork, fit_rest_lengths, rest_shape
from dynamics.network.mass_spring import spring_lengths
from experiments.arrays import Floats
from experiments.formats.scene.scene import Scene
from experiments.formats.scene.schema import SceneFile, TargetTable
from experiments.studies.faults.judge import ONSET_S
from experiments.studies.faults.wrong_worlds.seen import MARK_SD_M, Seen, Sees
from experiments.studies.faults.wrong_worlds.truth import AS_STATED, Becomes, Pushes, Truth

WEIGHT = 9.81
"""Of a mass of 1 kg [N]."""


@dataclass(frozen=True, slots=True)
class World:
    """A row: what is true, and what is stated.

    onset_s: from when on it is wrong, and counted [s]
    truth: how the body differs from the scene; seen: what becomes of the frames of a tracker
    scene: the scene that is stated; target: keys of `[target]` that are stated, too
    sd_m: of the marks, as the tracker states it [m]; reference: reference marks on the anchors are stated, and seen
    """

    name: str
    onset_s: float = 0.0
    truth: Truth = AS_STATED
    seen: Sees = lambda seen, _rng: seen
    scene: Callable[[Scene], Scene] = lambda scene: scene
    target: Mapping[str, float] = field(default_factory=dict)
    sd_m: float = MARK_SD_M
    reference: bool = False

    @property
    def is_supported(self) -> bool:
        """Whether scene files have the keys that it states."""
        has_reference = "reference" in SceneFile.model_fields
        return self.target.keys() <= TargetTable.model_fields.keys() and (has_reference or not self.reference)


def _way(dim: int, rng: np.random.Generator) -> Floats:
    """A direction at random, (dim,)."""
    way = rng.normal(size=dim)
    return np.asarray(way / np.linalg.norm(way))


# what a tracker sees


def _frozen(seen: Seen, _rng: np.random.Generator) -> Seen:
    places, during = seen.places.copy(), np.flatnonzero(seen.since(lasts_s=2.0))
    places[during] = places[during[0] - 1]
    return replace(seen, places=places)


def _camera_drifts(seen: Seen, rng: np.random.Generator) -> Seen:
    way = _way(len(seen.middle), rng)
    return seen.moved(1e-3 * np.clip(seen.exposed_s - ONSET_S, 0.0, None)[:, None] * way)


def _camera_moved(seen: Seen, rng: np.random.Generator) -> Seen:
    return seen.moved(10e-3 * seen.since()[:, None] * _way(len(seen.middle), rng))


def _camera_turned(seen: Seen, rng: np.random.Generator) -> Seen:
    """About the middle of the picture, and in space about an axis at random."""
    angle, dim = np.deg2rad(2.0), len(seen.middle)
    axis = _way(3, rng) if dim == 3 else np.array([0.0, 0.0, 1.0])
    cross = np.cross(np.eye(3), axis)
    turn = (np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross)[:dim, :dim]
    turned = (seen.places - seen.middle) @ turn.T + seen.middle
    return replace(seen, places=np.where(seen.since()[:, None, None], turned, seen.places))


def _shaken(seen: Seen, rng: np.random.Generator) -> Seen:
    return seen.moved(8e-3 * seen.since(lasts_s=0.5)[:, None] * _way(len(seen.middle), rng))


def _of_one(seen: Seen, by: Floats, rng: np.random.Generator) -> Seen:
    """One mark displaced by so much in each frame [m], (n,), in a direction at random."""
    each = np.zeros_like(seen.places)
    each[:, rng.integers(len(seen.nodes))] = by[:, None] * _way(len(seen.middle), rng)
    return seen.moved(each)


def _slides(seen: Seen, rng: np.random.Generator) -> Seen:
    return _of_one(seen, np.clip(4e-3 * (seen.exposed_s - ONSET_S), 0.0, 8e-3), rng)


def _elsewhere(seen: Seen, rng: np.random.Generator) -> Seen:
    return _of_one(seen, np.where(seen.since(), 5e-3, 0.0), rng)


def _exchanged(seen: Seen, _rng: np.random.Generator) -> Seen:
    places, after = seen.places.copy(), seen.since()
    places[after, :2] = places[after, 1::-1]
    return replace(seen, places=places)


def _mirrored(seen: Seen, _rng: np.random.Generator) -> Seen:
    sides = np.where(np.arange(len(seen.middle)) == 1, -1.0, 1.0)
    return replace(seen, places=seen.middle + sides * (seen.places - seen.middle))


def _scaled(factor: float) -> Sees:
    return lambda seen, _rng: replace(seen, places=seen.middle + factor * (seen.places - seen.middle))


def _late(seen: Seen, _rng: np.random.Generator) -> Seen:
    return replace(seen, stated_s=seen.exposed_s + 0.1, arrive_s=seen.exposed_s + 0.1)


def _halved(seen: Seen, rng: np.random.Generator) -> Seen:
    kept = rng.random(len(seen.exposed_s)) < 0.5
    of_frames = {key: getattr(seen, key)[kept] for key in ("exposed_s", "stated_s", "arrive_s", "places", "shown")}
    return replace(seen, **of_frames)


def _fast(seen: Seen, _rng: np.random.Generator) -> Seen:
    return replace(seen, stated_s=1.02 * seen.exposed_s)


def _heavy(seen: Seen, rng: np.random.Generator) -> Seen:
    wild = rng.random(seen.places.shape[:2]) < 0.05
    ways = rng.normal(size=seen.places.shape)
    ways *= 10e-3 / np.linalg.norm(ways, axis=2, keepdims=True)
    return seen.moved(np.where(wild[..., None], ways, 0.0))


# what the tissue is


def _at_target(scene: Scene) -> Floats:
    """Which springs are at the target, (n_springs,), as booleans."""
    return np.asarray((scene.network.springs == scene.network.index(scene.target.node)).any(axis=1))


def _most_loaded(scene: Scene) -> int:
    """The spring at the target that bears most at rest."""
    network = scene.network
    lengths = spring_lengths(network.positions, network.springs)
    return int(np.argmax(np.abs(network.stiffness * (lengths - network.rest_lengths)) * _at_target(scene)))


def _rests_at(by_m: float) -> Truth:
    def moved(scene: Scene, rng: np.random.Generator) -> MassSpringNetwork:
        places = scene.network.positions.copy()
        places[scene.network.index(scene.target.node)] += by_m * _way(scene.network.dim, rng)
        return fit_rest_lengths(scene.network, places)

    return Truth(moved)


def _springs(
    factors: Callable[[Scene], Floats], damping: Callable[[Scene], Floats] = lambda _scene: np.ones(1)
) -> Truth:
    def changed(scene: Scene, _rng: np.random.Generator) -> MassSpringNetwork:
        network = scene.network
        stiffness, dashpots = network.stiffness * factors(scene), network.damping * damping(scene)
        return _at_rest(replace(network, stiffness=stiffness, damping=dashpots))

    return Truth(changed)


def _soft(share: float, *, one: bool) -> Truth:
    """The target's springs, or that which bears most, so much as stiff."""

    def factors(scene: Scene) -> Floats:
        chosen = np.arange(len(scene.network.springs)) == _most_loaded(scene) if one else _at_target(scene)
        return np.where(chosen, share, 1.0)

    return _springs(factors, factors)


def _loose(share: float) -> Truth:
    """The target's springs so much as stiff, each as loaded as before: it rests where it is drawn, and hangs loose."""

    def changed(scene: Scene, _rng: np.random.Generator) -> MassSpringNetwork:
        network, factors = scene.network, np.where(_at_target(scene), share, 1.0)
        lengths = spring_lengths(network.positions, network.springs)
        rest_lengths = lengths - (lengths - network.rest_lengths) / factors
        stiffness, damping = network.stiffness * factors, network.damping * factors
        return replace(network, stiffness=stiffness, damping=damping, rest_lengths=rest_lengths)

    return Truth(changed)


def _masses(factor: float, *, target: bool = False) -> Truth:
    def changed(scene: Scene, _rng: np.random.Generator) -> MassSpringNetwork:
        network, masses = scene.network, scene.network.masses.copy()
        masses[network.index(scene.target.node) if target else slice(None)] *= factor
        return _at_rest(replace(network, masses=masses))

    return Truth(changed)


def _at_rest(network: MassSpringNetwork) -> MassSpringNetwork:
    """The network drawn where it rests."""
    return replace(network, positions=rest_shape(network))


def _truly(change: Becomes) -> Truth:
    return Truth(lambda scene, _rng: change(scene.network))


def _dragged(network: MassSpringNetwork) -> MassSpringNetwork:
    """Ten times as much; where there is none, such that a free mass would stop in a tenth of a second."""
    without = np.where(network.fixed, 0.0, 10.0 * network.masses)
    return replace(network, drag=np.where(network.drag > 0.0, 10.0 * network.drag, without))


def _undragged(network: MassSpringNetwork) -> MassSpringNetwork:
    return replace(network, drag=np.zeros_like(network.drag))


def _rough(network: MassSpringNetwork) -> MassSpringNetwork:
    return replace(network, friction=np.where(network.fixed, 0.0, 0.05 * WEIGHT * network.masses))


def _slipped(network: MassSpringNetwork) -> MassSpringNetwork:
    positions = network.positions.copy()
    positions[np.flatnonzero(network.fixed)[0], 1] -= 5e-3
    return replace(network, positions=positions)


# what is stated


def _smooth(network: MassSpringNetwork) -> MassSpringNetwork:
    return replace(network, friction=np.zeros_like(network.friction))


def _stated(change: Becomes) -> Callable[[Scene], Scene]:
    return lambda scene: replace(scene, network=change(scene.network))


_MOVES = (
    World("the camera drifts by 1 mm/s", ONSET_S, seen=_camera_drifts),
    World("the camera is moved by 10 mm", ONSET_S, seen=_camera_moved),
    World("the camera is turned by 2 degrees", ONSET_S, seen=_camera_turned),
)

_PLACED = tuple(World(f"the target rests {mm} mm from where it is drawn", truth=_rests_at(1e-3 * mm)) for mm in (10, 3))

WORLDS: tuple[World, ...] = (
    World("nothing"),
    World("values freeze for 2 s, times go on", ONSET_S, seen=_frozen),
    *_MOVES,
    *(replace(one, name=f"{one.name}; reference marks on the anchors", reference=True) for one in _MOVES),
    World("all marks move by 8 mm for half a second", ONSET_S, seen=_shaken),
    *_PLACED,
    *(
        replace(one, name=f"{one.name}; so stated", target={"position_sd_mm": mm})
        for one, mm in zip(_PLACED, (10.0, 3.0), strict=True)
    ),
    World("the target's springs are a third as stiff", truth=_soft(1.0 / 3.0, one=False)),
    World("a spring of the target is a third as stiff", truth=_soft(1.0 / 3.0, one=True)),
    World("a spring of the target is missing", truth=_soft(1e-3, one=True)),
    World("the target hangs loose where it is drawn", truth=_loose(0.3)),
    World("the target's mass is three times as large", truth=_masses(3.0, target=True)),
    World("all springs are half as stiff", truth=_springs(lambda _scene: np.full(1, 0.5))),
    World("all springs are twice as stiff", truth=_springs(lambda _scene: np.full(1, 2.0))),
    World("all masses are half as large", truth=_masses(0.5)),
    World("all masses are twice as large", truth=_masses(2.0)),
    World("damping is five times as large", truth=_springs(lambda _scene: np.ones(1), lambda _scene: np.full(1, 5.0))),
    World("drag is ten times as large", truth=_truly(_dragged)),
    World("there is no drag", truth=_truly(_undragged)),
    World("dry friction of 5 % of the weight that nobody stated", truth=_truly(_rough), scene=_stated(_smooth)),
    World("gravity stated as 0", scene=_stated(lambda network: replace(network, gravity=0.0 * network.gravity))),
    World("gravity stated upside down", scene=_stated(lambda network: replace(network, gravity=-network.gravity))),
    World("masses stated in g", scene=_stated(lambda network: replace(network, masses=1e3 * network.masses))),
    World(
        "stiffness stated in N/mm", scene=_stated(lambda network: replace(network, stiffness=1e-3 * network.stiffness))
    ),
    World("the target is poked, too", truth=Truth(pushes=Pushes(hidden=True))),
    World("pokes of 15 m/s²", truth=Truth(pushes=Pushes(pokes_m_s2=15.0))),
    World("a second breath from aside", truth=Truth(pushes=Pushes(second=True))),
    World("an anchor slips by 5 mm", ONSET_S, truth=Truth(becomes=_slipped, onset_s=ONSET_S)),
    World("a mark slides by 8 mm in 2 s", ONSET_S, seen=_slides),
    World("a mark is stuck on 5 mm elsewhere", ONSET_S, seen=_elsewhere),
    World("two marks are exchanged", ONSET_S, seen=_exchanged),
    World("marks with y down", seen=_mirrored),
    World("the scale is 3 % off", seen=_scaled(1.03)),
    World("the scale is 10 % off", seen=_scaled(1.1)),
    World("a tenth of the marks' sd is stated", sd_m=0.1 * MARK_SD_M),
    World("ten times the marks' sd are stated", sd_m=10.0 * MARK_SD_M),
    World("one mark in twenty is 10 mm off", seen=_heavy),
    World("a delay of 100 ms that nobody states", seen=_late),
    World("half of the frames are lost", seen=_halved),
    World("the tracker's clock is 2 % fast", seen=_fast),
)


def world_of(name: str) -> World:
    """The world of this name; KeyError where there is none."""
    return {world.name: world for world in WORLDS}[name]
