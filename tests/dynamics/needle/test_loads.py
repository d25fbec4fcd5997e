"""The needle's forces: who takes them, when the skin gives way, and what they do to energy."""

from dataclasses import replace

import numpy as np
import pytest

from dynamics import (
    NeedleMechanics,
    NeedlePose,
    distributed_force,
    indentation,
    needle_load,
    node_weights,
    straight_insertion,
)
from tests.dynamics.conftest import slope

SLIP = 2e-3


@pytest.fixture(params=[2, 3])
def network(request, tangled):
    return tangled(request.param)


def needle_into(network, **changes):
    """A needle pushed at 20 mm/s towards the middle of a network, in contact with the skin from 0 s on."""
    entry = network.positions.max(axis=0) + 0.05
    pose = straight_insertion(entry, network.positions.mean(axis=0), 0.02)
    return NeedleMechanics(pose, entry, **({"slip_m_s": SLIP} | changes))


@pytest.mark.parametrize("punctured", [False, True])
def test_what_the_tissue_gets_the_needle_gives(network, punctured):
    """Newton's third law, summed over all nodes, anchors included; both sums from the same numbers, so by rounding."""
    rng = np.random.default_rng(1)
    needle = needle_into(network)
    v = 0.05 * rng.normal(size=network.positions.shape)
    load = needle_load(network, needle, 2.0, network.positions, v, punctured=punctured)
    assert np.linalg.norm(load.on_needle) > 0.3
    np.testing.assert_allclose(load.nodes.sum(axis=0), -load.on_needle, rtol=0, atol=1e-13)
    along = needle.pose(2.0).direction
    np.testing.assert_allclose(-load.on_needle, (load.contact + load.cutting + load.friction) * along, atol=1e-13)


def test_the_nodes_share_by_a_gaussian_of_their_distance(network):
    """w_i proportional to exp(-d_i² / 2 reach²), written out; from far off the nearest node takes all."""
    point = network.positions.mean(axis=0) + 0.01
    plain = np.array([np.exp(-np.sum((x - point) ** 2) / (2 * 0.1**2)) for x in network.positions])
    np.testing.assert_allclose(node_weights(network, point, 0.1), plain / plain.sum(), rtol=1e-12)
    far = node_weights(network, np.full(network.dim, 50.0), 0.01)
    assert far.sum() == 1.0
    assert far.max() == 1.0


def test_before_the_puncture_the_skin_pushes_back_like_a_spring(network):
    """Stiffness by what the tip is beyond the entry; nothing before they touch, and less where the skin gives way."""
    needle = needle_into(network, contact_N_m=300.0)
    still = np.zeros_like(network.positions)

    def load(t, x):
        return needle_load(network, needle, t, x, still, punctured=False)

    assert load(-1.0, network.positions).contact == 0.0
    assert load(0.5, network.positions).contact == pytest.approx(300.0 * 0.01, rel=1e-12)
    yielding = network.positions + 0.004 * needle.pose(0.0).direction
    assert load(0.5, yielding).contact == pytest.approx(300.0 * 0.006, rel=1e-12)


def test_the_contact_is_the_slope_of_its_energy(network):
    """Force on the nodes = -d/dx of k dent² / 2, by a five-point rule of 1e-4 m: exact, the energy is quadratic."""
    needle, still = needle_into(network), np.zeros_like(network.positions)

    def energy(x):
        return np.array([0.5 * needle.contact_N_m * float(indentation(network, needle, 1.0, x)) ** 2])

    force = needle_load(network, needle, 1.0, network.positions, still, punctured=False).nodes
    expected = -slope(energy, network.positions, 1e-4)[0].reshape(force.shape)
    np.testing.assert_allclose(force, expected, rtol=0, atol=1e-8)


def test_after_the_puncture_it_cuts_at_the_tip_and_rubs_along_the_shaft(network):
    """At rest tissue and full sliding: f_c s and f_f length s, s = v / sqrt(v² + slip²)."""
    needle = needle_into(network, cutting_N=1.3, friction_N_m=25.0)
    still = np.zeros_like(network.positions)
    load = needle_load(network, needle, 3.0, network.positions, still, punctured=True)
    s = 0.02 / np.sqrt(0.02**2 + SLIP**2)
    assert load.contact == 0.0
    assert load.cutting == pytest.approx(1.3 * s, rel=1e-12)
    assert load.friction == pytest.approx(25.0 * 0.06 * s, rel=1e-12)


def test_drawn_back_it_rubs_the_other_way_and_cuts_nothing(network):
    needle = needle_into(network)
    pose = needle.pose(3.0)
    back = replace(needle, pose=lambda _t: NeedlePose(pose.tip, pose.direction, -pose.speed, pose.inserted_m))
    still = np.zeros_like(network.positions)
    forward, backward = (needle_load(network, n, 3.0, network.positions, still, punctured=True) for n in (needle, back))
    assert backward.cutting == 0.0
    assert backward.friction == pytest.approx(-float(forward.friction), rel=1e-12)


def test_friction_and_cutting_only_take_energy(network):
    """Power to the tissue less power of the needle, sum f.(v_tissue - v_needle), is never above zero: 200 motions."""
    rng = np.random.default_rng(3)
    needle = needle_into(network)
    v = 0.05 * rng.normal(size=(200, *network.positions.shape))
    x = np.broadcast_to(network.positions, v.shape)
    load = needle_load(network, needle, 3.0, x, v, punctured=True)
    pose = needle.pose(3.0)
    power = np.einsum("kid,kid->k", load.nodes, v) + load.on_needle @ (pose.speed * pose.direction)
    assert power.max() < 0.0
    alone = needle_load(network, replace(needle, cutting_N=0.0), 3.0, x, v, punctured=True)
    assert (np.einsum("kid,kid->k", alone.nodes, v) + alone.on_needle @ (pose.speed * pose.direction)).max() < 0.0


@pytest.mark.parametrize("punctured", [False, True])
def test_a_measured_push_lands_where_the_model_says(network, punctured):
    """The model's own push in full sliding, handed over as a number: the same force on every free node."""
    needle = needle_into(network)
    still = np.zeros_like(network.positions)
    load = needle_load(network, needle, 2.0, network.positions, still, punctured=punctured)
    reported = distributed_force(network, needle, 2.0, float(np.linalg.norm(load.on_needle)), punctured=punctured)
    np.testing.assert_allclose(reported, load.nodes[network.free], rtol=0, atol=1e-13)


@pytest.mark.parametrize("key", ["radius_m", "puncture_N", "contact_N_m", "reach_m", "slip_m_s", "cutting_N"])
def test_no_needle_with_such_numbers(key):
    with pytest.raises(ValueError, match=f"needle {key}: expected"):
        NeedleMechanics(lambda _t: None, np.zeros(2), **{key: -1.0})


def test_it_stands_at_its_depth_and_needs_a_way_to_go():
    pose = straight_insertion([0.0, 0.3], [0.0, 0.1], 0.02, start_s=1.0, depth_m=0.05)
    np.testing.assert_allclose(pose(0.0).tip, [0.0, 0.32])
    assert pose(0.0).inserted_m == 0.0
    np.testing.assert_allclose(pose(2.0).tip, [0.0, 0.28])
    assert (pose(2.0).speed, pose(2.0).inserted_m) == (0.02, pytest.approx(0.02))
    np.testing.assert_allclose(pose(9.0).tip, [0.0, 0.25])
    assert (pose(9.0).speed, pose(9.0).inserted_m) == (0.0, 0.05)
    with pytest.raises(ValueError, match="towards: expected"):
        straight_insertion([0.0, 0.3], [0.0, 0.3], 0.02)
