"""Forces on a MuJoCo model act when they are set."""

import numpy as np
import pytest

from experiments.simulation.bodies.simulate import compiled, motion

SLIDE = """<mujoco><option gravity="0 0 0"/><worldbody><body>
    <joint type="slide" axis="1 0 0"/><geom type="sphere" size="0.01" mass="2"/>
    </body></worldbody></mujoco>"""


def test_a_force_acts_from_its_time_on():
    """A force of 4 N on 2 kg from 0.1 s on: a speed of 0.2 m/s and of 0.4 m/s in the frames after."""
    model, data = compiled(SLIDE)

    def act(time_s, data):
        data.xfrc_applied[1, 0] = 4.0 if time_s >= 0.1 - 1e-9 else 0.0

    seen = motion(model, data, lambda d: d.qvel, times_s=np.arange(4) / 10.0, longest_s=0.01, act=act)
    assert seen[:, 0] == pytest.approx([0.0, 0.0, 0.2, 0.4], abs=1e-9)
