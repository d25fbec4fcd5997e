"""Rows of the study's table. In each row, the truth differs from the scene file in one property."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from dynamics import MassSpringNetwork, NetworkError, fit_rest_lengths, rest_shape
from dynamics.network.mass_spring import spring_lengths
from experiments.arrays import Floats
from experiments.formats.scene.scene import Scene
from experiments.studies.faults.judge import ONSET_S
from experiments.studies.faults.wrong_worlds.simulated import AS_STATED, MARK_SD_M, Becomes, Pushes, Seen, Sees, Truth

WEIGHT = 9.81
"""Weight of a mass of 1 kg [N]."""


@dataclass(frozen=True, slots=True)
class World:
    """A row of the table: the true body, the tracker's frames, and the scene file that the filter gets.

    onset_s: time at which the difference from the scene file begins [s]. The evaluation begins at the same time.
    truth: the true body and the forces on it; seen: function that changes the tracker's frames
    scene: function that changes the scene file; target: keys that are added to the table `[target]` of the scene file
    sd_m: standard deviation of a mark, as stated by the tracker [m]
    reference: whether the scene file has marks on the fixed nodes, which reveal a motion of the camera
    """

    onset_s: float = 0.0
    truth: Truth = AS_STATED
    seen: Sees = lambda seen, _rng: seen
    scene: Callable[[Scene], Scene] = lambda scene: scene
    target: Mapping[str, float] = field(default_factory=dict)
    sd_m: float = MARK_SD_M
    reference: bool = False


def _way(dim: int, rng: np.random.Generator) -> Floats:
    """A random direction, (dim,)."""
    way = rng.normal(size=dim)
    return np.asarray(way / np.linalg.norm(way))


# changes of the tracker's frames


def _frozen(seen: Seen, _rng: np.random.Generator) -> Seen:
    places, during = seen.places.copy(), np.flatnonzero(seen.since(lasts_s=2.0))
    places[during] = places[during[0] - 1]
    return replace(seen, places=places)


def _displaced(by: Callable[[Floats], ArrayLike], *, one: bool = False) -> Sees:
    """Displace all marks, or one mark, in a random direction; by: function from times since ONSET_S to lengths [m]."""

    def sees(seen: Seen, rng: np.random.Generator) -> Seen:
        each = np.zeros_like(seen.places)
        way = _way(len(seen.middle), rng)
        which = [rng.integers(len(seen.nodes))] if one else slice(None)
        each[:, which] = np.asarray(by(seen.exposed_s - ONSET_S))[:, None, None] * way
        return replace(seen, places=seen.places + each)

    return sees


def _camera_turned(seen: Seen, rng: np.random.Generator) -> Seen:
    """At ONSET_S, rotate all marks about the body's centre by 2 degrees. In 3-D, the rotation axis is random."""
    angle, dim = np.deg2rad(2.0), len(seen.middle)
    axis = _way(3, rng) if dim == 3 else np.array([0.0, 0.0, 1.0])
    cross = np.cross(np.eye(3), axis)
    turn = (np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross)[:dim, :dim]
    turned = (seen.places - seen.middle) @ turn.T + seen.middle
    return replace(seen, places=np.where(seen.since()[:, None, None], turned, seen.places))


def _exchanged(seen: Seen, _rng: np.random.Generator) -> Seen:
    places, after = seen.places.copy(), seen.since()
    places[after, :2] = places[after, 1::-1]
    return replace(seen, places=places)


def _scaled(x: float, y: float) -> Sees:
    """Scale marks about the body's centre: along x and z by the factor `x`, along y by the factor `y`."""
    factors = np.array([x, y, x])
    return lambda seen, _rng: replace(
        seen, places=seen.middle + factors[: len(seen.middle)] * (seen.places - seen.middle)
    )


def _late(seen: Seen, _rng: np.random.Generator) -> Seen:
    return replace(seen, stated_s=seen.exposed_s + 0.1, arrive_s=seen.exposed_s + 0.1)


def _halved(seen: Seen, rng: np.random.Generator) -> Seen:
    kept = rng.random(len(seen.exposed_s)) < 0.5
    of_frames = {key: getattr(seen, key)[kept] for key in ("exposed_s", "stated_s", "arrive_s", "places")}
    return replace(seen, **of_frames)


def _heavy(seen: Seen, rng: np.random.Generator) -> Seen:
    wild = rng.random(seen.places.shape[:2]) < 0.05
    ways = rng.normal(size=seen.places.shape)
    ways *= 10e-3 / np.linalg.norm(ways, axis=2, keepdims=True)
    return replace(seen, places=seen.places + np.where(wild[..., None], ways, 0.0))


# changes of the tissue, or of its stated constants

Factor = float | Callable[[Scene], Floats]
"""Factor that multiplies all constants of a kind, or function that returns a factor for each constant."""


def _times(scene: Scene, factors: Mapping[str, Factor]) -> MassSpringNetwork:
    """The scene's network after its constants are multiplied; factors: a factor for each kind of constant."""
    own = {kind: factor(scene) if callable(factor) else factor for kind, factor in factors.items()}
    return replace(scene.network, **{kind: factor * getattr(scene.network, kind) for kind, factor in own.items()})


def _body(**factors: Factor) -> Truth:
    """A true body whose constants are multiplied by these factors. It starts in its rest shape."""

    def changed(scene: Scene, _rng: np.random.Generator) -> MassSpringNetwork:
        network = _times(scene, factors)
        return replace(network, positions=rest_shape(network))

    return Truth(changed)


def _stated(**factors: Factor) -> Callable[[Scene], Scene]:
    return lambda scene: replace(scene, network=_times(scene, factors))


def _truly(change: Becomes) -> Truth:
    return Truth(lambda scene, _rng: change(scene.network))


def _of_target(factor: float) -> Callable[[Scene], Floats]:
    """Function that returns a factor for each spring, (n_springs,): `factor` for the target's springs, 1 for others."""
    return lambda scene: np.where(
        (scene.network.springs == scene.network.index(scene.target.node)).any(axis=1), factor, 1.0
    )


def _of_most_loaded(factor: float) -> Callable[[Scene], Floats]:
    """Function that returns `factor` for the target's spring with the largest load at rest, and 1 for other springs."""

    def factors(scene: Scene) -> Floats:
        network, at_target = scene.network, _of_target(0.0)(scene) == 0.0
        loads = np.abs(network.stiffness * (spring_lengths(network.positions, network.springs) - network.rest_lengths))
        return np.where(np.arange(len(loads)) == np.argmax(loads * at_target), factor, 1.0)

    return factors


def _of_target_mass(factor: float) -> Callable[[Scene], Floats]:
    return lambda scene: np.where(np.arange(scene.network.n_nodes) == scene.network.index(scene.target.node), factor, 1)


def _loose(scene: Scene, _rng: np.random.Generator) -> MassSpringNetwork:
    """The network with an unchanged rest shape, but only 30 % of stiffness and damping in the target's springs."""
    factors = _of_target(0.3)(scene)
    network = _times(scene, {"stiffness": _of_target(0.3), "damping": _of_target(0.3)})
    lengths = spring_lengths(network.positions, network.springs)
    return replace(network, rest_lengths=lengths - (lengths - network.rest_lengths) / factors)


def _rests_at(by_m: float) -> Truth:
    def moved(scene: Scene, rng: np.random.Generator) -> MassSpringNetwork:
        """The body at rest with a target displaced in a random direction for which rest lengths exist."""
        places = scene.network.positions.copy()
        places[scene.network.index(scene.target.node)] += by_m * _way(scene.network.dim, rng)
        try:
            return fit_rest_lengths(scene.network, places)
        except NetworkError:
            return moved(scene, rng)

    return Truth(moved)


def _dragged(network: MassSpringNetwork) -> MassSpringNetwork:
    """The network with ten times the drag. Nodes without drag get a drag whose time constant is 0.1 s."""
    without = np.where(network.fixed, 0.0, 10.0 * network.masses)
    return replace(network, drag=np.where(network.drag > 0.0, 10.0 * network.drag, without))


def _rough(network: MassSpringNetwork) -> MassSpringNetwork:
    return replace(network, friction=np.where(network.fixed, 0.0, 0.05 * WEIGHT * network.masses))


def _slipped(network: MassSpringNetwork) -> MassSpringNetwork:
    positions = network.positions.copy()
    positions[np.flatnonzero(network.fixed)[0], 1] -= 5e-3
    return replace(network, positions=positions)


_MOVES = {
    "the camera drifts by 1 mm/s": _displaced(lambda t: 1e-3 * np.clip(t, 0.0, None)),
    "the camera is moved by 10 mm": _displaced(lambda t: 10e-3 * (t >= 0.0)),
    "the camera is turned by 2 degrees": _camera_turned,
}

WORLDS: Mapping[str, World] = {
    "nothing": World(),
    "positions freeze for 2 s, times advance": World(ONSET_S, seen=_frozen),
    **{name: World(ONSET_S, seen=seen) for name, seen in _MOVES.items()},
    **{f"{name}, with reference marks": World(ONSET_S, seen=seen, reference=True) for name, seen in _MOVES.items()},
    "all marks move by 8 mm for half a second": World(
        ONSET_S, seen=_displaced(lambda t: 8e-3 * ((t >= 0.0) & (t < 0.5)))
    ),
    **{f"a target position error of {mm} mm": World(truth=_rests_at(1e-3 * mm)) for mm in (10, 3)},
    **{
        f"a stated target position error of {mm} mm": World(
            truth=_rests_at(1e-3 * mm), target={"position_sd_mm": float(mm)}
        )
        for mm in (10, 3)
    },
    "the target's springs are a third as stiff": World(
        truth=_body(stiffness=_of_target(1.0 / 3.0), damping=_of_target(1.0 / 3.0))
    ),
    "a spring of the target is a third as stiff": World(
        truth=_body(stiffness=_of_most_loaded(1.0 / 3.0), damping=_of_most_loaded(1.0 / 3.0))
    ),
    "a spring of the target is missing": World(
        truth=_body(stiffness=_of_most_loaded(1e-3), damping=_of_most_loaded(1e-3))
    ),
    "the target's springs are softer, with unchanged rest shape": World(truth=Truth(_loose)),
    "the target's mass is three times as large": World(truth=_body(masses=_of_target_mass(3.0))),
    "all springs are half as stiff": World(truth=_body(stiffness=0.5)),
    "all springs are twice as stiff": World(truth=_body(stiffness=2.0)),
    "all masses are half as large": World(truth=_body(masses=0.5)),
    "all masses are twice as large": World(truth=_body(masses=2.0)),
    "damping is five times as large": World(truth=_body(damping=5.0)),
    "drag is ten times as large": World(truth=_truly(_dragged)),
    "there is no drag": World(truth=Truth(lambda scene, _rng: _times(scene, {"drag": 0.0}))),
    "unstated dry friction of 5 % of the weight": World(truth=_truly(_rough), scene=_stated(friction=0.0)),
    "gravity stated as 0": World(scene=_stated(gravity=0.0)),
    "gravity stated upside down": World(scene=_stated(gravity=-1.0)),
    "masses stated in g": World(scene=_stated(masses=1e3)),
    "stiffness stated in N/mm": World(scene=_stated(stiffness=1e-3)),
    "the target is also poked": World(truth=Truth(pushes=Pushes(hidden=True))),
    "pokes of 15 m/s²": World(truth=Truth(pushes=Pushes(pokes_m_s2=15.0))),
    "breathing accelerates all free nodes": World(truth=Truth(pushes=Pushes(everywhere=True))),
    "the body turns by 60 degrees": World(truth=Truth(pushes=Pushes(turned_deg=60.0))),
    "a second breathing force, sideways": World(truth=Truth(pushes=Pushes(second=True))),
    "an anchor slips by 5 mm": World(ONSET_S, truth=Truth(becomes=_slipped, onset_s=ONSET_S)),
    "a mark slides by 8 mm in 2 s": World(ONSET_S, seen=_displaced(lambda t: np.clip(4e-3 * t, 0.0, 8e-3), one=True)),
    "a mark is reattached 5 mm away": World(ONSET_S, seen=_displaced(lambda t: 5e-3 * (t >= 0.0), one=True)),
    "two marks are exchanged": World(ONSET_S, seen=_exchanged),
    "the marks' y points down": World(seen=_scaled(1.0, -1.0)),
    "a scale error of 3 %": World(seen=_scaled(1.03, 1.03)),
    "a scale error of 10 %": World(seen=_scaled(1.1, 1.1)),
    "marks' sd stated ten times too small": World(sd_m=0.1 * MARK_SD_M),
    "marks' sd stated ten times too large": World(sd_m=10.0 * MARK_SD_M),
    "one mark in twenty has 10 mm error": World(seen=_heavy),
    "an unstated delay of 100 ms": World(seen=_late),
    "half of the frames are lost": World(seen=_halved),
    "the tracker's clock is 2 % fast": World(seen=lambda seen, _rng: replace(seen, stated_s=1.02 * seen.exposed_s)),
}
"""Rows by name, in the order of the table."""
