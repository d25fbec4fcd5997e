"""The four-mass phantom without its braces, with springs of 80 N/m; it hangs from its anchors and is poked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dynamics import MassSpringNetwork, four_mass_phantom, rest_shape
from dynamics.phantoms.four_mass import OUTER
from experiments.arrays import Floats
from experiments.simulation.bodies.body import GRAVITY_M_S2, MARK_SD_M, Body, Scale
from experiments.simulation.bodies.simulate import compiled, motion, pushes, pushing, settled

STIFFNESS_N_M = 80.0
N_SPRINGS = 8
"""Number of springs that remain without braces. The last two springs of the phantom are braces."""

POKE_M_S2 = 10.0
FRAMES_PER_S = 30


def unbraced_network(scale: Scale) -> MassSpringNetwork:
    """The phantom's network without braces, in its rest shape."""
    phantom = four_mass_phantom()
    drawn = scale.size * phantom.positions
    network = replace(
        phantom,
        positions=drawn,
        masses=scale.m * phantom.masses,
        drag=scale.c * phantom.drag,
        friction=scale.m * phantom.friction,
        springs=phantom.springs[:N_SPRINGS],
        stiffness=np.full(N_SPRINGS, STIFFNESS_N_M * scale.k),
        rest_lengths=scale.size * phantom.rest_lengths[:N_SPRINGS],
        damping=scale.c * phantom.damping[:N_SPRINGS],
    )
    return replace(network, positions=rest_shape(network))


def unbraced_phantom(seed: int, scale: Scale, seconds: float = 5.0) -> Body:
    """The phantom without braces. Forces accelerate the outer masses by up to 10 m/s². The inner mass is hidden."""
    network = unbraced_network(scale)
    model, data = compiled(_xml(network))
    rng = np.random.default_rng([seed, 0])
    free = network.free
    settled(model, data, seconds=3.0, step_s=1e-3 * min(1.0, scale.oscillation), kept=0.99)
    bodies = np.array([model.body(network.names[i]).id for i in free])

    def poke() -> Floats:
        turn, forces = float(rng.uniform(0.0, 2.0 * np.pi)), np.zeros((len(free), 3))
        node = network.index(str(rng.choice(OUTER)))
        strength = POKE_M_S2 * rng.uniform(0.3, 1.0) * network.masses[node]
        forces[free == node] = strength * np.array([np.cos(turn), 0.0, np.sin(turn)])
        return forces

    times = np.arange(round(FRAMES_PER_S * seconds)) / FRAMES_PER_S
    step_s = 5e-4 * min(1.0, scale.oscillation)
    act = pushing(bodies, pushes(rng, seconds, poke, first=(0.3, 1.0), lasts=(0.1, 0.5), pause=(0.5, 1.5)))
    seen = motion(model, data, lambda d: d.xpos[bodies][:, [0, 2]], times_s=times, longest_s=step_s, act=act)
    places = np.tile(network.positions, (len(times), 1, 1))
    places[:, free] = seen
    return Body(network, times, places, OUTER, MARK_SD_M * scale.size, at_rest=True)


def _xml(network: MassSpringNetwork) -> str:
    """MuJoCo model: masses on slides in a plane, springs and dashpots as tendons."""
    size = 0.01 * float(np.ptp(network.positions))
    bodies, tendons = "", ""
    for i, name in enumerate(network.names):
        x, z = network.positions[i]
        slides = "".join(
            f'<joint type="slide" axis="{axis}" damping="{network.drag[i]}" frictionloss="{network.friction[i]}"/>'
            for axis in ("1 0 0", "0 0 1")
        )
        bodies += (
            f'<body name="{name}" pos="{x} 0 {z}">{"" if network.fixed[i] else slides}'
            f'<geom type="sphere" size="{size}" mass="{network.masses[i]}"/><site name="{name}"/></body>'
        )
    for s, (a, b) in enumerate(network.springs):
        tendons += (
            f'<spatial stiffness="{network.stiffness[s]}" damping="{network.damping[s]}"'
            f' springlength="{network.rest_lengths[s]}"><site site="{network.names[a]}"/>'
            f'<site site="{network.names[b]}"/></spatial>'
        )
    return f"""<mujoco><option integrator="RK4" gravity="0 0 -{GRAVITY_M_S2}"/>
        <default><geom contype="0" conaffinity="0"/></default>
        <worldbody>{bodies}</worldbody><tendon>{tendons}</tendon></mujoco>"""
