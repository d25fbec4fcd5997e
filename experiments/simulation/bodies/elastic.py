"""Elastic bodies, simulated with finite elements: hanging blocks, floating blocks and sheets."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynamics import MassSpringNetwork, build_network, fit_rest_lengths, spring_lengths
from experiments.arrays import Floats
from experiments.simulation.bodies.body import GRAVITY_M_S2, MARK_SD_M, Body, Scale, node_names
from experiments.simulation.bodies.simulate import Act, compiled, motion, pushes, pushing, settled

FRAMES_PER_S = 30
BLOCK_M, BLOCK_PA, BLOCK_KG_M3 = 0.06, 30e3, 1000.0
SHEET_M, SHEET_N_M, SHEET_KG_M2 = (0.20, 0.25), 100.0, 0.2
"""A sheet: its sides [m], its Young's modulus times its thickness [N/m], its mass per area [kg/m²]."""

SHEET_NODES = (5, 6)
THICKNESS_M = 1e-3
POISSON = 0.3
RAYLEIGH_S = 0.01
"""Ratio of damping to stiffness of all bodies [s]."""

PRESS, FINGER = 0.05, 0.6
"""Largest pressure on a block as a share of Young's modulus; radius of the pressed area as a share of the side."""

PULL = 0.2
"""Largest force on a node of a sheet, relative to the sheet's weight."""


def block(per_side: int, seed: int, scale: Scale, seconds: float = 3.0, press: float = PRESS) -> Body:
    """A soft block that hangs from a plate; it is pressed from below and released. Marks on its surface are visible.

    The block hangs, because a soft block that stands would buckle.
    press: largest pressure relative to Young's modulus [1]
    """
    side, mass = BLOCK_M * scale.size, BLOCK_KG_M3 * BLOCK_M**3 * scale.m
    young = BLOCK_PA * scale.k / scale.size
    spacing = side / (per_side - 1)
    model, data = compiled(_block_xml(per_side, spacing, mass, _material(young, scale)))
    grid = data.flexvert_xpos.copy()
    _settle(model, data, scale)
    drawn = data.flexvert_xpos.copy()
    rng = np.random.default_rng([seed, 0])
    low = np.flatnonzero(grid[:, 2] < grid[:, 2].min() + 0.1 * spacing)

    def pressed() -> Floats:
        away = np.linalg.norm(grid - grid[rng.choice(low)], axis=1) / (FINGER * side)
        share = np.where(np.isin(np.arange(len(grid)), low), np.exp(-0.5 * away**2), 0.0)
        force = press * young * side**2 * rng.uniform(0.3, 1.0) * _mostly_up(rng)
        return np.outer(share / share.sum(), force)

    times, places = _moved(model, data, seconds, scale, _pushing(rng, model, seconds, pressed))
    springs, shared = _lattice(grid, spacing)
    stiffness = 0.4 * young * spacing * shared
    inside = ~_on_hull(grid)
    fixed = grid[:, 2] > grid[:, 2].max() - 0.1 * spacing
    network = _network(drawn, springs, stiffness, RAYLEIGH_S * scale.oscillation, masses=_masses(model), fixed=fixed)
    marked = tuple(f"n{i}" for i in np.flatnonzero(~fixed & ~inside))
    resting = fit_rest_lengths(network, drawn)
    kinds = _kinds(grid, springs, spacing)
    return Body(resting, times, places, marked, MARK_SD_M * scale.size, at_rest=True, kinds=kinds)


def floating_block(seed: int, scale: Scale, seconds: float = 3.0) -> Body:
    """A soft block without supports; moving springs pull its faces. Its corners and face centres are visible."""
    per_side = 3
    side, mass = BLOCK_M * scale.size, BLOCK_KG_M3 * BLOCK_M**3 * scale.m
    young = BLOCK_PA / 3.0 * scale.k / scale.size
    spacing = side / (per_side - 1)
    model, data = compiled(_block_xml(per_side, spacing, mass, _material(young, scale), afloat=True))
    grid = data.flexvert_xpos.copy()
    rng = np.random.default_rng([seed, 0])
    off_center = np.abs(np.round((grid - grid.mean(axis=0)) / spacing)).sum(axis=1)
    faces, seen = np.flatnonzero(off_center == 1), np.isin(off_center, (1, 3))
    act = _leading(rng, model, grid, faces, stiffness=0.5 * young * side, damping_s=0.05 * scale.oscillation)
    times, places = _moved(model, data, seconds, scale, act)
    springs, shared = _lattice(grid, spacing)
    network = _network(
        grid,
        springs,
        0.4 * young * spacing * shared,
        RAYLEIGH_S * scale.oscillation,
        masses=_masses(model),
        fixed=np.zeros(len(grid), dtype=bool),
        gravity=0.0,
    )
    marked = tuple(f"n{i}" for i in np.flatnonzero(seen))
    kinds = _kinds(grid, springs, spacing)
    return Body(network, times, places, marked, MARK_SD_M * scale.size, at_rest=True, kinds=kinds)


def sheet(seed: int, scale: Scale, seconds: float = 3.0) -> Body:
    """A cloth that hangs from its upper edge; nodes of its rim are pulled and released. Only its rim is visible."""
    sides = scale.size * np.array(SHEET_M)
    mass = SHEET_KG_M2 * SHEET_M[0] * SHEET_M[1] * scale.m
    stretch = SHEET_N_M * scale.k
    spacing = sides[0] / (SHEET_NODES[0] - 1)
    thickness = THICKNESS_M * scale.size
    model, data = compiled(_sheet_xml(spacing, mass, thickness, _material(stretch / thickness, scale)))
    grid = data.flexvert_xpos.copy()
    _settle(model, data, scale)
    drawn = data.flexvert_xpos.copy()
    fixed = grid[:, 2] > grid[:, 2].max() - 0.1 * spacing
    flat = grid[:, [0, 2]]
    rim = _on_hull(flat) & ~fixed
    rng = np.random.default_rng([seed, 0])

    def pulled() -> Floats:
        forces = np.zeros_like(grid)
        strength = PULL * mass * GRAVITY_M_S2 * rng.uniform(0.3, 1.0)
        forces[rng.choice(np.flatnonzero(rim))] = strength * _mostly_across(rng)
        return forces

    times, places = _moved(model, data, seconds, scale, _pushing(rng, model, seconds, pulled))
    springs, shared = _lattice(grid, spacing)
    # a square lattice with diagonals of half the stiffness is isotropic: k = 3/4 E t along its edges
    stiffness = 0.75 * stretch * np.where(_diagonal(grid, springs, spacing), 0.5, shared)
    network = _network(drawn, springs, stiffness, RAYLEIGH_S * scale.oscillation, masses=_masses(model), fixed=fixed)
    # rest lengths as cut: with the lengths as drawn some springs would be compressed and the sheet would buckle
    network = replace(network, rest_lengths=spring_lengths(grid, springs))
    marked = tuple(f"n{i}" for i in np.flatnonzero(rim))
    return Body(network, times, places, marked, MARK_SD_M * scale.size, kinds=_kinds(grid, springs, spacing))


def _material(young: float, scale: Scale) -> str:
    """XML attributes of a material with this Young's modulus [Pa]."""
    return f'young="{young}" poisson="{POISSON}" damping="{RAYLEIGH_S * scale.oscillation}"'


OPTION = '<option integrator="discrete" solver="CG" {gravity}/>'
CONTACT = '<contact selfcollide="none" contype="0" conaffinity="0"/>'


def _block_xml(n: int, spacing: float, mass: float, material: str, *, afloat: bool = False) -> str:
    pin = "" if afloat else f'<pin gridrange="0 0 {n - 1} {n - 1} {n - 1} {n - 1}"/>'
    option = OPTION.format(gravity='gravity="0 0 0"' if afloat else "")
    return f"""<mujoco>{option}<worldbody>
        <flexcomp name="b" type="grid" count="{n} {n} {n}" spacing="{spacing} {spacing} {spacing}" dim="3"
         radius="{0.01 * spacing}" mass="{mass}"><edge equality="false"/><elasticity {material}/>{CONTACT}{pin}
        </flexcomp></worldbody></mujoco>"""


def _sheet_xml(spacing: float, mass: float, thickness: float, material: str) -> str:
    across, down = SHEET_NODES
    top = " ".join(f"{i} {down - 1}" for i in range(across))
    return f"""<mujoco>{OPTION.format(gravity="")}<worldbody>
        <flexcomp name="b" type="grid" count="{across} {down} 1" spacing="{spacing} {spacing} {spacing}" dim="2"
         radius="{0.5 * thickness}" mass="{mass}" euler="90 0 0"><edge equality="false"/>
        <elasticity {material} thickness="{thickness}" elastic2d="both"/>{CONTACT}<pin grid="{top}"/>
        </flexcomp></worldbody></mujoco>"""


def _settle(model: Any, data: Any, scale: Scale) -> None:
    seconds = 2.0 * max(scale.oscillation, scale.swing)
    settled(model, data, seconds=seconds, step_s=2e-3 * min(1.0, scale.oscillation), kept=0.98)


def _moved(model: Any, data: Any, seconds: float, scale: Scale, act: Act) -> Any:
    times = np.arange(round(FRAMES_PER_S * seconds)) / FRAMES_PER_S
    longest_s = 1e-3 * min(1.0, scale.oscillation)
    places = motion(model, data, lambda d: d.flexvert_xpos, times_s=times, longest_s=longest_s, act=act)
    return times, places


def _pushing(rng: np.random.Generator, model: Any, seconds: float, forces: Callable[[], Floats]) -> Act:
    """A function that applies random forces with pauses. `forces` draws the forces on all nodes [N], (n_nodes, 3)."""
    own = model.flex_vertbodyid > 0
    between = (0.2, 0.8)
    found = pushes(rng, seconds, lambda: forces()[own], first=(0.2, 0.5), lasts=between, pause=between)
    return pushing(model.flex_vertbodyid[own], found)


def _leading(
    rng: np.random.Generator, model: Any, grid: Floats, nodes: NDArray[Any], *, stiffness: float, damping_s: float
) -> Act:
    """A function that applies forces of dashpots, and of springs from nodes to points that move on smooth paths."""
    amplitude = 0.12 * float(np.ptp(grid[:, 0]))
    w, phase = 2.0 * np.pi * rng.uniform(0.2, 0.8, 3), rng.uniform(0.0, 2.0 * np.pi, (len(nodes), 3))
    together = amplitude * rng.normal(size=3)
    bodies = model.flex_vertbodyid[nodes]
    at = np.array([model.body_dofadr[b] for b in bodies])[:, None] + np.arange(3)

    def act(time_s: float, data: Any) -> None:
        own = amplitude * (np.sin(w * time_s + phase) - np.sin(phase))
        wanted = grid[nodes] + min(1.0, time_s) * (own + together * np.sin(w * time_s))
        away = wanted - data.flexvert_xpos[nodes]
        data.xfrc_applied[bodies, :3] = stiffness * away - stiffness * damping_s * data.qvel[at]

    return act


def _mostly_up(rng: np.random.Generator) -> Floats:
    x, y = rng.normal(0.0, 0.5, 2)
    return np.array([x, y, 1.0 if rng.random() < 0.7 else -0.7])


def _mostly_across(rng: np.random.Generator) -> Floats:
    x, z = rng.normal(0.0, 0.3, 2)
    return np.array([x, rng.choice([-1.0, 1.0]), z])


def _on_hull(grid: Floats) -> NDArray[np.bool_]:
    """Whether each node lies on the surface of a grid, (n,)."""
    near = 1e-6 * np.ptp(grid, axis=0)
    return ((grid < grid.min(axis=0) + near) | (grid > grid.max(axis=0) - near)).any(axis=1)


def _lattice(grid: Floats, spacing: float) -> tuple[NDArray[np.int64], Floats]:
    """Springs along edges and face diagonals of a grid, (n_springs, 2), and factors on the stiffness, (n_springs,).

    A factor is the share of a spring's cross section that lies inside the body.
    """
    pairs = np.array(list(combinations(range(len(grid)), 2)))
    lengths = spring_lengths(grid, pairs)
    pairs = pairs[lengths < 1.5 * spacing]
    varied = np.ptp(grid, axis=0) > 1e-6 * spacing
    near = 1e-6 * spacing
    low, high = grid.min(axis=0), grid.max(axis=0)
    a, b = grid[pairs[:, 0]], grid[pairs[:, 1]]
    on_face = (np.abs(a - b) < near) & ((np.abs(a - low) < near) | (np.abs(a - high) < near)) & varied
    return pairs, 0.5 ** on_face.sum(axis=1)


def _diagonal(grid: Floats, springs: NDArray[np.int64], spacing: float) -> NDArray[np.bool_]:
    return spring_lengths(grid, springs) > 1.2 * spacing


def _kinds(grid: Floats, springs: NDArray[np.int64], spacing: float) -> tuple[str, ...]:
    return tuple("diagonal" if one else "edge" for one in _diagonal(grid, springs, spacing))


def _masses(model: Any) -> Floats:
    masses = model.body_mass[model.flex_vertbodyid]
    return np.where(masses > 0.0, masses, masses.max())


def _network(
    drawn: Floats,
    springs: NDArray[np.int64],
    stiffness: Floats,
    damping_s: float,
    *,
    masses: Floats,
    fixed: NDArray[np.bool_],
    gravity: float = GRAVITY_M_S2,
) -> MassSpringNetwork:
    return build_network(
        node_names(len(drawn)),
        drawn,
        springs.tolist(),
        stiffness=stiffness,
        damping=damping_s * stiffness,
        masses=masses,
        fixed=[f"n{i}" for i in np.flatnonzero(fixed)],
        rest_lengths="as drawn",
        gravity=[0.0, 0.0, -gravity],
    )
