"""Filters that are pickled or copied go on bit for bit, and leave the first alone. Reference: a filter that was not."""

import copy
import pickle

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER, four_mass_phantom, independent_uncertainty, parameters
from estimators import (
    AssociationFilter,
    FilterSettings,
    FixBias,
    FixedLag,
    LeaveOneOut,
    MarkMeasurement,
    Replay,
    TissueFilter,
)
from tests.estimators.states import digest

WAYS = {"pickled": lambda one: pickle.loads(pickle.dumps(one)), "copied": copy.deepcopy}
N_FRAMES, CUT = 8, 5
"""Frames, and after how many of them the filter is pickled or copied."""

way = pytest.mark.parametrize("way", WAYS.values(), ids=WAYS)


def uncertain_phantom() -> TissueFilter:
    """A filter that considers wrong constants and a calibration, estimates the bias of fixes."""
    network = four_mass_phantom()
    constants = parameters(network, ("stiffness",))
    return TissueFilter(
        network,
        HIDDEN,
        OUTER,
        FilterSettings(fix_bias=FixBias(1e-3)),
        uncertainty=independent_uncertainty(constants, np.full(len(constants), 0.05)),
        n_calibration=1,
    )


FILTERS = {
    "usual": lambda: TissueFilter(four_mass_phantom(), HIDDEN, OUTER),
    "sigma points": lambda: TissueFilter(four_mass_phantom(), HIDDEN, OUTER, FilterSettings(sigma_points=True)),
    "uncertain": uncertain_phantom,
}


def frame(tissue: TissueFilter, k: int) -> list[MarkMeasurement]:
    """The marks in frame k: each moves on a circle of its own about its place at rest, and some are not seen."""
    network, rng = tissue.network, np.random.default_rng(k)
    marks = []
    for n, node in enumerate(OUTER):
        if (k + n) % 5:
            turn = 0.3 * k + n
            place = network.positions[network.index(node)] + 6e-3 * np.array([np.sin(turn), np.cos(turn)])
            shared = 1e-4 * np.ones((2, 1)) if tissue.n_calibration else None
            marks.append(MarkMeasurement(node, place + 5e-4 * rng.normal(size=2), 2.5e-7 * np.eye(2), shared))
    return marks


def step(tissue: TissueFilter, k: int) -> None:
    tissue.predict(k / 30.0)
    tissue.update(frame(tissue, k))


def assert_same(one: TissueFilter, other: TissueFilter) -> None:
    """The whole state is the same to the last bit."""
    assert digest(one.snapshot()) == digest(other.snapshot())


@pytest.mark.parametrize("make", FILTERS.values(), ids=FILTERS)
def test_a_filter_goes_on_bit_for_bit_and_the_first_is_left_alone(make):
    """With a transition that no update has followed yet, and later under a known push, which its equations feel."""
    unbroken, first = make(), make()
    for each in (unbroken, first):
        for k in range(CUT):
            step(each, k)
        each.predict(CUT / 30.0)
    others = [way(first) for way in WAYS.values()]
    for other in others:
        assert_same(other, unbroken)
    push = 0.2 * np.ones((len(first.network.free), 2))

    def go_on(tissue: TissueFilter) -> None:
        tissue.update(frame(tissue, CUT))
        for k in range(CUT + 1, N_FRAMES):
            step(tissue, k)
        tissue.predict((N_FRAMES + 3) / 30.0, push)

    go_on(unbroken)
    for other in others:
        go_on(other)
        assert_same(other, unbroken)
    assert first.time_s == CUT / 30.0
    go_on(first)
    assert_same(first, unbroken)


@way
def test_what_is_checked_when_made_stays_so(way):
    """Arrays of a network, and of a mark cannot be written: kernels are compiled for such."""
    tissue = way(uncertain_phantom())
    network = tissue.network
    assert not any(getattr(network, name).flags.writeable for name in ("positions", "stiffness", "springs", "free"))
    mark = way(MarkMeasurement("M1", np.zeros(2), np.eye(2), np.ones((2, 1))))
    assert not any(array.flags.writeable for array in (mark.position, mark.cov, mark.shared))


@way
def test_what_is_built_on_a_filter_goes_along(way):
    """A filter of withheld marks, one of frames that come late, one of the past, and one of exchanged names."""
    network = four_mass_phantom()
    plain = TissueFilter(network, HIDDEN, OUTER)
    # slow exchanges, so that alternatives are followed when the filter is copied
    vague = [MarkMeasurement(node, network.positions[network.index(node)], 0.01 * np.eye(2)) for node in OUTER]

    def checked(each: LeaveOneOut, k: int):
        each.predict(k / 30.0)
        return each.update(frame(plain, k))

    def taken(each: Replay | FixedLag, k: int):
        return each.take(k / 30.0, frame(plain, k))

    def named(each: AssociationFilter, k: int):
        each.tissue.predict(k / 30.0)
        found = each.update(each.named(vague)).estimate
        assert each.alternatives
        return found

    for made, follow in (
        (LeaveOneOut(network, HIDDEN, OUTER), checked),
        (Replay(TissueFilter(network, HIDDEN, OUTER)), taken),
        (FixedLag(TissueFilter(network, HIDDEN, OUTER), 0.1), taken),
        (AssociationFilter(TissueFilter(network, HIDDEN, OUTER), (OUTER,)), named),
    ):
        for k in range(4):
            follow(made, k)
        other = way(made)
        for k in range(4, 6):
            expected, found = follow(made, k), follow(other, k)
            np.testing.assert_array_equal(found.mean, expected.mean)
            np.testing.assert_array_equal(found.cov, expected.cov)
