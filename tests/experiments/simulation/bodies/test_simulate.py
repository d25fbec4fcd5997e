"""Forces on a MuJoCo model act when they are set."""

import numpy as np
import pytest

from experiments.simulation.bodies.simulate import compiled, motion, pushes, pushing

SLIDE = """<mujoco><option gravity="0 0 0"/><worldbody><body>
    <joint type="slide" axis="1 0 0"/><geom type="sphere" size="0.01" mass="2"/>
    </body></worldbody></mujoco>"""


def test_forces_act_from_their_start_to_their_end():
    """4 N on 2 kg from 0.1 to 0.2 s and from 0.4 to 0.5 s: speeds of 0.2 and of 0.4 m/s afterwards."""
    model, data = compiled(SLIDE)
    first, lasts, pause = (0.1, 0.1), (0.1, 0.1), (0.2, 0.2)
    force, rng = np.array([[4.0, 0.0, 0.0]]), np.random.default_rng(0)
    act = pushing(np.array([1]), pushes(rng, 0.6, lambda: force, first=first, lasts=lasts, pause=pause))
    seen = motion(model, data, lambda d: d.qvel, times_s=np.arange(7) / 10.0, longest_s=0.01, act=act)
    assert seen[:, 0] == pytest.approx([0.0, 0.0, 0.2, 0.2, 0.2, 0.4, 0.4], abs=1e-9)
