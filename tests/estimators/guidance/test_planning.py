"""Plans: the push that is foreseen, what is rejected and why, and that the best is the best."""

import numpy as np
import pytest

from dynamics import HIDDEN, NeedleMechanics, NeedlePose, needle_load, rest_shape
from estimators import (
    GaussianMixture,
    Hit,
    Lesion,
    Obstacle,
    PlannedNeedle,
    PlannedTarget,
    Skin,
    ball,
    candidate_paths,
    compliance,
    hit_probability,
    needle_displacement,
    plan,
)
from estimators import Needle as Sampler
from tests.networks import build_network

SKIN = Skin([-0.2, 0.33], [0.2, 0.33], [0.0, 1.0], np.radians(60.0), 0.25)
SOFT = PlannedNeedle(cutting_N=0.2, friction_N_m=3.0)


@pytest.fixture
def lesion(phantom):
    return PlannedTarget(phantom.positions[phantom.index(HIDDEN)], np.diag([4e-6, 9e-6]), 0.005)


def planned(phantom, lesion, needle=SOFT, skin=SKIN, obstacles=(), n=40):
    entries, tips = candidate_paths(phantom, HIDDEN, lesion, needle, skin.entries(n), 5)
    return plan(phantom, HIDDEN, lesion, needle, skin, obstacles, entries=entries, tips=tips)


def test_the_push_that_is_foreseen_is_the_equilibrium_under_the_needle(phantom, lesion):
    """`rest_shape` under the forces of `needle_load` in full sliding: 5 % for what the linear answer leaves out."""
    entry = np.array([[0.1, 0.33]])
    tip = lesion.mean[None]
    length = float(np.linalg.norm(tip - entry))
    direction = (tip - entry)[0] / length
    moved = NeedleMechanics(
        lambda _t: NeedlePose(tip[0], direction, 1.0, length), entry[0], cutting_N=0.2, friction_N_m=3.0
    )
    still = np.zeros_like(phantom.positions)
    load = needle_load(phantom, moved, 0.0, phantom.positions, still, punctured=True)
    exact = rest_shape(phantom, load.nodes[phantom.free])[phantom.index(HIDDEN)] - lesion.mean
    found = needle_displacement(phantom, compliance(phantom, HIDDEN), SOFT, tip, entry)[0]
    assert np.linalg.norm(exact) > 1e-3
    np.testing.assert_allclose(found, exact, rtol=0, atol=0.05 * np.linalg.norm(exact))


def test_each_path_aims_where_its_own_push_moves_the_target(phantom, lesion):
    """The middle one of each five ends within 10 µm of the displaced mean: the aiming has settled."""
    found = planned(phantom, lesion, PlannedNeedle())
    off = np.linalg.norm(found.tips - found.means, axis=1)
    assert off[2::5].max() < 1e-5
    beside = np.linalg.norm(found.tips[0::5] - found.tips[2::5], axis=1)
    np.testing.assert_allclose(beside, 0.6 * lesion.radius_m, rtol=1e-9)
    assert np.linalg.norm(found.pushed, axis=1).min() > 5e-3


def test_a_single_aim_is_the_centre(phantom, lesion):
    """The middle one of five aims from each entry."""
    of_five, of_one = (candidate_paths(phantom, HIDDEN, lesion, SOFT, SKIN.entries(3), n)[1] for n in (5, 1))
    np.testing.assert_allclose(of_one, of_five[2::5], rtol=0, atol=1e-12)


def test_the_probability_is_what_draws_say(phantom, lesion):
    """The best path: target, tip and one factor on all forces drawn 200,000 times; four standard errors, 0.005."""
    needle = PlannedNeedle()
    found = planned(phantom, lesion, needle)
    best, rng, n = found.best, np.random.default_rng(0), 200_000
    factor = 1.0 + needle.force_sd * rng.normal(size=(n, 1))
    target = rng.multivariate_normal(lesion.mean, lesion.cov, n) + factor * found.pushed[best]
    tip = found.tips[best] + needle.tip_sd_m * rng.normal(size=(n, 2))
    hit = (np.linalg.norm(tip - target, axis=1) <= lesion.radius_m).mean()
    assert found.hits[best] == pytest.approx(hit, abs=0.005)


def test_the_order_is_that_of_the_hits_among_the_allowed(phantom, lesion):
    found = planned(phantom, lesion, obstacles=[ball("vessel", [0.05, 0.27], 0.01, 0.003)])
    n = int(found.allowed.sum())
    assert 0 < n < len(found.hits)
    assert found.best == found.order[0]
    assert found.allowed[found.order[:n]].all()
    assert (np.diff(np.round(found.hits[found.order[:n]], 3)) <= 0.0).all()
    assert sorted(found.order) == list(range(len(found.hits)))
    disc, tip = Lesion.ball(lesion.radius_m, 2), Sampler(hit=Hit.TIP)
    again = [
        hit_probability(
            GaussianMixture.gaussian(mean, cov), GaussianMixture.gaussian(at, np.zeros((2, 2))), at, disc, needle=tip
        )
        for mean, cov, at in zip(found.means, found.covs, found.tips, strict=True)
    ]
    np.testing.assert_allclose(found.hits, again, rtol=0, atol=1e-12)


def test_every_rejection_has_its_reason(phantom, lesion):
    """One path with nothing against it, and one for each reason, written down."""
    skin = Skin([-0.2, 0.33], [0.2, 0.33], [0.0, 2.0], np.radians(40.0), 0.17)
    rib = Obstacle("rib 5", [0.02, 0.26], [0.06, 0.26], 0.004, 0.001)
    vessel = ball("vessel", [0.022, 0.24], 0.004, 0.001)
    goal = lesion.mean
    entries = np.array([[0.0, 0.33], [0.06, 0.33], [0.0, 0.34], [0.2, 0.33]])
    found = plan(phantom, HIDDEN, lesion, SOFT, skin, [rib, vessel], entries=entries, tips=np.tile(goal, (4, 1)))
    assert found.reasons == ((), ("rib 5", "vessel"), ("outside the entry",), ("too long", "too steep"))
    assert found.best == 0
    wall = Obstacle("wall", [-0.5, 0.3], [0.5, 0.3], 0.001)
    shut = plan(phantom, HIDDEN, lesion, SOFT, skin, [wall], entries=entries, tips=np.tile(goal, (4, 1)))
    assert shut.best is None


def test_in_space_it_plans_as_well():
    """A cube of springs: a way from the top through a hole of a grid of entries, and aims all around the centre."""
    corners = 0.1 * np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)], dtype=float)
    x = np.vstack([corners, np.zeros(3)])
    constants = {"masses": 0.1, "drag": 0.1, "stiffness": 200.0, "damping": 0.1}
    names = (*(f"C{i}" for i in range(8)), "T")
    cube = build_network(x, [(i, 8) for i in range(8)], range(8), names, **constants)
    skin = Skin([-0.05, -0.05, 0.1], [0.05, 0.05, 0.1], [0.0, 0.0, 1.0])
    lesion = PlannedTarget(np.zeros(3), 1e-6 * np.eye(3), 0.005)
    entries = skin.entries(25)
    assert entries.shape == (25, 3)
    from_, tips = candidate_paths(cube, "T", lesion, SOFT, entries, 5)
    found = plan(cube, "T", lesion, SOFT, skin, (), entries=from_, tips=tips)
    assert found.hits[2::5].min() > 0.95
    assert (found.hits[2::5] >= found.hits[0::5]).all()
    np.testing.assert_allclose(
        np.linalg.norm(found.tips - found.tips[2::5].repeat(5, axis=0), axis=1).reshape(-1, 5),
        np.tile(np.abs(np.linspace(-0.003, 0.003, 5)), (25, 1)),
        atol=1e-12,
    )
