"""Insertions with the loop closed: figures, their repetition, and what the command writes."""

from dataclasses import replace

import numpy as np
import pytest

from dynamics import HIDDEN, sliding_friction
from estimators import compliance, normalised_error_squared
from experiments.formats.needle_file import NeedleForces
from experiments.formats.scenario import read_scenario
from experiments.simulation.cases import case_of, settings_for
from experiments.simulation.closed_loop import Tried
from experiments.simulation.insert import figures, insert, one_run
from experiments.simulation.policies import Ahead, force_error_cov, predicted_parts, warmed
from experiments.simulation.world import needle_with, world_of

FRAME_S = 1.0 / 30.0

STATED, FORCE_ERROR = NeedleForces().constants(), NeedleForces().error


def case(name):
    return case_of(read_scenario(name))


POKED = replace(case("poked"), advice=False, seed=30004)


@pytest.fixture(scope="module")
def poked():
    return insert(POKED, 1)


def test_looking_ahead_and_waiting_hits_more_than_the_paper_s_loop(poked):
    """One world, the same for all: a hit, and a miss of the open loop."""
    ours, paper = (sum(one.hit for one in poked.of(policy)) for policy in ("wait-for-go", "open-loop"))
    assert (ours, paper) == (1, 0)


def test_a_miss_is_judged_by_the_truth(poked):
    """A hit is a tip within 5 mm; whoever looks ahead comes nearer on average than whoever does not look."""
    tried = [one for run in poked.runs for one in run]
    assert all(one.hit == (one.miss_m is not None and one.miss_m <= 0.005) for one in tried)
    assert {one.probability is None for one in poked.of("rest") + poked.of("open-loop")} == {True}
    assert all(0.0 <= one.probability <= 1.0 for one in poked.of("filter-ahead"))
    ahead, rest = (np.mean([one.miss_m for one in poked.of(policy)]) for policy in ("filter-ahead", "rest"))
    assert ahead < 0.7 * rest


def test_a_world_is_its_seed(poked):
    assert one_run(POKED) == (poked.runs[0], ())


def test_figures_of_those_that_hit_missed_and_never_came():
    """Two hits, a miss, and one that never arrived after three insertions; the interval of 2 in 4 by R's binom.test."""
    came = [(True, 1e-3, 0.5, 1), (True, 2e-3, 1.5, 2), (False, 9e-3, 0.5, 1)]
    tried = [Tried("x", *one, 0.9, 0.9, 1e-3) for one in came]
    tried.append(Tried("x", False, None, 10.0, 3, None, None, 1e-3))
    said = figures(tried)
    assert said["hit_rate"] == 0.5
    assert (said["hit_rate_low"], said["hit_rate_high"]) == pytest.approx((0.06758599, 0.93241401))
    assert (said["miss_mm"], said["seconds_to_hit"]) == pytest.approx((4.0, 1.0))
    assert (said["insertions"], said["retractions"], said["never"]) == (1.75, 1.0, 1)


def test_a_needle_s_density_of_a_breathing_target_has_the_errors_of_its_breath():
    """0.4 s ahead, every third of 36 frames, one seed of unknown period: the breath's part has most of the weight.

    Its mean error is at most 1.5 times the filter's own error now, its mean NEES 0.5 to 6 of 2. Errors last for a
    breath: a run is hardly more than one sample of them.
    """
    world = world_of(replace(case("breathing"), seed=5002, frames_per_s=15.0, patience_s=3.0))
    state, _, warm = warmed(world)
    policy = Ahead(world, warm)
    nothing, truth, now, said = np.zeros((2, len(world.network.free), 2)), [], [], []
    first = round(world.case.warm_s * 15)
    for k in range(first, first + 36):
        policy.see(world.frame_s(k), world.marks(k, state), None)
        truth.append(world.target(state))
        now.append(np.linalg.norm(policy.estimate.mean - truth[-1]))
        if (k - first) % 3 == 0:
            said.append(policy.density_at(world.frame_s(k + 6), nothing))
        state = world.untouched(state, k)
    assert np.std(truth, axis=0).max() > 7e-3
    assert np.mean([one.weights[0] for one in said]) > 0.9
    there = np.array(truth[6::3])
    errors = there - np.array([one.means[0] for one in said[: len(there)]])
    assert np.linalg.norm(errors, axis=1).mean() < 1.5 * np.mean(now)
    assert np.mean(now) < 3e-3
    nees = normalised_error_squared(errors, np.array([one.covs[0] for one in said[: len(there)]])).mean()
    assert 0.5 < nees < 6.0


@pytest.mark.parametrize(("name", "poke"), [("poked", 3.4), ("quiet", 3.4), ("shoved", 5.0), ("breathing", 5.0)])
def test_pokes_are_as_strong_as_the_scenario_lets_masses_be_pushed(name, poke):
    """One at a time, or all together."""
    assert settings_for(read_scenario(name)).poked.poke == poke


def test_pokes_are_assumed_as_strong_as_the_scenario_has_them():
    """Root mean square on a coordinate of drawn half sines in random directions while they last, to 3 %.

    20,000 pokes, a mean over their time; a standard error of 0.5 %.
    """
    pokes, rng = read_scenario("poked").pokes, np.random.default_rng(0)
    peak = pokes.acceleration_m_s2 * rng.uniform(pokes.weakest, 1.0, 20_000)
    angle, phase = rng.uniform(0.0, 2.0 * np.pi, 20_000), rng.uniform(0.0, np.pi, 20_000)
    drawn = np.sqrt(np.mean((peak * np.sin(phase) * np.cos(angle)) ** 2))
    assert settings_for(read_scenario("poked")).poked.poke == pytest.approx(drawn, rel=0.03)


def test_wrong_forces_of_the_needle_move_the_target_as_much_as_is_reported():
    """Covariance of its linear shift under 4,000 needles, each constant off by itself, to 6 % of its largest entry.

    The drawn variance of a uniform factor has a standard error of 1.4 %. One factor for all would be 55 % too much.
    """
    world, rng = world_of(case("poked")), np.random.default_rng(3)
    axis, gives = np.array([-0.6, -0.8]), compliance(world.network, HIDDEN)
    depth = np.array([0.02 + 0.05 * 0.5 / 30.0])
    tip = world.entry + depth[:, None] * axis + 0.001 * np.array([0.8, -0.6])
    shifts = []
    for _ in range(4000):
        true = {key: STATED[key] * rng.uniform(1.0 - FORCE_ERROR, 1.0 + FORCE_ERROR) for key in STATED}
        needle = needle_with(world.network, world.entry, true)
        shifts.append(gives @ sliding_friction(world.network, needle, tip, axis, depth).ravel())
    drawn, parts = np.cov(np.array(shifts).T), predicted_parts(world, axis, 0.02, np.array([0.001]), 0.05, 1, FRAME_S)
    reported = force_error_cov(gives, parts[:, 0], FORCE_ERROR)
    assert np.abs(reported - drawn).max() < 0.06 * np.abs(drawn).max()


def test_a_needle_drawn_back_cuts_nothing():
    """Forward, the sum of both parts is the force of a needle with all its constants; back, friction turned round."""
    world, axis = world_of(case("poked")), np.array([0.0, -1.0])
    depths = 0.02 + 0.05 * np.array([0.5, 1.5, 2.5]) / 30.0
    tips = world.entry + depths[:, None] * axis
    whole = sliding_friction(world.network, needle_with(world.network, world.entry, STATED), tips, axis, depths)
    assert predicted_parts(world, axis, 0.02, np.zeros(1), 0.05, 3, FRAME_S).sum(axis=0) == pytest.approx(whole)
    cutting, friction = predicted_parts(world, axis, 0.02, np.zeros(1), -0.05, 3, FRAME_S)
    assert not cutting.any()
    assert np.all(friction @ axis < 0.0)
