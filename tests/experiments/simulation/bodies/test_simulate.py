"""Frames of a MuJoCo model are of their own times, and forces act when they are set."""

import numpy as np
import pytest

from experiments.simulation.bodies.simulate import compiled, motion, settled

SLIDE = """<mujoco><option gravity="0 0 0"/><worldbody><body>
    <joint type="slide" axis="1 0 0" stiffness="{stiffness}"/><geom type="sphere" size="0.01" mass="2"/>
    </body></worldbody></mujoco>"""
TIMES = np.arange(4) / 10.0


def test_a_free_mass_is_where_its_speed_brings_it():
    model, data = compiled(SLIDE.format(stiffness=0))
    data.qvel[:] = 3.0
    seen = motion(model, data, lambda d: d.xpos[1, :1], times_s=TIMES, longest_s=0.03)
    assert seen[:, 0] == pytest.approx(3.0 * TIMES, abs=1e-12)
    assert model.opt.timestep == pytest.approx(0.025)


def test_a_force_acts_from_its_time_on():
    """A force of 4 N on 2 kg from 0.1 s on: a speed of 0.2 m/s and of 0.4 m/s in the frames after."""
    model, data = compiled(SLIDE.format(stiffness=0))

    def act(time_s, data):
        data.xfrc_applied[1, 0] = 4.0 if time_s >= 0.1 - 1e-9 else 0.0

    seen = motion(model, data, lambda d: d.qvel, times_s=TIMES, longest_s=0.01, act=act)
    assert seen[:, 0] == pytest.approx([0.0, 0.0, 0.2, 0.4], abs=1e-9)


def test_a_settled_spring_is_at_rest():
    model, data = compiled(SLIDE.format(stiffness=50))
    data.qpos[:] = 0.1
    settled(model, data, seconds=6.0, step_s=0.01, kept=0.9)
    assert abs(data.xpos[1, 0]) < 1e-6
    assert data.qvel[0] == 0.0
