"""A steered needle's truth against DOP853's, and its forces against those of the needle."""

from itertools import pairwise

import numpy as np
import pytest

from dynamics import (
    HIDDEN,
    NeedleMechanics,
    NeedleMotion,
    NeedlePose,
    SampledForces,
    advance_steered,
    four_mass_phantom,
    integrate_adaptive,
    needle_load,
    pack,
    simulate_insertion,
    sliding_friction,
    straight_insertion,
)
from dynamics.needle.steered import longest_step
from tests.networks import build_network

ENTRY = np.array([0.02, 0.22])
SPEED = 0.05


def drive(towards, depth):
    """The needle from ENTRY towards a point, so deep [m]."""
    u = (towards - ENTRY) / np.linalg.norm(towards - ENTRY)
    return NeedleMotion(ENTRY + depth * u, SPEED * u, u, depth)


def advanced(network, needle, state, motion, outside, between_s, punctured=False):
    return advance_steered(network, needle, state, motion, outside=outside, between_s=between_s, punctured=punctured)


def test_an_insertion_is_that_of_dop853():
    """0.5 s, contact, puncture, cutting and friction, under a force that swings; in one piece or in twenty."""
    network = four_mass_phantom()
    target = network.positions[network.index(HIDDEN)]
    needle = NeedleMechanics(
        straight_insertion(ENTRY, target, SPEED), ENTRY, puncture_N=0.8, cutting_N=0.4, friction_N_m=5.0
    )
    t = np.arange(0.0, 0.51, 1e-3)
    forces = np.zeros((len(t), 4, 2))
    forces[:, 0, 0] = np.sin(8.0 * t)
    free = network.positions[network.free]
    rest = pack(free, np.zeros_like(free))

    def outside(now):
        force = np.zeros((4, 2))
        force[0, 0] = np.interp(now, t, forces[:, 0, 0])
        return force

    exact = simulate_insertion(network, needle, rest, [0.0, 0.5], outside=outside)
    still, _ = advanced(network, needle, rest, drive(target, -1.0), SampledForces(forces, 1e-3), (0.0, 0.5))
    place = network.coordinates(HIDDEN)
    assert np.linalg.norm((exact.states[-1] - still)[place]) > 1e-3
    for pieces in (1, 20):
        state, punctured = rest, False
        for a, b in pairwise(np.linspace(0.0, 0.5, pieces + 1)):
            now, swings = drive(target, SPEED * a), SampledForces(forces, 1e-3)
            state, punctured = advanced(network, needle, state, now, swings, (a, b), punctured)
        assert punctured
        np.testing.assert_allclose(state[:8], exact.states[-1][:8], rtol=0, atol=2e-6)


def test_a_needle_that_slides_pushes_as_its_load_says():
    """`needle_load` of a needle a thousand times as fast as its slip, in tissue at rest: 1e-6."""
    network = four_mass_phantom()
    reported = drive(network.positions[network.index(HIDDEN)], 0.02)
    needle = NeedleMechanics(lambda _t: NeedlePose(reported.tip, reported.direction, 2.0, 0.02), ENTRY)
    still = np.zeros_like(network.positions)
    exact = needle_load(network, needle, 0.0, network.positions, still, punctured=True).nodes[network.free]
    found = sliding_friction(network, needle, reported.tip[None], reported.direction, np.array([0.02]))
    np.testing.assert_allclose(found[0], exact, rtol=1e-6, atol=1e-12)


def test_stiff_links_take_shorter_steps():
    """Two links of 1e5 N/m and masses of 2 g, 0.05 s of falling sideways beside a needle: SciPy's DOP853 to 1 µm."""
    network = build_network(
        [[0.0, 0.0], [0.1, 0.0], [0.2, 0.0]],
        [(0, 1), (1, 2)],
        [0],
        masses=0.002,
        stiffness=1e5,
        damping=2.0,
        gravity=[0.0, -9.81],
    )
    assert longest_step(network) < 1.0 / 1920.0
    assert longest_step(four_mass_phantom()) == 1.0 / 1920.0
    start = pack(network.positions[1:], np.zeros((2, 2)))
    away = NeedleMotion(np.array([0.0, 1.0]), np.zeros(2), np.array([0.0, -1.0]), -1.0)
    still = NeedlePose(away.tip, away.direction, 0.0, 0.0)
    none = SampledForces(np.zeros((2, 2, 2)), 1.0)
    moved, _ = advanced(network, NeedleMechanics(lambda _t: still, away.tip), start, away, none, (0.0, 0.05))
    assert moved[3] < -0.01
    solved = integrate_adaptive(network, start, [0.0, 0.05])[-1]
    np.testing.assert_allclose(moved[:4], solved[:4], rtol=0, atol=1e-6)


def test_time_does_not_go_back():
    network = four_mass_phantom()
    needle = NeedleMechanics(lambda _t: NeedlePose(ENTRY, ENTRY, 0.0, 0.0), ENTRY)
    with pytest.raises(ValueError, match="between_s: expected times that rise"):
        advanced(
            network, needle, np.zeros(16), drive(np.zeros(2), 0.0), SampledForces(np.zeros((2, 4, 2)), 1.0), (1.0, 0.5)
        )
