"""Content of a new project: a user's scene, and a simulated tissue that differs from it.

The numbers below define the template; a user changes them in the project's files.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dynamics import (
    KINDS,
    OF_SPRINGS,
    NetworkError,
    Phantom,
    parameters,
    rest_shape,
    scale_parameters,
    spring_lengths,
    to_outside,
)
from estimators import NeedlePush
from experiments.arrays import Floats
from experiments.errors import placed
from experiments.formats.needle_file import FORCES
from experiments.formats.scene.marks import Mark
from experiments.formats.scene.reference import Reference
from experiments.formats.scene.scene import Scene
from experiments.formats.scene.target import Target
from experiments.projects.needle import aimed
from vision import PlaneCamera, fronto_parallel_camera

HUES_DEG = (0.0, 120.0, 240.0, 60.0, 180.0, 300.0)
"""Hues of marks [degrees]. The first marks get these hues in this order; then the hues repeat."""

MARK_SIZE = 1.0 / 6.0
"""Diameter of a mark, relative to the shortest spring."""

RADIUS_MM = 5.0
"""Radius of the target [mm]."""

LEAST_REACH_MM = 20.0
"""Least distance of the needle's entry from the target [mm]; it also holds for a target at the edge of the body."""

SIZE_PX, ROOM = (640, 480), 1.6
"""Size of the picture [px]. The visible part of the plane is larger than the body by at least the factor `ROOM` [1]."""

FINEST_MM = 0.01
"""Resolution of a camera's scale: the size of a pixel on the plane is a multiple of this, and at least this [mm]."""

CALIBRATION_SD_PX = 0.68
"""Standard deviation of a mark's position in simulated films with the light `paper` [px]."""

GROUP_SD = {"stiffness": 0.1, "rest_length": 0.0, "damping": 0.2, "drag": 0.2, "friction": 0.2}
"""Relative sd of random factors on the simulated tissue's constants; all springs of a group have the same factor."""

OWN_SD = {"stiffness": 0.03, "rest_length": 0.005, "damping": 0.03, "drag": 0.03, "friction": 0.03}
"""Relative sd of a second random factor on each constant; each spring and each node has its own factor."""


@dataclass(frozen=True, slots=True, eq=False)
class Template:
    """Content of a project: the user's scene, the scene of the simulated tissue, and the needle's entry and direction.

    assumed: the user's scene, which the filter assumes; its positions are those at rest
    truth: the scene of the simulated tissue at rest; only its constants and positions differ from `assumed`
    entry_m: where the needle enters the tissue [m], (dim,)
    direction: unit vector from the entry to the position to which the needle moves the target, (dim,)
    """

    title: str
    assumed: Scene
    truth: Scene
    entry_m: Floats
    direction: Floats

    @property
    def truth_all_seen(self) -> Scene:
        """The scene of the simulated tissue for a calibration: all marks are measured, also those inside the tissue."""
        return replace(self.truth, marks=tuple(replace(mark, measured=True) for mark in self.truth.marks))


def template(title: str, phantom: Phantom, hues: dict[str, float], way: Floats, *, seed: int) -> Template:
    """The project of a phantom; raises InputError if the simulated tissue has no stable shape at rest.

    hues: stated hues of marks by node [degrees]; way: direction from the target to the needle's entry, (dim,)
    """
    assumed = scene_with_marks(phantom, hues)
    network = assumed.network
    factors = _off(phantom, np.random.default_rng(seed))
    which = parameters(network)
    changed = scale_parameters(network, which, [factors[one.kind][one.index] for one in which])
    with placed(f"--seed {seed}: simulated tissue", NetworkError):
        actual = replace(changed, positions=rest_shape(changed))
    start = network.positions[network.index(phantom.target)]
    out = way / np.linalg.norm(way)
    reach = max(to_outside(network.positions, start, out), 1e-3 * LEAST_REACH_MM)
    entry = start + reach * out
    push = NeedlePush(network, phantom.target, FORCES.planned(network))
    return Template(title, assumed, replace(assumed, network=actual), entry, aimed(push, start, entry, -out)[0])


def scene_with_marks(phantom: Phantom, hues: dict[str, float]) -> Scene:
    """The scene of a phantom, with a mark on each free node. The filter does not use marks inside the phantom.

    The scene of a flat phantom has a camera.
    """
    network = phantom.network
    shortest_m = spring_lengths(network.positions, network.springs).min()
    diameter_m = float(np.round(MARK_SIZE * shortest_m, 4))
    nodes = [network.names[i] for i in network.free]
    marks = tuple(
        Mark(node, hues.get(node, HUES_DEG[k % len(HUES_DEG)]), diameter_m, measured=node in phantom.outer)
        for k, node in enumerate(nodes)
    )
    return Scene(
        network=network,
        marks=marks,
        target=Target(phantom.target, 1e-3 * RADIUS_MM, position_sd_m=0.0),
        cameras=(_camera(network.positions),) if network.dim == 2 else (),
        spring_groups=phantom.groups,
        reference=Reference(drift_sd_m=0.0),
    )


def _camera(positions: Floats) -> PlaneCamera:
    """A camera perpendicular to the plane; its picture has room for motion around the body."""
    low, high = positions.min(axis=0), positions.max(axis=0)
    scale = max(float(np.round(1e3 * ROOM * ((high - low) / np.array(SIZE_PX)).max(), 2)), FINEST_MM)
    middle = np.round(0.5 * (low + high), 3)
    camera = fronto_parallel_camera(
        "front", SIZE_PX, (scale, scale), (float(middle[0]), float(middle[1])), calibration_sd_px=CALIBRATION_SD_PX
    )
    return replace(camera, scale_sd=0.0)


def _off(phantom: Phantom, rng: np.random.Generator) -> dict[str, Floats]:
    """Logarithms of random factors on the simulated tissue's constants, by kind, (n_springs,) or (n_nodes,)."""
    names = sorted(set(phantom.groups))
    group = np.array([names.index(one) for one in phantom.groups])
    factors = {}
    for kind in KINDS:
        if kind in OF_SPRINGS:
            together, n = rng.normal(0.0, GROUP_SD[kind], len(names))[group], len(group)
        else:
            together, n = np.full(phantom.network.n_nodes, rng.normal(0.0, GROUP_SD[kind])), phantom.network.n_nodes
        factors[kind] = together + rng.normal(0.0, OWN_SD[kind], n)
    return factors
