"""Outliers as hypotheses: the compiled choice against all subsets, and marks that are something else in every frame."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from dynamics import HIDDEN, OUTER
from estimators import MarkMeasurement, Status, TissueFilter, normalised_error_squared
from estimators.core import track
from estimators.core.innovations import Outliers, inverse_roots
from estimators.core.kernels import without_outliers
from experiments.simulation.bodies.zoo import make_body
from tests.estimators.conftest import driven, followed, marks_of, poke_forces

HZ, NOISE_M = 1.0 / 30.0, 1e-3
FAR = 1e6


def log_density(y, S, ends, logs, out):
    """Of innovations of which these blocks are outliers: that of the rest, and theirs of their own."""
    blocks = np.split(np.arange(len(y)), ends[:-1])
    kept = np.concatenate([block for k, block in enumerate(blocks) if k not in out] or [[]]).astype(int)
    rest = multivariate_normal.logpdf(y[kept], np.zeros(len(kept)), S[np.ix_(kept, kept)]) if len(kept) else 0.0
    return float(rest + sum(logs[k] for k in out))


def found_of(y, S, ends, logs):
    """What the compiled choice is of one hypothesis, and the log-density of all."""
    y, S = y[None].copy(), S[None].copy()
    out, added = without_outliers(y, S, inverse_roots(S), ends, logs, FAR)
    whole = multivariate_normal.logpdf(y[0], np.zeros(y.shape[1]), S[0]) + added[0]
    return {int(k) for k in np.flatnonzero(out[0])}, float(whole)


@pytest.mark.parametrize("n_off", [0, 1, 2])
@pytest.mark.parametrize("sizes", [(2, 2, 2, 2), (3, 3, 3), (2, 3, 1, 2)])
def test_the_choice_is_the_best_of_all_subsets(sizes, n_off):
    """Where none or one block is off; of two the density is that of the blocks that were chosen."""
    ends, n = np.cumsum(sizes), sum(sizes)
    for seed in range(20):
        rng = np.random.default_rng(seed)
        A = rng.normal(size=(n, n))
        S = A @ A.T + np.eye(n)
        y = np.linalg.cholesky(S) @ rng.normal(size=n)
        off = set(rng.choice(len(sizes), n_off, replace=False).tolist())
        for k in off:
            y[ends[k] - sizes[k] : ends[k]] += 40.0
        logs = np.full(len(sizes), -14.0) - np.array(sizes)
        chosen, density = found_of(y, S, ends, logs)
        assert density == pytest.approx(log_density(y, S, ends, logs, chosen), abs=1e-4)
        subsets = [set(some) for r in range(len(sizes) + 1) for some in combinations(range(len(sizes)), r)]
        best = max(subsets, key=lambda some: log_density(y, S, ends, logs, some))
        if n_off < 2:
            assert chosen == best


def test_a_block_goes_where_its_own_density_is_more_than_its_gaussian_one():
    """One block by itself, its Gaussian of variance S: the odds turn where both densities are equal."""
    for sd in (0.1, 1.0, 30.0):
        edge = sd * np.sqrt(2.0 * (14.0 - np.log(sd) - 0.5 * np.log(2.0 * np.pi)))
        for share, out in ((0.99, set()), (1.01, {0})):
            found = found_of(np.array([share * edge]), np.array([[sd**2]]), np.array([1]), np.array([-14.0]))
            assert found[0] == out


def test_blocks_that_are_never_outliers_stay():
    y, S, ends = np.array([50.0, 50.0, 0.0, 0.0]), np.eye(4), np.array([2, 4])
    assert found_of(y, S, ends, np.array([-np.inf, -14.0]))[0] == set()
    assert found_of(y, S, ends, np.array([-14.0, -14.0]))[0] == {0}


def test_an_outlier_is_anywhere_within_reach():
    """Uniform over a square of 0.4 m with odds of 1 to 10^6: log-density in closed form; other names never are."""
    logs = Outliers(frozenset({"a"}), 1e-6, 0.4).log_densities(("a", "b"), (slice(0, 2), slice(2, 4)))
    assert logs.tolist() == [pytest.approx(np.log(1e-6 / 0.16)), -np.inf]


@pytest.fixture(scope="module")
def poked(phantom, rest_state):
    """1.3 s of the phantom under pokes on one node at a time, all free nodes by name."""
    states = driven(phantom, rest_state, poke_forces(phantom, 1.3, np.random.default_rng(3)))[::4]
    places = np.tile(phantom.positions, (len(states), 1, 1))
    places[:, phantom.free] = states[:, :8].reshape(len(states), 4, 2)
    return places


@pytest.mark.parametrize("body", ["phantom", "block27"])
def test_a_fifth_of_the_marks_is_something_else_in_every_frame(phantom, poked, body):
    """By 50 mm, one standard deviation, different marks each time: next to nothing is TRACKING far off."""
    network, marked, hidden, places = phantom, OUTER, HIDDEN, poked
    if body == "block27":
        made = make_body("block27", 700, seconds=0.8)
        network, marked, hidden, places = made.network, made.marked, made.hidden[0], made.positions[:24]
    rng, truth, dim = np.random.default_rng(0), places[:, network.index(hidden)], network.dim
    frames, n_off = [], 0
    for k, at in enumerate(places):
        wrong = rng.random(len(marked)) < 0.2
        seen = at[[network.index(name) for name in marked]] + NOISE_M * rng.normal(size=(len(marked), dim))
        seen[wrong] += 0.05 * rng.normal(size=(wrong.sum(), dim))
        cov = NOISE_M**2 * np.eye(dim)
        frames.append((k * HZ, [MarkMeasurement(name, z, cov) for name, z in zip(marked, seen, strict=True)]))
        n_off += wrong.sum()
    unified = TissueFilter(network, hidden, marked)
    found = followed(unified, frames)
    nees = normalised_error_squared([one.mean for one in found] - truth, [one.cov for one in found])
    assert n_off > 20
    assert unified.rejected.total() > 0.5 * n_off
    tracked = np.array([one.status is Status.TRACKING for one in found])
    errors = np.linalg.norm([one.mean - at for one, at in zip(found, truth, strict=True)], axis=1)
    assert tracked[15:].mean() > 0.9
    # of three marks two are something else in every tenth frame, which cannot always be seen
    assert (tracked & (nees > 25.0)).mean() <= (0.1 if body == "phantom" else 0.0)
    assert errors[15:].max() < (0.03 if body == "phantom" else 5e-3)


def test_all_marks_together_are_no_outliers(phantom, rest_state):
    """A body that is pulled aside by 8 mm between two frames: three outliers are less probable than one led body."""
    unified = TissueFilter(phantom, HIDDEN, OUTER)
    followed(unified, [(k * HZ, marks_of(phantom, rest_state)) for k in range(15)])
    unified.predict(15 * HZ)
    moved = [replace(mark, position=mark.position + np.array([8e-3, 0.0])) for mark in marks_of(phantom, rest_state)]
    assert unified.update(moved).marks_used == 3


def test_outliers_leave_the_covariance_as_it_was(phantom, rest_state):
    """Where a state is more uncertain than any place within reach: positive definite, and no smaller."""
    unified = TissueFilter(phantom, HIDDEN, OUTER)
    unified.predict(0.0)
    own = np.arange(unified.process.n)[unified.process.parts["position"]]
    unified.filter.covs[:, own, own] += 1e6
    before = unified.filter.covs.copy()
    assert unified.update(marks_of(phantom, rest_state)).marks_used == 0
    assert unified.filter.outlying.all()
    found = unified.filter.found
    assert found.outlying.all()
    np.testing.assert_array_equal(unified.filter.covs, before)


@pytest.fixture
def resting(phantom, rest_state):
    """A filter after half a second of marks of these nodes at rest, and these marks."""

    def made(nodes):
        unified, near = TissueFilter(phantom, HIDDEN, OUTER), marks_of(phantom, rest_state, nodes=nodes)
        found = followed(unified, [(k * HZ, near) for k in range(15)])
        assert {one.marks_used for one in found} == {len(nodes)}
        return unified, near

    return made


def after(unified, marks, n_frames):
    return followed(unified, [(k * HZ, marks) for k in range(15, 15 + n_frames)])


def test_the_mark_of_a_single_node_far_off_is_an_outlier_until_it_stays_there(resting):
    """0.2 m off: something else at first, a body that is led within a second; less sure than before."""
    unified, near = resting([OUTER[0]])
    before = unified.place_of(unified.target)[1]
    found = after(unified, [replace(mark, position=mark.position + 0.15) for mark in near], 30)
    assert (found[0].marks_used, found[0].status) == (0, Status.COASTING)
    assert 2 <= unified.rejected[OUTER[0]] <= 10
    assert found[-1].marks_used == 1
    assert np.trace(found[-1].cov) > 100.0 * np.trace(before)


def test_a_restart_may_use_other_marks_than_the_frame_that_led_to_it(resting, monkeypatch):
    """All marks far off, one of them elsewhere: shares are of the marks that the restart uses."""
    monkeypatch.setattr(track, "REFUTED_S", 0.05)
    unified, near = resting(OUTER)
    shifts = ([0.12, 0.0], [0.12, 0.0], [-0.3, 0.3])
    far = [replace(mark, position=mark.position + np.array(by)) for mark, by in zip(near, shifts, strict=True)]
    found = after(unified, far, 3)
    assert unified.repairs["restarted"] == 1
    assert Status.DIVERGED in {one.status for one in found}
    assert [len(one.information_share) for one in found] == [one.marks_used for one in found]
