"""What marks show of the model's error: wider covariances, and a field through the marks as a second opinion."""

from dataclasses import replace

import numpy as np
import pytest

from dynamics import build_network, four_mass_phantom
from estimators import MarkMeasurement, Status, TissueFilter, fast_prediction_tables, predict_fast
from estimators.filters.opinions import Scales
from estimators.process.target import target_map
from estimators.tissue.model import undecided
from estimators.tissue.model_error import ModelError

NAMES = tuple(f"n{k}" for k in range(11))
HIDDEN = ("n4", "n5", "n6")
SEEN = tuple(name for name in NAMES[1:] if name not in HIDDEN)
SD_M = 0.5e-3


def cable():
    """Ten links of 0.1 m and 2,000 N/m with weak springs over two against bending, hanging from its first node."""
    positions = np.column_stack([np.zeros(11), -0.1 * np.arange(11)])
    links = [(NAMES[k], NAMES[k + 1]) for k in range(10)]
    bends = [(NAMES[k], NAMES[k + 2]) for k in range(9)]
    return build_network(
        NAMES,
        positions,
        links + bends,
        masses=0.012,
        gravity=[0.0, -9.81],
        stiffness=[2000.0] * 10 + [5.0] * 9,
        damping=[1.0] * 10 + [0.05] * 9,
        fixed=("n0",),
    )


def bent(time_s):
    """Where the nodes truly are [m], (11, 2): a smooth bend that comes and goes by no physics, links as they are."""
    middles = (np.arange(10) + 0.5) / 10.0
    angles = 0.9 * np.sin(1.5 * time_s) * np.cos(1.3 * np.pi * middles)
    steps = 0.1 * np.column_stack([np.sin(angles), -np.cos(angles)])
    return np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])


def marks_at(time_s, rng, sd_m=SD_M, stated_m=SD_M, nodes=SEEN):
    truth = bent(time_s)
    return [
        MarkMeasurement(name, truth[NAMES.index(name)] + sd_m * rng.normal(size=2), stated_m**2 * np.eye(2))
        for name in nodes
    ]


def followed(seed=0, n=40, **noise):
    """A filter of the cable after n frames of 1/30 s; errors of the hidden nodes [m], reported and by springs alone."""
    rng, tissue = np.random.default_rng(seed), TissueFilter(cable(), "n5", SEEN)
    maps = [target_map(tissue.model.network, name) for name in HIDDEN]
    truths = [NAMES.index(name) for name in HIDDEN]
    reported, alone = [], []
    for k in range(n):
        tissue.predict(k / 30.0)
        tissue.update(marks_at(k / 30.0, rng, **noise))
        truth = bent(k / 30.0)[truths]
        reported.append([tissue.place_of(one)[0] for one in maps] - truth)
        alone.append([one.position(tissue.mixture.x) for one in maps] - truth)
    return tissue, np.array(reported), np.array(alone)


def test_what_is_told_is_even_by_three_tenths_where_all_of_it_is_inflated():
    """A filter whose innovations were a hundred times too large: no direction is told surer than by that."""
    tissue, _, _ = followed()
    shown, target = tissue.model_error.shown, target_map(tissue.model.network, "n5")
    none = replace(shown, inflation=1.0, means=None, covs=None, led=None, scales=None)
    tissue.model_error.shown = none
    alone = tissue.place_of(target)
    tissue.model_error.shown = replace(none, inflation=100.0)
    inflated = tissue.place_of(target)
    factor = tissue.model_error.of_target(target, tissue.mixture.x, tissue.mixture.P).factor
    assert factor > 50.0
    share = 0.3 * (1.0 - 1.0 / factor)
    evened = (1.0 - share) * alone[1] + share * np.trace(alone[1]) / len(alone[1]) * np.eye(len(alone[1]))
    np.testing.assert_allclose(inflated[1], factor * evened, rtol=1e-6)
    np.testing.assert_allclose(inflated[0], alone[0], rtol=0.0, atol=1e-12)


def test_a_field_through_the_marks_helps_where_springs_do_not_explain_the_body():
    """Four seeds: hidden nodes of a cable that bends by itself; springs alone err by a quarter more, at least."""
    reported, alone = zip(*(followed(seed)[1:] for seed in range(4)), strict=True)
    ratio = np.linalg.norm(reported, axis=-1).mean() / np.linalg.norm(alone, axis=-1).mean()
    assert ratio < 0.8


def test_marks_that_scatter_more_than_stated_widen_the_target_until_they_no_longer_do():
    """Three times as far as stated: NIS nine times as large, of which springs and pokes take a part."""
    calm, *_ = followed()
    wild, *_ = followed(sd_m=3.0 * SD_M)
    assert calm.model_error.shown.inflation < 2.0
    assert wild.model_error.shown.inflation > 3.0
    inflated = wild.model_error.shown.inflation
    rng = np.random.default_rng(5)
    for k in range(40, 75):
        wild.predict(k / 30.0)
        wild.update(marks_at(k / 30.0, rng))
    assert wild.model_error.shown.inflation < 0.4 * inflated


def test_a_larger_ratio_counts_at_once_and_is_forgotten_over_its_time():
    tissue, *_ = followed(n=20)
    error = ModelError(tissue.model, tissue.settings, ())
    marks = marks_at(19 / 30.0, np.random.default_rng(0))
    degrees = 2 * len(marks)
    error.passed(0.1)
    error.learn(marks, tissue.mixture, 8.0 * degrees)
    assert error.shown.inflation == pytest.approx(8.0)
    error.passed(0.1)
    error.learn(marks, tissue.mixture, 1.0 * degrees)
    # first-order forgetting towards the new ratio
    assert error.shown.inflation == pytest.approx(1.0 + 7.0 * np.exp(-0.1 / tissue.settings.remember_s))
    error.passed(10.0)
    error.learn(marks, tissue.mixture, 0.3 * degrees)
    assert error.shown.inflation == 1.0


@pytest.mark.parametrize(("n_marks", "ratio"), [(7, 4.2), (1, 16.5)])
def test_what_marks_refute_is_not_tracked_beyond_chance(n_marks, ratio):
    """Of 14 coordinates NIS five sigma out is below four times their number, of two it is 16.7 times that.

    By Wilson and Hilferty; the exact chi-square quantile of the same probability is 16.2 for two.
    """
    tissue, *_ = followed(n=20)
    error, marks = tissue.model_error, marks_at(19 / 30.0, np.random.default_rng(0))[:n_marks]
    assert error.status(Status.TRACKING, tissue.target) is Status.TRACKING
    error.learn(marks, tissue.mixture, (ratio + 0.3) * 2 * n_marks)
    assert error.status(Status.TRACKING, tissue.target) is Status.INITIALISING
    assert error.status(Status.DIVERGED, tissue.target) is Status.DIVERGED
    error.passed(10.0)
    error.learn(marks, tissue.mixture, (ratio - 0.3) * 2 * n_marks)
    assert error.status(Status.TRACKING, tissue.target) is Status.TRACKING


def chain(stiffness):
    """Three links of 0.1 m and 20 g that hang from the first node."""
    places = np.column_stack([np.zeros(4), -0.1 * np.arange(4)])
    links = [(NAMES[k], NAMES[k + 1]) for k in range(3)]
    return build_network(
        NAMES[:4], places, links, stiffness=stiffness, masses=0.02, gravity=[0.0, -9.81], damping=0.1, fixed=("n0",)
    )


@pytest.mark.parametrize(
    ("network", "marked", "expected"),
    [
        (chain(2000.0), ("n3",), ["n1", "n2"]),
        (chain(2000.0), ("n2",), ["n1"]),  # n3 hangs from one node
        (chain(2000.0), ("n1", "n2", "n3"), []),
        (replace(chain(2000.0), fixed=np.array([True, False, False, True])), ("n1",), ["n2"]),
        (chain(200.0), ("n3",), ["n1", "n2"]),
        (chain(40.0), ("n3",), []),  # its weight stretches it
        (cable(), SEEN, []),
        (cable(), ("n10",), list(NAMES[1:10])),
        (four_mass_phantom(), ("M1", "M3", "M4"), []),
    ],
)
def test_stiff_links_between_as_many_seen_nodes_as_dimensions_are_undecided(network, marked, expected):
    """0.59 N by 2,000 N/m is 0.3 % of a link, by 200 N/m 3 %, by 40 N/m 15 %."""
    found = undecided(network, marked)
    assert [name for name, one in zip(network.names, found, strict=True) if one] == expected


def test_a_target_that_is_undecided_is_not_tracked_and_may_be_anywhere():
    """At rest the end is seen where it is, for a second: the joint between has the variance of its reach, 0.1² / 4."""
    for target, status in (("n1", Status.INITIALISING), ("n2", Status.TRACKING)):
        tissue = TissueFilter(chain(2000.0), target, ("n2",))
        for k in range(30):
            tissue.predict(k / 30.0)
            estimate = tissue.update([MarkMeasurement("n2", np.array([0.0, -0.2]), SD_M**2 * np.eye(2))])
        assert estimate.status is status
        (mean,), (cov,) = tissue.predict_path(np.array([tissue.time_s]))
        np.testing.assert_allclose(cov, estimate.cov, rtol=1e-9)
        np.testing.assert_allclose(mean, estimate.mean, rtol=1e-9, atol=1e-12)
        widest = np.linalg.eigvalsh(estimate.cov)[-1]
        assert widest == pytest.approx(0.85 * 0.1**2 / 4.0, rel=0.1) if target == "n1" else widest < 4.0 * SD_M**2


def test_a_lone_mark_that_is_not_believed_yet_leaves_the_target_anywhere():
    """The only mark, 0.7 m from where a start expects it: until it is confirmed the body may be all over its reach.

    Three twentieths of that go to the other direction, in which the belief is surer.
    """
    tissue = TissueFilter(cable(), "n5", ("n10",))
    for k in range(3):
        tissue.predict(k / 30.0)
        estimate = tissue.update([MarkMeasurement("n10", np.array([0.6, -0.5]), SD_M**2 * np.eye(2))])
        assert estimate.marks_used == 0
        assert np.linalg.eigvalsh(estimate.cov)[-1] == pytest.approx(0.85 * 0.5**2 / 4.0, rel=0.05)
    tissue.predict(0.2)
    estimate = tissue.update([MarkMeasurement("n10", np.array([0.6, -0.5]), SD_M**2 * np.eye(2))])
    assert estimate.marks_used == 1
    assert tissue.model_error.shown.inflation == 1.0


def test_no_inflation_takes_the_target_beyond_the_body():
    """Marks thrown about by 0.2 m: whatever the innovations, the target stays within reach of its anchor."""
    tissue, rng = TissueFilter(cable(), "n5", SEEN), np.random.default_rng(2)
    for k in range(20):
        tissue.predict(k / 30.0)
        estimate = tissue.update(marks_at(k / 30.0, rng, sd_m=0.2))
        # a point anywhere within 0.5 m, the way along five links: variance r²/4 along each of two axes
        assert np.linalg.eigvalsh(estimate.cov)[-1] <= 0.5**2 / 4.0 + 1e-9
    assert tissue.model_error.shown.inflation > 2.0


def test_predictions_begin_where_the_target_is_reported_and_change_nothing():
    tissue, *_ = followed()
    now = tissue.time_s
    before = tissue.mixture.x.copy(), tissue.mixture.P.copy()
    mean, cov = tissue.place_of(tissue.target)
    assert np.linalg.norm(mean - tissue.target.position(tissue.mixture.x)) > 1e-4
    at_once = tissue.predict_at(now)
    np.testing.assert_allclose(at_once.mean, mean, atol=1e-12)
    np.testing.assert_allclose(at_once.cov, cov, rtol=1e-9)
    means, covs = tissue.predict_path(now + np.array([0.0, 0.1]))
    np.testing.assert_allclose(means[0], mean, atol=1e-12)
    np.testing.assert_allclose(covs[0], cov, rtol=1e-9)
    parts = tissue.predict_modes(now)
    np.testing.assert_allclose(parts.weights @ parts.means, mean, atol=1e-9)
    _, fast, spreads = predict_fast(fast_prediction_tables(tissue, 0.2), tissue)
    np.testing.assert_allclose(fast[0], mean, atol=1e-9)
    np.testing.assert_allclose(spreads[0], cov, rtol=1e-6)
    np.testing.assert_array_equal(tissue.mixture.x, before[0])
    np.testing.assert_array_equal(tissue.mixture.P, before[1])


def test_the_field_is_as_uncertain_as_cross_validation_and_its_distances_say():
    tissue, *_ = followed(n=20)
    shown = tissue.model_error.shown
    _, cov = tissue.model_error.of_field(tissue.target)
    # n5 is the fifth free node: of the field there, on both axes alike
    np.testing.assert_allclose(cov, shown.scales.third * shown.covs[4, 4] * np.eye(2), rtol=1e-12)


def test_a_field_is_of_the_marks_of_now():
    """Without marks the springs alone speak; too few of them tell of no field."""
    tissue, *_ = followed()
    tissue.predict(tissue.time_s + 1 / 30.0)
    assert tissue.model_error.shown.means is None
    tissue.update(marks_at(tissue.time_s, np.random.default_rng(0), nodes=("n1",)))
    assert tissue.model_error.shown.means is None
    tissue.predict(tissue.time_s + 1 / 30.0)
    tissue.update(marks_at(tissue.time_s, np.random.default_rng(0)))
    assert tissue.model_error.shown.means is not None


def test_a_simulation_is_led_along_the_marks_from_where_the_filter_was():
    """Its seen nodes are where the marks are; hidden ones follow by springs alone, to within a link."""
    tissue, *_ = followed(n=1)
    rng, network = np.random.default_rng(0), tissue.model.network
    np.testing.assert_allclose(
        tissue.model_error.shown.led.positions[network.free].ravel()[6:12], tissue.mixture.x[6:12], atol=1e-12
    )
    for k in range(1, 40):
        tissue.predict(k / 30.0)
        marks = marks_at(k / 30.0, rng)
        tissue.update(marks)
        led = tissue.model_error.shown.led
        for mark in marks:
            np.testing.assert_array_equal(led.positions[network.index(mark.node)], mark.position)
        hidden = [NAMES.index(name) for name in HIDDEN]
        assert np.linalg.norm(led.positions[hidden] - bent(k / 30.0)[hidden], axis=1).max() < 0.1


def test_a_simulation_that_ran_away_begins_anew_and_one_that_did_not_goes_on():
    tissue, *_ = followed(n=20)
    error, marks = tissue.model_error, marks_at(20 / 30.0, np.random.default_rng(1))
    shown = error.shown
    wild = replace(shown.led, velocities=shown.led.velocities + 1e200)
    error.shown = replace(shown, led=wild)
    error.passed(1 / 30.0)
    with np.errstate(all="ignore"):
        error.learn(marks, tissue.mixture, 20.0)
    assert np.abs(error.shown.led.positions).max() < 2.0
    error.shown = replace(shown, unseen_s=2.0 * tissue.settings.lost_s)
    error.learn(marks, tissue.mixture, 20.0)
    at = tissue.model.network.index("n5")
    free = list(tissue.model.network.free).index(at)
    np.testing.assert_allclose(error.shown.led.positions[at], tissue.mixture.x[2 * free : 2 * free + 2], atol=1e-12)


def test_a_simulation_counts_by_what_its_distances_say_of_it():
    """Far from filter and field it counts for nothing; where the filter is the one far off, for nearly all."""
    tissue, *_ = followed(n=20)
    error, target = tissue.model_error, tissue.target
    x, P = tissue.mixture.x, tissue.mixture.P
    shown = replace(error.shown, inflation=100.0)
    error.shown = replace(shown, scales=Scales(1.0, 400.0, 1.0))
    assert error.of_target(target, x, P).share == pytest.approx(1.0 / 401.0)
    error.shown = replace(shown, scales=Scales(100.0, 1.0, 1.0))
    found = error.of_target(target, x, P)
    assert found.share == pytest.approx(100.0 / 101.0)
    n = tissue.model.network.n_state
    led = shown.led.positions[tissue.model.network.free]
    np.testing.assert_allclose(target.position(x + found.ahead), led[4], atol=1e-12)
    assert not found.ahead[n:].any()
    # deviations add by their shares: the filter's inflated, the simulation's no more than led_inflation allows
    most = tissue.settings.led_inflation
    assert found.factor == pytest.approx((10.0 / 101.0 + 100.0 / 101.0 * most**0.5) ** 2)
    # known better than the filter's covariance: it counts for more, and no less is told of its errors
    error.shown = replace(shown, scales=Scales(1.0, 0.1, 1.0))
    found = error.of_target(target, x, P)
    assert found.share == pytest.approx(10.0 / 11.0)
    assert found.factor == pytest.approx((10.0 / 11.0 + 10.0 / 11.0 * most**0.5) ** 2)
    error.shown = replace(shown, inflation=1.0, scales=Scales(1.0, 1.0, 1.0))
    assert error.of_target(target, x, P).share == pytest.approx(0.5)
    assert error.of_target(target, x, P).factor == 1.0


def test_of_a_soft_body_none_is_looked_for():
    phantom = four_mass_phantom()
    tissue = TissueFilter(phantom, "M2", ("M1", "M3", "M4"))
    at = dict(zip(phantom.names, phantom.positions, strict=True))
    for k in range(5):
        tissue.predict(k / 30.0)
        estimate = tissue.update([MarkMeasurement(name, at[name], 1e-6 * np.eye(2)) for name in ("M1", "M3", "M4")])
    np.testing.assert_array_equal(estimate.mean, tissue.target.position(tissue.mixture.x))
    np.testing.assert_array_equal(estimate.cov, tissue.target.cov(tissue.mixture.P))
