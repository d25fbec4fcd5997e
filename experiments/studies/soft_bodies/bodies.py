"""True motions of soft bodies, and the filter's models, which have another mesh and another stiffness.

The true breasts consist of neo-Hookean tetrahedra with large strains. The implicit midpoint rule integrates the motion
of all nodes. Newton's method solves each step. If convergence is slow, Newton's matrix is factored again. Material law,
mesh and integrator differ from the filter's.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RBFInterpolator
from scipy.sparse import diags_array
from scipy.sparse.linalg import SuperLU
from scipy.spatial.transform import Rotation

from dynamics import MassSpringNetwork
from dynamics.elements import Assembly, Tetrahedra, TissueConstants, continuum_network
from dynamics.mesh import TetMesh, Tissue, factored, far_apart, grid_tetrahedra, lumped_masses, surface
from dynamics.phantoms import TISSUES, breast_mesh, breast_points
from experiments.arrays import Floats
from experiments.simulation.bodies.body import Scale
from experiments.simulation.bodies.elastic import BLOCK_KG_M3, BLOCK_PA, POISSON, RAYLEIGH_S, block

STEPS = 2
"""Number of steps per frame; numerical."""

CONVERGED = 1e-6
"""If an iteration changes the velocity by less than this [m/s], the iterations end; numerical."""

SLOW, MOST = 6, 40
"""After `SLOW` iterations, the matrix is factored again; after `MOST` more iterations, the step fails; numerical."""

Load = Callable[[float], Floats]
"""Function of a time [s]; it returns the forces on all nodes [N], (n_nodes, 3)."""


def motion(mesh: TetMesh, tissues: list[Tissue], fixed: NDArray[np.int64], times_s: Floats, load: Load) -> Floats:
    """Positions of all nodes [m], (n_frames, n_nodes, 3). The body is at rest in the first frame.

    times_s: equally spaced times of the frames [s]; load: function that returns the forces on all nodes at a time

    Raises RuntimeError if a step has no solution.
    """
    E, nu, density, damping = (
        np.array([getattr(tissue, key) for tissue in tissues])[mesh.regions]
        for key in ("young_pa", "poisson", "density_kg_m3", "damping_s")
    )
    free = np.setdiff1d(np.arange(len(mesh.nodes)), fixed)
    elements = Tetrahedra(mesh, "neo-hookean", TissueConstants(E, nu, damping))
    body = Assembly(mesh.nodes, free, [elements])
    mass = np.repeat(lumped_masses(mesh, density)[free], 3)
    h = float(times_s[1] - times_s[0]) / STEPS
    q, v, factor = mesh.nodes[free].ravel(), np.zeros(len(mass)), None
    found = [mesh.nodes.copy()]
    for start in times_s[:-1]:
        for step in range(STEPS):
            force = load(start + (step + 0.5) * h)[free].ravel()
            middle, factor = _step(body, mass, h, (q, v), force, factor)
            q, v = q + h * middle, 2.0 * middle - v
        now = mesh.nodes.copy()
        now[free] = q.reshape(-1, 3)
        found.append(now)
    return np.array(found)


def _step(
    body: Assembly, mass: Floats, h: float, state: tuple[Floats, Floats], force: Floats, factor: SuperLU | None
) -> tuple[Floats, SuperLU]:
    """Velocity at the midpoint of a step [m/s], and the factored Newton matrix, with which the next step begins."""
    q, v = state
    for most in (SLOW, MOST) if factor is not None else (MOST,):
        middle = v.copy()
        for _ in range(most):
            if factor is None:
                K, C = body.tangents(q + 0.5 * h * middle, middle)
                factor = factored(diags_array(2.0 / h * mass) + 0.5 * h * K + C)
            change = factor.solve(body.force(q + 0.5 * h * middle, middle) + force - 2.0 / h * mass * (middle - v))
            if not np.isfinite(change).all():
                break
            middle = middle + change
            if np.abs(change).max() < CONVERGED:
                return middle, factor
        factor = None
    raise RuntimeError(f"truth: expected a solution of a step within {MOST} iterations, found none")


UNCERTAIN = 0.35
"""Standard deviation of `log(stated stiffness / true stiffness)`: 95 % of the ratios are between 1/2 and 2."""

FRAME_S, SECONDS = 1.0 / 30.0, 8.0
N_MARKS, BLOCK_CELLS = 40, 6
PRESS = 0.02
"""Largest pressure on a block's lower face divided by Young's modulus. A value of 0.05 turns fine meshes inside out."""

TRUTH, GIVEN = (11, 8), (10, 7)
"""Numbers of cells across and in depth: TRUTH for the true breast, GIVEN for the filter's model of the breast."""

SLAB_M, SLAB_CELLS = (0.1, 0.08, 0.05), ((11, 9, 6), (8, 6, 4))
"""Size of a slab [m], and numbers of cells along its edges: for the true slab, and for the filter's model of it."""

SLAB_LOAD = 0.3
"""Forces on a slab, relative to those on a breast [1]: they move its skin by about 10 to 30 mm."""

WALL_BREATH_M, WALL_TURN_RAD, WALL_SHIFT_M = 0.01, (0.035, 0.09), 0.005
"""Motion of a moving wall: shift in each breath [m], range of the rotation in each breath [rad], and size of a single
lasting shift, which takes one second [m]."""

GRAVITY_M_S2, INSTANT_S = np.array([0.0, 0.0, -9.81]), 0.02
"""Gravity [m/s²]; time step of the finite differences for the acceleration of a moving wall [s], numerical."""

BREATH_M_S2, BREATH_HZ = (3.0, 10.0), (0.2, 0.35)
PRESSED, PRESSED_S = (0.015, 0.06), (0.2, 2.0)
"""Range of the radii of pushes on the skin [m], and range of the durations of pushes [s]."""

PRESSURE_PA = (300.0, 1500.0)
"""Range of the peak pressures of pushes [Pa]. Pushes move the skin by about 5 to 20 mm."""


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """The true motion of a body, and a model of the body.

    network: model of the body, which the methods use. Its free nodes are marks and target. The others are on the wall.
    positions: true positions of marks and target [m], (n_frames, n_marks + 1, 3)
    """

    network: MassSpringNetwork
    marked: tuple[str, ...]
    times_s: Floats
    positions: Floats


def soft_block(per_side: int, seed: int) -> Recording:
    """A block that hangs from a plate, simulated by MuJoCo. It is pressed from below, and then released."""
    rng = np.random.default_rng([seed, 1])
    body = block(per_side, seed, Scale(), SECONDS, PRESS)
    drawn, fixed = body.network.positions, body.network.fixed
    grid = np.round((drawn - drawn.min(axis=0)) / np.ptp(drawn, axis=0) * (per_side - 1))
    sag = RBFInterpolator(grid / (per_side - 1), drawn, kernel="linear", neighbors=min(len(grid), 60))
    corners = _corners((BLOCK_CELLS,) * 3)
    mesh = TetMesh(sag(corners), grid_tetrahedra((BLOCK_CELLS,) * 3))
    tissue = Tissue("gel", _given(rng, BLOCK_PA), POISSON, BLOCK_KG_M3, RAYLEIGH_S)
    index = {name: k for k, name in enumerate(body.network.names)}
    skin = np.array([index[name] for name in body.marked])
    skin = skin[far_apart(drawn[skin], min(len(skin), N_MARKS))]
    inner = np.setdiff1d(np.flatnonzero(~fixed), [index[name] for name in body.marked])
    target = inner[np.linalg.norm(drawn[inner] - drawn.mean(axis=0), axis=1).argmin()]
    shown = np.r_[skin, target]
    names = (*(f"M{k}" for k in range(1, 1 + len(skin))), "target")
    wall = np.flatnonzero(corners[:, 2] == 1.0)
    network = continuum_network(mesh, (tissue,), wall, dict(zip(names, drawn[shown], strict=True)))
    return Recording(network, names[:-1], body.times_s, body.positions[:, shown])


def slab(n_marks: int, seed: int, *, driven: bool = False) -> Recording:
    """A breathing slab of fat on a wall, with pushes on its skin. n_marks marks are on the face opposite the wall.

    driven: whether the wall moves in the filter's model
    """
    rng = np.random.default_rng([seed, 5])
    mesh, given = (
        TetMesh((_corners(cells) - [0.5, 0.5, 0.0]) * SLAB_M, grid_tetrahedra(cells)) for cells in SLAB_CELLS
    )
    x, top = mesh.nodes, np.flatnonzero(mesh.nodes[:, 2] == SLAB_M[2])
    target = int(np.linalg.norm(x - [0.0, 0.0, 0.5 * SLAB_M[2]], axis=1).argmin())
    shown = np.r_[rng.choice(top, n_marks, replace=False), target]
    wall, times_s = np.flatnonzero(x[:, 2] == 0.0), _times_s()
    load = _loads(mesh, wall, rng)
    places = motion(mesh, list(TISSUES[:1]), wall, times_s, lambda t: SLAB_LOAD * load(t))[:, shown]
    names = (*(f"M{k}" for k in range(1, 1 + n_marks)), "target")
    tissue = replace(TISSUES[0], young_pa=_given(rng, TISSUES[0].young_pa))
    held = np.flatnonzero(given.nodes[:, 2] == 0.0)
    network = continuum_network(given, (tissue,), held, dict(zip(names, x[shown], strict=True)), driven=driven)
    return Recording(network, names[:-1], times_s, places)


def _corners(cells: tuple[int, int, int]) -> Floats:
    """Corners of the cells of a unit cube, in the order of `grid_tetrahedra`, (n, 3)."""
    axes = [np.linspace(0.0, 1.0, 1 + count) for count in cells]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def _times_s() -> Floats:
    return np.linspace(0.0, SECONDS - FRAME_S, round(SECONDS / FRAME_S))


def breast(seed: int, wall: Literal["fixed", "driven", "none"] = "fixed", *, moves: bool = False) -> Recording:
    """A breathing breast of neo-Hookean elements; pushes act on areas of its skin.

    wall: the wall in the filter's model; moves: whether the true wall moves
    """
    times_s = _times_s()
    points, places, moduli = _breast(seed, moves, tuple(times_s))
    given, held = breast_mesh(*GIVEN)
    tissues = tuple(replace(tissue, young_pa=young_pa) for tissue, young_pa in zip(TISSUES, moduli, strict=True))
    drawn = dict(zip(points, places[0], strict=True))
    nodes = held if wall != "none" else np.empty(0, dtype=np.int64)
    network = continuum_network(given, tissues, nodes, drawn, driven=wall == "driven")
    return Recording(network, points[:-1], times_s, places)


@cache
def _breast(seed: int, moves: bool, times_s: tuple[float, ...]) -> tuple[tuple[str, ...], Floats, list[float]]:
    """Names of marks and target, their true positions [m], (n_frames, n_points, 3), and the filter's moduli [Pa]."""
    rng = np.random.default_rng([seed, 2])
    mesh, wall = breast_mesh(*TRUTH)
    points = breast_points(mesh, wall, N_MARKS)
    nodes = [int(np.linalg.norm(mesh.nodes - place, axis=1).argmin()) for place in points.values()]
    load = _loads(mesh, wall, rng)
    moduli = [_given(rng, tissue.young_pa) for tissue in TISSUES]
    if not moves:
        return tuple(points), motion(mesh, list(TISSUES), wall, np.array(times_s), load)[:, nodes], moduli
    pose = _pose(np.random.default_rng([seed, 4]))
    masses = _masses(mesh)

    def on_wall(time_s: float) -> Floats:
        """Load and inertial forces in the moving wall's frame, without Coriolis forces."""
        before, now, after = (pose(time_s + step) for step in (-INSTANT_S, 0.0, INSTANT_S))
        acceleration = sum(k * (mesh.nodes @ turn.T + x) for k, (turn, x) in ((1, before), (-2, now), (1, after)))
        pull = (GRAVITY_M_S2 - acceleration / INSTANT_S**2) @ now[0] - GRAVITY_M_S2
        return load(time_s) + masses[:, None] * pull

    places = motion(mesh, list(TISSUES), wall, np.array(times_s), on_wall)[:, nodes]
    for now, time_s in zip(places, times_s, strict=True):
        turn, shift = pose(time_s)
        now[:] = now @ turn.T + shift
    return tuple(points), places, moduli


def _pose(rng: np.random.Generator) -> Callable[[float], tuple[Floats, Floats]]:
    """Function from a time [s] to the moving wall's rotation, (3, 3), and shift [m], (3,)."""
    along, axis, aside = rng.normal(size=(3, 3))
    along = 0.3 * along + [0.0, 0.0, 1.0]
    breath, shift = WALL_BREATH_M * along / np.linalg.norm(along), WALL_SHIFT_M * aside / np.linalg.norm(aside)
    turn = rng.uniform(*WALL_TURN_RAD) * axis / np.linalg.norm(axis)
    hz, start_s = rng.uniform(*BREATH_HZ), rng.uniform(3, 6)

    def pose(time_s: float) -> tuple[Floats, Floats]:
        share, since = 0.5 - 0.5 * np.cos(2.0 * np.pi * hz * time_s), np.clip(time_s - start_s, 0.0, 1.0)
        moved = since**3 * (10.0 - 15.0 * since + 6.0 * since**2)
        return Rotation.from_rotvec(share * turn).as_matrix(), share * breath + moved * shift

    return pose


def _masses(mesh: TetMesh) -> Floats:
    """Lumped masses of the nodes [kg], (n_nodes,)."""
    return lumped_masses(mesh, np.array([tissue.density_kg_m3 for tissue in TISSUES])[mesh.regions])


def _given(rng: np.random.Generator, young_pa: float) -> float:
    """A random Young's modulus for the filter's model [Pa]; young_pa: the true modulus [Pa]."""
    return young_pa * float(np.exp(UNCERTAIN * rng.normal()))


def _loads(mesh: TetMesh, wall: NDArray[np.int64], rng: np.random.Generator) -> Callable[[float], Floats]:
    outside = surface(mesh)
    skin = outside.nodes[~np.isin(outside.nodes, wall)]
    areas = np.zeros(len(mesh.nodes))
    areas[outside.nodes] = outside.areas
    masses = _masses(mesh)
    along = rng.normal(size=3) + np.array([0.0, 2.0, 0.0])
    breath = rng.uniform(*BREATH_M_S2) * np.outer(masses, along / np.linalg.norm(along))
    hz, pushes, start = rng.uniform(*BREATH_HZ), [], float(rng.uniform(0.5, 1.5))
    while start < SECONDS:
        lasts, radius = float(rng.uniform(*PRESSED_S)), rng.uniform(*PRESSED)
        center = mesh.nodes[rng.choice(skin)]
        inwards = np.append(-center[:2], -0.5 * center[2]) + 0.02 * rng.normal(size=3)
        near = areas * np.exp(-0.5 * (np.linalg.norm(mesh.nodes - center, axis=1) / (0.6 * radius)) ** 2)
        force = rng.uniform(*PRESSURE_PA) * np.outer(near, inwards / np.linalg.norm(inwards))
        pushes.append((start, lasts, force))
        start += lasts + float(rng.uniform(0.3, 1.5))

    def load(time_s: float) -> Floats:
        total = np.sin(2.0 * np.pi * hz * time_s) * breath
        for begins, lasts, force in pushes:
            since = min(time_s - begins, begins + lasts - time_s)
            total = total + np.clip(since / 0.1, 0.0, 1.0) * force  # pushes rise and fall in 0.1 s
        return np.asarray(total)

    return load


BODIES: Mapping[str, Callable[[int], Recording]] = {
    "block, 27 nodes": lambda seed: soft_block(3, seed),
    "block, 125 nodes": lambda seed: soft_block(5, seed),
    "block, 343 nodes": lambda seed: soft_block(7, seed),
    "block, 1,000 nodes": lambda seed: soft_block(10, seed),
    "slab, 6 marks": lambda seed: slab(6, seed),
    "slab, 20 marks": lambda seed: slab(20, seed),
    "slab, 20 marks, driven": lambda seed: slab(20, seed, driven=True),
    "breast": breast,
    "breast, driven": lambda seed: breast(seed, "driven"),
    "moving breast, driven": lambda seed: breast(seed, "driven", moves=True),
    "moving breast, fixed": lambda seed: breast(seed, moves=True),
    "moving breast, free": lambda seed: breast(seed, "none", moves=True),
}
"""Functions from a seed to a recording, by the name of the body in the outputs."""
