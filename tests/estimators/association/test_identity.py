"""Marks alike whose names are exchanged: noticed and undone, and nothing undone that was right."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER
from estimators import AssociationFilter, Status, TissueFilter
from estimators.association.exchanges import seen_from
from estimators.association.settings import IdentitySettings
from estimators.filters.kernels import ambiguous_exchanges, association_costs
from tests.estimators.conftest import followed as through
from tests.estimators.conftest import poked_frames


@pytest.fixture(scope="module")
def frames():
    """1.3 s at 30 frames/s of the phantom, poked, by DOP853; marks with 4 mm of noise."""
    return poked_frames(1.3, 0.004, 3)[0]


def called(marks, names):
    return [replace(mark, node=names.get(mark.node, mark.node)) for mark in marks]


def means(phantom, frames):
    """Means of a filter with the right names, (n_frames, 2)."""
    return np.array([one.mean for one in through(TissueFilter(phantom, HIDDEN, OUTER), frames)])


@pytest.fixture(scope="module")
def right(phantom, frames):
    return means(phantom, frames)


def followed(phantom, frames, names_at, alike=(OUTER,)):
    """Identity after these frames with names_at(frame) exchanged, and what it made of each."""
    identity = AssociationFilter(TissueFilter(phantom, HIDDEN, OUTER), alike)
    made = []
    for k, (time_s, marks) in enumerate(frames):
        identity.tissue.predict(time_s)
        made.append(identity.update(identity.named(called(marks, names_at(k)))))
    return identity, made


def test_an_exchange_for_ten_frames_is_undone_twice_and_at_once(phantom, frames, right):
    """Marks 280 mm apart seen to 4 mm tell it in the same frame: the filter is that of no exchange to the last bit."""
    identity, made = followed(phantom, frames[:22], lambda k: {"M1": "M3", "M3": "M1"} if 10 <= k < 20 else {})
    swaps = [(one.time_s, one.since_s, set(one.nodes)) for one in identity.swaps]
    assert swaps == [(frames[k][0], frames[k][0], {"M1", "M3"}) for k in (10, 20)]
    assert identity.swaps == [made[10].swap, made[20].swap]
    assert {node: other for node, other in identity.node_of.items() if node != other} == {}
    np.testing.assert_array_equal([one.estimate.mean for one in made], right[:22])
    for (_, marks), one in zip(frames[:22], made, strict=True):
        place = {mark.node: mark.position for mark in one.marks}
        assert all(np.array_equal(place[mark.node], mark.position) for mark in marks)


def test_right_names_stay(phantom, frames, right):
    """Half of the marks lost at random, too: no alternative outlives the start, and the filter is left as it is."""
    rng = np.random.default_rng(0)
    lossy = [(t, [mark for mark in marks if k == 0 or rng.random() < 0.5]) for k, (t, marks) in enumerate(frames)]
    for seen, expected in ((frames[:18], right[:18]), (lossy[:18], means(phantom, lossy[:18]))):
        identity, made = followed(phantom, seen, lambda _k: {})
        assert identity.swaps == []
        assert identity.alternatives == []
        np.testing.assert_array_equal([one.estimate.mean for one in made], expected)


@pytest.mark.parametrize("order", [("M3", "M1", "M4"), ("M4", "M1", "M3")])
def test_names_wrong_from_the_start_are_mended(phantom, frames, right, order):
    """As soon as the filter tracks, 0.1 s after the start. Then it is as if never wrong."""
    wrong = dict(zip(OUTER, order, strict=True))
    identity, made = followed(phantom, frames[:20], lambda _k: wrong)
    assert {wrong[node] for node in OUTER} == set(OUTER)
    assert {reported: identity.node_of[reported] for reported in OUTER} == {wrong[node]: node for node in OUTER}
    assert len(identity.swaps) == 1
    mended = next(k for k, one in enumerate(made) if one.swap is not None)
    fits_none = all(node != other for node, other in wrong.items())
    assert frames[mended][0] <= (0.4 if fits_none else 0.1) + 1e-9
    assert all(one.estimate.status is not Status.TRACKING for one in made[:mended])
    if not fits_none:
        np.testing.assert_array_equal([one.estimate.mean for one in made[mended:]], right[mended:20])
    assert np.linalg.norm(made[-1].estimate.mean - right[19]) < 1e-3


def test_a_start_alone_tells_no_names(phantom, frames):
    """The tissue may be turned: the shape in the first frame makes no names more probable than `decisive`, 1e3 to 1."""
    identity, made = followed(phantom, frames[:1], lambda _k: {"M1": "M4", "M4": "M1"})
    assert made[0].swap is None
    assert sorted(one.names for one in identity.alternatives) == sorted(
        p for p in permutations(range(3)) if p != (0, 1, 2)
    )
    best = max(identity.alternatives, key=lambda one: one.ahead)
    assert best.names == (2, 1, 0)
    assert best.ahead == pytest.approx(IdentitySettings().decisive - IdentitySettings().exchange)


def test_marks_of_different_hues_are_never_tried(phantom, frames):
    """M1 and M3 exchanged, though only M1 and M4 look alike: whatever is made of that, M3 stays M3."""
    identity, made = followed(
        phantom, frames[:16], lambda k: {"M1": "M3", "M3": "M1"} if k >= 10 else {}, alike=[("M1", "M4"), ("M3",)]
    )
    assert identity.interchangeable.nodes == ("M1", "M4")
    assert "M3" not in identity.node_of
    assert all("M3" not in swap.nodes for swap in identity.swaps)
    for k, ((_, marks), one) in enumerate(zip(frames[:16], made, strict=True)):
        reported = next(mark for mark in marks if mark.node == ("M3" if k < 10 else "M1"))
        assert np.array_equal(next(mark for mark in one.marks if mark.node == "M3").position, reported.position)


def test_one_mark_that_comes_back_by_the_name_of_another_is_reported(phantom, frames):
    """M1 and M4 are hidden for half a second; M1 comes back as M4, alone."""
    unseen = [
        (t, marks if k < 10 or k >= 35 else [m for m in marks if m.node == "M3" or (m.node == "M1" and k >= 25)])
        for k, (t, marks) in enumerate(frames[:37])
    ]
    _identity, made = followed(phantom, unseen, lambda k: {"M1": "M4", "M4": "M1"} if k >= 25 else {})
    assert made[25].swap is not None
    assert set(made[25].swap.nodes) == {"M1", "M4"}
    np.testing.assert_array_equal(made[-1].estimate.mean, means(phantom, unseen)[-1])


def test_a_fix_reaches_the_alternatives(phantom, frames):
    """Wrong from the start, and the target sighted in the second frame: as if the names had been right all the time."""
    plain = TissueFilter(phantom, HIDDEN, OUTER)
    identity = AssociationFilter(TissueFilter(phantom, HIDDEN, OUTER), [OUTER])
    place, cov = phantom.positions[phantom.index(HIDDEN)] + 0.003, 1e-6 * np.eye(2)
    for k, (time_s, marks) in enumerate(frames[:8]):
        plain.predict(time_s)
        identity.tissue.predict(time_s)
        reported = identity.update(identity.named(called(marks, {"M1": "M4", "M4": "M1"})))
        right = plain.update(marks)
        if k == 0:
            plain.fix(place, cov)
            identity.fix(place, cov)
    assert len(identity.swaps) == 1
    np.testing.assert_array_equal(reported.estimate.mean, right.mean)


def test_costs_of_names_are_gaussian():
    """-log N(z_j; mean_i, cov_i + R_j), less its constant, by NumPy's determinant and solve. Rounding."""
    rng = np.random.default_rng(0)
    n, m, dim = 4, 3, 3
    roots = rng.normal(size=(n + m, dim, dim))
    covs = roots @ roots.swapaxes(1, 2) + 0.1 * np.eye(dim)
    means_m, z = rng.normal(size=(n, dim)), rng.normal(size=(m, dim))
    S = covs[:n, None] + covs[None, n:]
    off = z[None] - means_m[:, None]
    squared = np.einsum("ijk,ijk->ij", off, np.linalg.solve(S, off[..., None])[..., 0])
    expected = 0.5 * (squared + np.linalg.slogdet(S)[1])
    np.testing.assert_allclose(association_costs(means_m, covs[:n], z, covs[n:]), expected, rtol=1e-12)


def test_a_swap_that_slipped_by_is_mended(phantom, frames, right):
    """Wrong names fed past the identity for half a second: refused marks show it; right names start within 0.2 s."""
    wrong = dict(zip(OUTER, ("M3", "M4", "M1"), strict=True))
    identity = AssociationFilter(TissueFilter(phantom, HIDDEN, OUTER), [OUTER])
    for k, (time_s, marks) in enumerate(frames[:25]):
        identity.tissue.predict(time_s)
        if k < 15:
            identity.tissue.update(called(marks, wrong))
        else:
            reported = identity.update(identity.named(called(marks, wrong)))
    assert len(identity.swaps) == 1
    assert frames[15][0] <= identity.swaps[0].time_s <= frames[15][0] + 0.2
    place = {mark.node: mark.position for mark in reported.marks}
    assert all(np.array_equal(place[mark.node], mark.position) for mark in marks)
    assert np.linalg.norm(reported.estimate.mean - right[24]) < 1e-3


def test_names_that_do_not_beat_the_same_ones_restarted_are_not_adopted(phantom, frames):
    """Wrong from the start; but the restart under the same names explains as much as the best alternative."""
    wrong = {"M1": "M4", "M4": "M1"}
    for beaten, undone in ((True, 1), (False, 0)):
        identity, _ = followed(phantom, frames[:1], lambda _k: wrong)
        best = max(identity.alternatives, key=lambda one: one.ahead)
        identity.same_names = replace(best, ahead=-1e6) if beaten else best
        for time_s, marks in frames[1:5]:
            identity.tissue.predict(time_s)
            identity.update(identity.named(called(marks, wrong)))
        assert len(identity.swaps) == undone
        assert bool(identity.alternatives) != beaten


def test_alternatives_do_not_outlive_a_loss(phantom, frames):
    """Nothing for longer than a second: the next marks restart all names."""
    identity, _ = followed(phantom, frames[:1], lambda _k: {})
    assert {one.since_s for one in identity.alternatives} == {0.0}
    for time_s, marks in ((0.9, []), (1.1, []), (1.2, frames[1][1])):
        identity.tissue.predict(time_s)
        identity.update(marks)
    assert {one.since_s for one in identity.alternatives} == {1.2}


def test_names_as_seen_from_others():
    """Mark 0 is called 1 from now on and is on node 2 by these names; 1, now called 0, on 0; 2, still 2, on 1."""
    assert seen_from((2, 0, 1), (1, 0, 2)) == (0, 2, 1)
    assert seen_from((0, 1, 2), (1, 2, 0)) == (2, 0, 1)


def test_doubt_is_an_exchange_that_costs_little():
    """Against the sum of costs before and after each exchange of two, of random costs; unseen marks tell nothing."""
    rng = np.random.default_rng(1)
    found = []
    for _ in range(200):
        costs = rng.normal(0.0, 3.0, (4, 4))
        costs[:, rng.random(4) < 0.4] = 0.0
        pairs = np.triu(rng.random((4, 4)) < 0.5, 1)
        rises = [
            costs[i, j] + costs[j, i] - costs[i, i] - costs[j, j]
            for i, j in np.argwhere(pairs)
            if costs[:, i].any() or costs[:, j].any()
        ]
        found.append(min(rises, default=np.inf) < -4.0)
        assert ambiguous_exchanges(costs, pairs, -4.0) == found[-1]
    assert 20 < sum(found) < 180


def test_a_mark_that_is_something_else_exchanges_no_names(phantom, frames):
    """What is taken for M3 is anywhere from frame 5 on, and refused: all names are tried in vain, ever more seldom."""
    identity, rng = AssociationFilter(TissueFilter(phantom, HIDDEN, OUTER), [OUTER]), np.random.default_rng(5)
    next_s = set()
    for k, (time_s, marks) in enumerate(frames[:24]):
        away = rng.normal(0.0, 0.1, 2) if k >= 5 else 0.0
        seen = [replace(one, position=one.position + away) if one.node == "M3" else one for one in marks]
        identity.tissue.predict(time_s)
        identity.update(identity.named(seen))
        next_s.add(identity._next_s)
    assert identity.swaps == []
    assert sorted(next_s)[1:] == pytest.approx([5 / 30 + 0.5, 20 / 30 + 1.0], abs=0.05)
