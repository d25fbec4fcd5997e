"""Springs turned by more than a right angle against the first state of a set, and nothing else."""

import numpy as np
import pytest

from dynamics import four_mass_phantom, pack
from dynamics.equilibrium.reversal import inverted_springs

PHANTOM = four_mass_phantom()
REST = PHANTOM.positions[PHANTOM.free]


def states(*positions):
    return np.array([[pack(p, np.zeros_like(p)) for p in (REST, *positions)]])


def test_a_shape_moved_turned_a_little_and_stretched_has_none_turned():
    spin = np.radians(30.0)
    turn = np.array([[np.cos(spin), -np.sin(spin)], [np.sin(spin), np.cos(spin)]])
    assert not inverted_springs(PHANTOM, states(REST + 0.01, (REST - REST[1]) @ turn.T + REST[1], 1.2 * REST))[0]


@pytest.mark.parametrize(("degrees", "found"), [(89.0, False), (91.0, True)])
def test_a_right_angle_is_the_limit(degrees, found):
    """M3 turned about M2 by the angle: the spring M2-M3 turns by it, those to M1 and M4 by less than a right angle."""
    moved = REST.copy()
    angle = np.radians(90.0 + degrees)
    moved[2] = REST[1] + 0.19 * np.array([np.cos(angle), np.sin(angle)])
    moved[0] = [-10.0, REST[0, 1]]  # far off, so that its springs do not turn
    assert inverted_springs(PHANTOM, states(moved))[0] == found


def test_springs_to_anchors_count():
    moved = REST.copy()
    moved[0, 1] = -0.1  # below In1, which stands at 0
    assert inverted_springs(PHANTOM, states(moved))[0]


def test_sets_are_distinguished_and_what_follows_the_state_is_not_looked_at():
    two = np.concatenate([states(REST), states(-REST)])
    more = np.concatenate([two, np.full((2, 2, 6), 1e3)], axis=2)
    assert inverted_springs(PHANTOM, more).tolist() == [False, True]
