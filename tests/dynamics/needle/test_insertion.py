"""The tissue under a needle in time: closed form, order of convergence, and when the skin gives way."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dynamics import NeedleMechanics, force_on_free, forced_states, motion, pack, simulate_insertion, straight_insertion


@pytest.fixture
def one_mass(build):
    """A mass of 0.2 kg between two springs of 80 N/m on a line, with dashpots that bring it to rest within a second."""
    return build([[0.0, 0.0], [0.2, 0.0], [0.4, 0.0]], [(0, 1), (1, 2)], anchors=(0, 2), damping=2.0)


def at_rest(network):
    places = network.positions[network.free]
    return pack(places, np.zeros_like(places))


def test_a_mass_pushed_slowly_goes_as_far_as_force_by_stiffness(one_mass):
    """It goes F / k with k = 2 80 N/m, once the needle stands; the kernel so narrow that the mass takes all.

    The contact is a spring k_c in series: tip - x = F / k_c, so F = tip / (1 / k + 1 / k_c). Friction-free and damped
    at 2 c / 2 m = 10 /s, so after 2 s exp(-20) is left; the integrator's tolerance is what remains.
    """
    entry = np.array([0.2, 0.0])
    pose = straight_insertion(entry, [0.4, 0.0], 0.02, depth_m=0.005)
    done = simulate_insertion(
        one_mass, NeedleMechanics(pose, entry, contact_N_m=400.0, reach_m=0.01), at_rest(one_mass), [0.0, 2.25]
    )
    force = 0.005 / (1.0 / 160.0 + 1.0 / 400.0)
    assert done.punctured_s is None
    assert done.axial_forces[-1] == pytest.approx(force, rel=1e-6)
    assert done.states[-1, 0] - 0.2 == pytest.approx(force / 160.0, rel=1e-6)


def test_the_skin_gives_way_when_the_contact_reaches_the_puncture_force(one_mass):
    """Pushed on for ever: 0.5 N are there when 160 N/m and 400 N/m in series are pressed together by 4.375 mm.

    At 2 mm/s that is after 2.1875 s; the moving mass drags 4 N s/m 2 mm/s = 8 mN behind, 30 ms at most. Then the tip
    cuts and the shaft rubs in nearly full sliding; the mass creeps by 0.06 mm/s, 0.03 % of s.
    """
    entry = np.array([0.2, 0.0])
    forces = {"puncture_N": 0.5, "cutting_N": 0.2, "friction_N_m": 5.0}
    needle = NeedleMechanics(straight_insertion(entry, [0.4, 0.0], 0.002), entry, reach_m=0.01, slip_m_s=2e-4, **forces)
    times = np.linspace(0.0, 2.9, 291)
    done = simulate_insertion(one_mass, needle, at_rest(one_mass), times)
    assert done.punctured_s == pytest.approx(2.1875, abs=0.03)
    before = done.axial_forces[~done.punctured]
    assert before.max() == pytest.approx(0.5, abs=0.003)
    assert (np.diff(before[50:]) > 0.0).all()  # after the first touch has died away
    after = done.axial_forces[done.punctured][50:]
    sliding = 0.002 / np.sqrt(0.002**2 + 2e-4**2)
    np.testing.assert_allclose(after, sliding * (0.2 + 5.0 * 0.002 * times[done.punctured][50:]), rtol=0.002)


@pytest.mark.parametrize("punctured", [False, True])
def test_fourth_order_where_nothing_jumps(phantom, punctured):
    """Runge-Kutta with the needle's force against DOP853 at 1e-12: halving the step divides the error by 2^4.

    Node friction off, whose slip of 5 mm/s no step here resolves; the needle at 0.2 m/s slides all the time and, before
    the puncture, is in contact all the time.
    """
    network = replace(phantom, friction=np.zeros(phantom.n_nodes))
    entry = np.array([0.02, 0.45])
    pose = straight_insertion(entry, [0.0, 0.2], 0.2, start_s=-0.1)
    needle = NeedleMechanics(pose, entry, contact_N_m=100.0, slip_m_s=0.1, friction_N_m=5.0)
    force, rate = force_on_free(network, needle, punctured=punctured), motion(network)
    start = at_rest(network)
    reported = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-14}
    exact = solve_ivp(lambda t, y: rate(y, force(t, y)), (0.0, 0.1), start, **reported).y[:, -1]
    errors = [np.abs(forced_states(network, start, force, [0.0, 0.1], n)[-1] - exact).max() for n in (80, 160)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.1)
