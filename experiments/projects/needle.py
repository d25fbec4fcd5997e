"""Entry and aim of the needle in a new project."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dynamics import MassSpringNetwork
from dynamics.mesh import INSIDE, TetMesh, far_apart, nearest_elements
from estimators import Insertion, Needle, NeedlePush
from experiments.arrays import Floats
from experiments.formats.needle_file import FORCES

AIMING = 6
"""Number of iterations for the aim at a target that the needle displaces; numerical: the last iteration moves the aim
by less than 10 µm."""

N_ENTRIES = 200
"""Number of possible entries whose errors are compared; choice: about 15 mm apart on a breast's skin."""

THROUGH = np.linspace(0.1, 1.0, 10)
"""These points of the path must lie in tissue: fractions [1] of the way from the entry to the target."""

BEFORE = np.linspace(0.02, 1.0, 25)
"""Distances before the entry at which the needle must be outside the tissue, relative to the body's extent [1]."""


def aimed(push: NeedlePush, start: Floats, entry: Floats, direction: Floats) -> tuple[Floats, Floats]:
    """Unit vector from the entry to the displaced target, (dim,), and the target's displacement [m], (dim,).

    start, entry: positions of the target at rest and of the entry [m], (dim,)
    """
    shift = np.zeros_like(start)
    for _ in range(AIMING):
        shift = push.shift(Insertion(entry, direction, 1.0))
        direction = (start + shift - entry) / np.linalg.norm(start + shift - entry)
    return direction, shift


def surest_entry(
    network: MassSpringNetwork,
    target: str,
    mesh: TetMesh,
    faces: NDArray[np.int64],
    nearest: Floats,
    wall: NDArray[np.int64],
) -> tuple[Floats, Floats]:
    """The entry with the least error of the tip [m], (3,), and the needle's direction, (3,).

    The needle pushes the target and bends; both cause the error. Entries on the side of the wall are
    excluded, because the rest of the patient's body is there.
    faces: free surface, (k, 3); wall: fixed nodes, (n_fixed,)
    nearest: the surface's point nearest to the target [m], (3,), which is returned if no entry is possible
    """
    forces, bending_sd = FORCES.planned(network), Needle().bending_sd
    push = NeedlePush(network, target, forces)
    start = network.positions[network.index(target)]
    centres = mesh.nodes[faces].mean(axis=1)
    some = far_apart(centres, min(N_ENTRIES, len(centres)), [int(np.linalg.norm(centres - start, axis=1).argmin())])
    from_wall = mesh.nodes.mean(axis=0) - mesh.nodes[wall].mean(axis=0)
    entries = np.vstack([nearest, centres[some]])
    entries = entries[(start - entries) @ from_wall <= 0.0]

    def error_m(entry: Floats) -> float:
        shift = aimed(push, start, entry, start - entry)[1]
        depth_m = np.linalg.norm(start + shift - entry)
        return float(np.hypot(forces.force_sd * np.linalg.norm(shift), bending_sd * depth_m))

    entry = next((entry for entry in sorted(entries, key=error_m) if _is_open(mesh, entry, start)), nearest)
    return entry, aimed(push, start, entry, start - entry)[0]


def _is_open(mesh: TetMesh, entry: Floats, target: Floats) -> bool:
    """Whether a straight needle can reach the entry from outside, and then the target through tissue only.

    entry, target: positions [m], (3,)
    """
    way, extent_m = target - entry, float(np.linalg.norm(np.ptp(mesh.nodes, axis=0)))
    through = entry + THROUGH[:, None] * way
    before = entry - BEFORE[:, None] * extent_m * way / np.linalg.norm(way)
    within = nearest_elements(mesh, np.vstack([through, before]))[1].min(axis=1) >= INSIDE
    return bool(within[: len(through)].all() and not within[len(through) :].any())
