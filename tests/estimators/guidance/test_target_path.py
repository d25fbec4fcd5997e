"""The predicted path that advice rests on: its form, how far it reaches, and what a live filter is asked for."""

from dataclasses import replace

import numpy as np
import pytest

from estimators import Advice, AdviceSettings, Needle, PathParts, TargetPath, advise, either_path, guide, path_times
from tests.estimators.guidance.straight_down import DISC, DOWN, HEALTHY, NOW_S, TIP, at, path_of

resting = at(0.0, 0.04)
"""The target rests 60 mm below the entry."""


@pytest.mark.parametrize(
    ("needle", "depth_m", "way_s"),
    [
        *((needle, 0.0, way_s) for needle, way_s in ((TIP, 0.6), (Needle(), 0.75), (Needle(notch_offset_m=0.02), 0.9))),
        *((TIP, depth_m, way_s) for depth_m, way_s in ((0.03, 0.3), (0.06, 0.0), (0.2, 0.0))),
    ],
)
@pytest.mark.parametrize("horizon_s", [1.99, 2.01])
def test_the_path_ends_one_to_two_steps_after_the_last_arrival(needle, depth_m, way_s, horizon_s):
    """60 mm less the depth, and the notch's middle beyond it, at 100 mm/s; steps of 1/30 s from now on."""
    times = path_times(HEALTHY, replace(DOWN, depth_m=depth_m), needle, AdviceSettings(horizon_s=horizon_s), NOW_S)
    assert times[0] == NOW_S
    np.testing.assert_allclose(np.diff(times), 1.0 / 30, rtol=1e-9)
    assert 1.0 / 30 <= times[-1] - (NOW_S + horizon_s + way_s) <= 2.0 / 30


class Resting:
    """A healthy filter whose target rests; it keeps the times that it was asked for."""

    seen_s = NOW_S + 0.05

    def predict_path(self, times_s):
        """The resting target."""
        self.times_s = times_s
        return resting(times_s), np.tile(1e-6 * np.eye(2), (len(times_s), 1, 1))


@pytest.mark.parametrize("needle", [None, TIP])
@pytest.mark.parametrize("settings", [None, AdviceSettings(horizon_s=0.5, go=0.999)])
@pytest.mark.parametrize("now_s", [None, NOW_S + 0.0625])
def test_a_live_filter_is_asked_with_the_needle_the_settings_and_the_time(needle, settings, now_s):
    """Closed forms of each: 60 mm of way, and 15 mm more to the notch of a default needle; starts 0.1 s apart."""
    source, start, way = Resting(), NOW_S if now_s is None else now_s, 0.06 if needle else 0.075
    found = guide(source, HEALTHY, DOWN, DISC, needle=needle, settings=settings, now_s=now_s)
    last = 0.5 if settings else 2.0
    assert found.depth_m == pytest.approx(way, abs=1e-9)
    assert found.arrival_s == pytest.approx(start + way / 0.1, abs=1e-6)
    np.testing.assert_allclose(found.outlook.starts_s, start + np.linspace(0.0, last, round(10 * last) + 1), rtol=1e-12)
    assert found.advice is (Advice.WAIT if settings else Advice.GO)  # probabilities are 0.96 and 0.998
    assert source.times_s[0] == start
    assert start + last + way / 0.1 < source.times_s[-1] <= start + last + way / 0.1 + 0.1
    path = TargetPath(source.times_s, *source.predict_path(source.times_s))
    alone = advise(path, DOWN, DISC, needle=needle, settings=settings)
    assert (alone.advice, alone.depth_m, alone.probability) == (found.advice, found.depth_m, found.probability)


def test_between_the_times_of_the_path_the_target_moves_smoothly():
    """A swing of 10 mm at 3 Hz, 30 samples a second: met within 0.1 mm of where it is (straight lines: 0.5 mm)."""
    where = lambda t: np.c_[0.01 * np.sin(6 * np.pi * t), 0.04 + 0 * t]  # noqa: E731
    path = path_of(where)
    worst = 0.0
    for k in range(20):
        slow = replace(DOWN, speed_m_s=0.1 + 1e-3 * k)
        said = advise(path, slow, DISC, needle=TIP)
        worst = max(worst, np.abs(said.aim - where(np.array([said.arrival_s - NOW_S]))[0]).max())
    assert worst < 0.1e-3


@pytest.mark.parametrize("way_s", [0.0, 0.01, 0.1, 0.4, 0.75, 0.9])
def test_the_covariance_between_the_times_of_the_path_is_on_a_straight_line(way_s):
    """NumPy's interpolation of each entry, at arrivals in the first, middle and last of uneven intervals. 1e-6."""
    times, rng = np.array([0.0, 0.05, 0.3, 0.6, 1.0]), np.random.default_rng(0)
    roots = rng.normal(0.0, 1e-3, (5, 2, 2))
    covs = roots @ roots.swapaxes(1, 2)
    path = TargetPath(NOW_S + times, np.tile([0.0, 0.04], (5, 1)), covs)
    begun = replace(DOWN, depth_m=0.06 - 0.1 * way_s) if way_s <= 0.6 else replace(DOWN, speed_m_s=0.06 / way_s)
    found = advise(path, begun, DISC, needle=TIP, settings=AdviceSettings(horizon_s=0.0))
    assert found.arrival_s == pytest.approx(NOW_S + way_s, abs=1e-6)
    expected = [[np.interp(way_s, times, covs[:, a, b]) for b in range(2)] for a in range(2)]
    np.testing.assert_allclose(found.cov, expected, rtol=0, atol=1e-6 * np.abs(covs).max())


def test_each_moment_of_the_outlook_is_that_moments_own_advice():
    """The probability reported for a later start is the one reported then, for the same path."""
    path = path_of(lambda t: np.c_[0.01 * np.cos(3 * t), 0.04 + 0.005 * np.sin(5 * t)])
    settings = AdviceSettings(horizon_s=1.0)
    said = advise(path, DOWN, DISC, needle=TIP, settings=settings)
    assert len(said.outlook.starts_s) == 11
    for start, arrival, p in zip(
        said.outlook.starts_s, said.outlook.arrivals_s, said.outlook.probabilities, strict=True
    ):
        then = advise(path, DOWN, DISC, needle=TIP, settings=replace(settings, horizon_s=0.0), now_s=float(start))
        assert (then.arrival_s, then.probability) == (arrival, p)
    assert said.best_probability == said.outlook.probabilities.max()
    assert np.ptp(said.outlook.probabilities) > 0.3


def test_a_path_may_end_with_the_last_start_and_not_before():
    """Times without rounding. Half a second apart, they reach no target 60 mm off but for a needle that is there."""
    settings = AdviceSettings(horizon_s=2.0, step_s=0.5)
    found = advise(path_of(resting, seconds=2.0, step=0.5), DOWN, DISC, needle=TIP, settings=settings)
    assert np.isfinite(found.outlook.arrivals_s).tolist() == [True, True, True, False, False]
    message = r"path: expected times from 10.0 to 12.0 s, found 10.0 to 11.5 s"
    with pytest.raises(ValueError, match=message):
        advise(path_of(resting, seconds=1.5, step=0.5), DOWN, DISC, needle=TIP, settings=settings)


def uneven(*times):
    """A path of a target at the origin at these times [s]."""
    return TargetPath(np.array(times), np.zeros((len(times), 2)), np.zeros((len(times), 2, 2)))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: TargetPath(np.arange(4.0), np.zeros((3, 2)), np.zeros((3, 2, 2))),
            r"found \(4,\), \(3, 2\), \(3, 2, 2",
        ),
        (
            lambda: TargetPath(np.arange(3.0), np.zeros((3, 2)), np.zeros((3, 3, 3))),
            r"found \(3,\), \(3, 2\), \(3, 3, 3",
        ),
        (lambda: path_of(resting, seconds=0.0, step=1.0), "path: expected two or more times"),
        (
            lambda: advise(path_of(resting, seconds=1.0, step=1 / 30), DOWN, DISC),
            "path: expected times from 10.0 to 12.0",
        ),
        (lambda: uneven(0.0, 1.0, 1.0), r"path times_s: expected increasing times, found \[0\. 1\. 1\.\]"),
        (lambda: uneven(0.0), r"path: expected two or more times, .* found \(1,\), \(1, 2\), \(1, 2, 2\)"),
    ],
)
def test_what_is_no_path_is_rejected(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_either_of_two_paths_has_the_moments_of_both():
    """Means and covariances of a Gaussian and of one in two parts, against the textbook sums over all parts, 1e-12."""
    rng = np.random.default_rng(3)
    times, k = np.array([0.0, 0.1, 0.3]), 3
    roots = rng.normal(size=(3, k, 2, 2))
    covs = roots @ roots.swapaxes(-1, -2)
    means, halves = rng.normal(size=(3, k, 2)), np.full(k, 0.5)
    parts = PathParts(np.full((k, 2), 0.5), means[1:].swapaxes(0, 1), covs[1:].swapaxes(0, 1))
    mean = 0.5 * (means[1] + means[2])
    away = 0.5 * (means[1] - means[2])
    two = TargetPath(times, mean, 0.5 * (covs[1] + covs[2]) + away[:, :, None] * away[:, None, :], parts)
    one = TargetPath(times, means[0], covs[0])
    probability = np.array([1.0, 0.7, 0.0])
    found = either_path(one, two, probability)
    weights = np.stack([probability, (1.0 - probability) * halves, (1.0 - probability) * halves])
    np.testing.assert_allclose(found.mixture.weights, weights.T, atol=1e-12)
    for t in range(k):
        expected = sum(w * m for w, m in zip(weights[:, t], means[:, t], strict=True))
        second = sum(w * (P + np.outer(m, m)) for w, m, P in zip(weights[:, t], means[:, t], covs[:, t], strict=True))
        np.testing.assert_allclose(found.means[t], expected, atol=1e-12)
        np.testing.assert_allclose(found.covs[t], second - np.outer(expected, expected), atol=1e-12)
    np.testing.assert_allclose(found.means[0], one.means[0], atol=1e-12)
    np.testing.assert_allclose(found.covs[2], two.covs[2], atol=1e-12)
