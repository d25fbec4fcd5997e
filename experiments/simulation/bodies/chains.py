"""Chains of rigid links that start in motion, and cables with one fixed end and one end that is moved along a path."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import mujoco
import numpy as np

from dynamics import build_network
from experiments.arrays import Floats
from experiments.simulation.bodies.body import GRAVITY_M_S2, MARK_SD_M, Body, Scale, node_names
from experiments.simulation.bodies.simulate import compiled, motion

LINKS_M = (0.0917, 0.0693, 0.080)
MASSES_KG = (0.030, 0.012, 0.020)
LINK_N_M, LINK_N_S_M = 2000.0, 0.5
"""Stiffness [N/m] and damping [N s/m] of the spring with which a user models a rigid link."""

HINGE_N_M_S = 1e-5
SPEED_RAD_S = 3.0

SEGMENTS, SEGMENT_M, SEGMENT_KG = 12, 0.1, 0.012
BEND_N_M, BEND_N_M_S = 0.02, 0.0008
"""A ball joint's stiffness [N m/rad] and damping [N m s/rad]."""

BEND_RAD = 0.2
"""Bend of a joint [rad] at which the true joint and the spring over two segments in the user's network have the same
energy. At smaller bends the spring has less. The value is the rms bend of the simulated cables at both speeds."""

DRAG_N_S_M = 0.002
HIDDEN_OF_CABLE = (5, 6, 7)
"""Indices of the hidden nodes: adjacent, as if an object covered the middle."""


def chain(n_links: int, seed: int, scale: Scale, seconds: float = 4.0) -> Body:
    """A pendulum of rigid links in the plane; a camera sees its outer end at 100 Hz.

    Mass and stiffness do not affect the motion of rigid links. If a factor on them is not 1, the links can stretch.
    """
    rng = np.random.default_rng([seed, 0])
    lengths = scale.size * np.array(LINKS_M[:n_links])
    masses = scale.m * np.array(MASSES_KG[:n_links])
    hinge = HINGE_N_M_S * scale.m * scale.size**2 / scale.swing
    stretch = _stretch("0 0 1", scale, LINK_N_M * scale.k, LINK_N_S_M * scale.c)
    model, data = compiled(_chain_xml(lengths, masses, hinge, stretch))
    turning = np.array([k for k in range(model.njnt) if model.jnt_type[k] == mujoco.mjtJoint.mjJNT_HINGE])
    data.qpos[turning] = rng.uniform(-1.5, 1.5, n_links)
    data.qvel[turning] = rng.normal(0.0, SPEED_RAD_S / scale.swing, n_links)
    mujoco.mj_forward(model, data)
    times = np.arange(round(100 * seconds)) / 100.0
    longest_s = 5e-4 * min(1.0, scale.oscillation, scale.swing)
    places = motion(model, data, lambda d: d.geom_xpos[:, [0, 2]], times_s=times, longest_s=longest_s)
    anchored = np.concatenate([np.zeros((len(times), 1, 2)), places], axis=1)
    drawn = np.zeros((n_links + 1, 2))
    drawn[1:, 1] = -np.cumsum(lengths)
    network = build_network(
        node_names(n_links + 1),
        drawn,
        [(i, i + 1) for i in range(n_links)],
        stiffness=LINK_N_M * scale.k,
        damping=LINK_N_S_M * scale.c,
        masses=np.r_[scale.m, masses],
        fixed=["n0"],
        rest_lengths=lengths,
        gravity=[0.0, -GRAVITY_M_S2],
    )
    return Body(network, times, anchored, (f"n{n_links}",), MARK_SD_M * scale.size, in_line=True)


def _stretch(axis: str, scale: Scale, stiffness: float, damping: float) -> str:
    """XML of a joint with which a link can stretch; empty if the factors on stiffness and mass are 1."""
    if scale.stiffness == scale.mass == 1.0:
        return ""
    return f'<joint type="slide" axis="{axis}" stiffness="{stiffness}" damping="{damping}" springref="0"/>'


def _chain_xml(lengths: Floats, masses: Floats, hinge: float, stretch: str) -> str:
    opened, closed, above = "", "", 0.0
    for length, mass in zip(lengths, masses, strict=True):
        opened += (
            f'<body pos="0 0 {-above}"><joint type="hinge" axis="0 1 0" damping="{hinge}"/>{stretch}'
            f'<geom type="sphere" size="{0.05 * lengths[0]}" pos="0 0 {-length}" mass="{mass}"/>'
        )
        closed += "</body>"
        above = length
    return f"""<mujoco><option integrator="RK4"/><default><geom contype="0" conaffinity="0"/></default>
        <worldbody>{opened}{closed}</worldbody></mujoco>"""


def cable(seed: int, scale: Scale, speed: float, seconds: float = 5.0) -> Body:
    """A cable of twelve segments in space. One end is fixed, one end moves along a path, and the middle is not visible.

    speed: factor on the speed of the moved end; with the factor 1 this end moves at up to 1 m/s
    """
    rng = np.random.default_rng([seed, 0])
    n, length, mass = SEGMENTS, SEGMENT_M * scale.size, SEGMENT_KG * scale.m
    bend, slow = BEND_N_M * scale.k * scale.size**2, BEND_N_M_S * scale.c * scale.size**2
    # a joint bent by b has the energy k_b b² / 2; a spring over two segments is shortened by L b² / 4
    over_two = 16.0 * bend / (length * BEND_RAD) ** 2
    stiffness = np.r_[np.full(n, LINK_N_M * scale.k), np.full(n - 1, over_two)]
    damping = np.r_[np.full(n, LINK_N_S_M * scale.c), np.full(n - 1, over_two * slow / bend)]
    # the user's springs over two segments also resist stretching, as do links that can stretch
    stretches = [
        _stretch("1 0 0", scale, k + along * over_two, c + along * over_two * slow / bend)
        for k, c, along in zip(stiffness[:n], damping[:n], [2.0, *[4.0] * (n - 2), 2.0], strict=True)
    ]
    model, data = compiled(_cable_xml(length, mass, (bend, slow), stretches))
    hand = _hand_path(rng, n * length, speed / scale.swing, 1.5 * scale.swing)
    before = 2.0 * max(1.0, scale.swing)
    times = np.arange(round(before * 33) + round(33 * seconds)) / 33.0

    def led(time_s: float, data: Any) -> None:
        data.mocap_pos[0] = hand(time_s)

    led(0.0, data)
    places = motion(
        model,
        data,
        lambda d: np.vstack([np.zeros(3), d.site_xpos[1:]]),
        times_s=times,
        longest_s=2.5e-4 * min(1.0, scale.swing),
        act=led,
    )[round(before * 33) :]
    times = np.arange(len(places)) / 33.0
    pairs = [(i, i + 1) for i in range(n)] + [(i, i + 2) for i in range(n - 1)]
    network = build_network(
        node_names(n + 1),
        places[0],
        pairs,
        stiffness=stiffness,
        damping=damping,
        masses=np.r_[1.0, np.full(n - 1, mass), 0.5 * mass],
        drag=DRAG_N_S_M * scale.c,
        fixed=["n0"],
        rest_lengths=np.r_[np.full(n, length), np.full(n - 1, 2.0 * length)],
        gravity=[0.0, 0.0, -GRAVITY_M_S2],
    )
    marked = tuple(f"n{i}" for i in range(1, n + 1) if i not in HIDDEN_OF_CABLE)
    kinds = ("segment",) * n + ("bend",) * (n - 1)
    return Body(network, times, places, marked, MARK_SD_M * scale.size, in_line=True, led=(f"n{n}",), kinds=kinds)


def _hand_path(rng: np.random.Generator, length_m: float, speed: float, rise_s: float) -> Callable[[float], Floats]:
    """A smooth random path of the cable's moved end: a function of the time that gives a position [m], (3,).

    At time 0 the cable is straight. From rise_s [s] on, the end moves about a point at which the cable is slack.
    """
    waves = (6, 3)
    w, phase = 2.0 * np.pi * speed * rng.uniform(0.3, 1.0, waves), rng.uniform(0.0, 2.0 * np.pi, waves)
    amplitude = length_m / 1.2 * rng.uniform(0.03, 0.12, waves) * 2.0 / np.sqrt(waves[0])
    straight, home = np.array([length_m, 0.0, 0.0]), length_m * np.array([0.8, 0.0, -0.1 / 1.2])

    def at(time_s: float) -> Floats:
        rise = min(1.0, time_s / rise_s)
        rise = rise * rise * (3.0 - 2.0 * rise)
        swaying = home + (amplitude * np.sin(w * time_s + phase)).sum(axis=0)
        return np.asarray((1.0 - rise) * straight + rise * swaying)

    return at


def _cable_xml(length: float, mass: float, bend: tuple[float, float], stretches: Sequence[str]) -> str:
    opened, closed = "", ""
    for k, stretch in enumerate(stretches):
        opened += (
            f'<body pos="{length if k else 0} 0 0"><joint type="ball" stiffness="{bend[0]}" damping="{bend[1]}"/>'
            f'{stretch}<geom type="capsule" fromto="0 0 0 {length} 0 0" size="{0.04 * length}" mass="{mass}"/>'
            f'<site name="s{k}" pos="{length} 0 0"/>'
        )
        closed += "</body>"
    return f"""<mujoco><option integrator="implicitfast"/><default><geom contype="0" conaffinity="0"/></default>
        <worldbody><body name="hand" mocap="true" pos="{SEGMENTS * length} 0 0"><site name="h"/></body>
        {opened}{closed}</worldbody>
        <equality><connect site1="s{SEGMENTS - 1}" site2="h"/></equality></mujoco>"""
