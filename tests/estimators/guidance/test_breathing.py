"""The breath of a track: its period, where the target will be, and when nothing is to be said."""

import numpy as np
import pytest
from scipy.optimize import root

from dynamics import (
    HIDDEN,
    OUTER,
    ParameterUncertainty,
    four_mass_phantom,
    node_forces,
    parameters,
    scale_parameters,
    supported,
)
from estimators import (
    Breathing,
    BreathingSettings,
    MarkMeasurement,
    TissueFilter,
    breathing_ahead,
    breathing_track,
    mean_bounds,
    normalised_error_squared,
)

FRAME_S = 1.0 / 30.0
TURN = np.array([0.3, 0.95])


def wave(t, period_s):
    """10 mm and a second harmonic of 4 mm along TURN [m], (..., 2)."""
    angle = 2.0 * np.pi * np.asarray(t)[..., None] / period_s
    return (10e-3 * np.cos(angle + 0.4) + 4e-3 * np.cos(2.0 * angle + 1.0)) * TURN + [0.0, 0.19]


def fed(period_s, seconds, sd, rng, settings=None):
    """A predictor that has seen the wave for so long, each coordinate off by sd [m]."""
    breathing = Breathing(2, settings)
    for t in np.arange(0.0, seconds, FRAME_S):
        breathing.update(float(t), wave(t, period_s) + sd * rng.normal(size=2), sd**2 * np.eye(2))
    return breathing


def oracle(times, means, covs, ahead, s):
    """Prediction by weighted least squares on the rows of the track, a period at a time: the module's text in NumPy."""
    weights = np.exp(-(times[-1] - times) / s.memory_s)
    x = means - means[0]
    rows = lambda t, period: np.stack(  # noqa: E731
        [np.ones_like(t)]
        + [np.cos(2 * np.pi * h * t / period) for h in range(1, s.harmonics + 1)]
        + [np.sin(2 * np.pi * h * t / period) for h in range(1, s.harmonics + 1)],
        axis=-1,
    )
    periods = 1.0 / np.linspace(1.0 / s.longest_s, 1.0 / s.shortest_s, s.n_periods)
    n = 2 * s.harmonics + 1
    fits, inverses, misfits = [], [], []
    for period in periods:
        # a ridge of 1e-3 rows keeps the fit defined
        design = np.vstack([np.sqrt(weights)[:, None] * rows(times, period), np.sqrt(1e-3) * np.eye(n)])
        wanted = np.vstack([np.sqrt(weights)[:, None] * x, np.zeros((n, 2))])
        fit = np.linalg.lstsq(design, wanted, rcond=None)[0]
        fits.append(fit)
        root = np.linalg.inv(np.linalg.qr(design, mode="r"))
        inverses.append(root @ root.T)
        misfits.append(((wanted - design @ fit) ** 2).sum())
    misfits = np.array(misfits)
    span = times[-1] - times[0]
    independent = max(s.memory_s * (1.0 - np.exp(-span / s.memory_s)) / s.alike_s, n + 1.0)
    total2 = misfits.min() / weights.sum() / 2 * independent / (independent - n)
    odds = np.exp(-0.5 * (misfits - misfits.min()) / weights.sum() * independent / total2)
    odds /= odds.sum()
    own2 = max(total2 - (weights * np.trace(covs, axis1=1, axis2=2) / 2).sum() / weights.sum(), 0.0)
    each = np.array([rows(ahead, period) @ fit for period, fit in zip(periods, fits, strict=True)])
    mean = np.einsum("p,pkd->kd", odds, each)
    cov = np.zeros((len(ahead), 2, 2))
    for p, period in enumerate(periods):
        away, phi = each[p] - mean, rows(ahead, period)
        of_fit = total2 * weights.sum() / independent * np.einsum("kn,nm,km->k", phi, inverses[p], phi)
        cov += odds[p] * (away[:, :, None] * away[:, None, :] + (own2 + of_fit)[:, None, None] * np.eye(2))
    centred = x - (weights[:, None] * x).sum(axis=0) / weights.sum()
    period = odds @ periods
    breath = {
        "period_s": period,
        "period_sd_s": np.sqrt(odds @ (periods - period) ** 2),
        "scatter_m": np.sqrt(own2),
        "explained": 1.0 - misfits.min() / (weights * (centred**2).sum(axis=1)).sum(),
        "weights": odds,
    }
    return mean + means[0], cov, breath


@pytest.mark.parametrize(
    ("seconds", "filter_sd", "settings"),
    [
        (12.0, 0.5e-3, BreathingSettings(n_periods=30, explained=0.0)),
        (30.0, 0.5e-3, BreathingSettings(n_periods=30, memory_s=6.0, harmonics=2, explained=0.0)),
        (12.0, 5e-3, BreathingSettings(n_periods=20, alike_s=0.6, explained=0.0)),
        (4.5, 0.5e-3, BreathingSettings(n_periods=20, alike_s=1.0, explained=0.0, longest_s=3.0, shortest_s=2.0)),
    ],
)
def test_predictions_are_those_of_weighted_least_squares(seconds, filter_sd, settings):
    """All of the fit against `oracle`, 1e-6 relative: faded past, likely periods, scatter, too few for a fit."""
    rng = np.random.default_rng(6)
    times = np.sort(rng.uniform(0.0, seconds, int(10 * seconds)))
    means = wave(times, 2.7 if settings.longest_s < 4.0 else 4.1) + 3e-3 * rng.normal(size=(len(times), 2))
    covs = filter_sd**2 * rng.uniform(0.5, 1.5, len(times))[:, None, None] * np.diag([1.0, 2.0])
    breathing = Breathing(2, settings)
    for t, mean, cov in zip(times, means, covs, strict=True):
        breathing.update(float(t), mean, cov)
    ahead = seconds + np.linspace(0.0, 3.0, 4)
    found, found_covs = breathing.predict(ahead)
    expected, expected_covs, breath = oracle(times, means, covs, ahead, settings)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found_covs, expected_covs, rtol=0, atol=1e-6 * np.abs(expected_covs).max())
    for name, value in breath.items():
        np.testing.assert_allclose(getattr(breathing.breath(), name), value, rtol=1e-6, atol=1e-9, err_msg=name)


STEP_S = 0.2
AHEAD_S = np.array([0.0, 1.0, 10.0])
LEVELS = {"fit of one period": (0.8e-3, 0.6e-3), "fit of many periods": (1.6e-3, 1.2e-3)}
"""Standard deviations a coordinate [m]: of the target about its breath, and of the filter about the target."""


def predicted(case, n_runs, seconds):
    """Of seeded runs: errors about the wave at AHEAD_S (n_runs, 3, 2), covariances, and scatters (n_runs,) [m].

    Frames every STEP_S with errors that are independent, as the settings say. Nothing is forgotten. With one period all
    of the uncertainty is that of the coefficients; with many, periods near the true one are likely, too.
    """
    one = case == "fit of one period"
    settings = BreathingSettings(
        shortest_s=4.0 if one else 3.4,
        longest_s=6.5 if one else 5.0,
        n_periods=2 if one else 150,
        harmonics=2,
        memory_s=1e4,
        alike_s=STEP_S,
        explained=0.5,
    )
    own, filter_sd = LEVELS[case]
    errors, covs, scatters = [], [], []
    for seed in range(n_runs):
        rng = np.random.default_rng(100 + seed)
        period_s = 4.0 if one else rng.uniform(3.8, 4.4)
        breathing = Breathing(2, settings)
        for t in np.arange(0.0, seconds, STEP_S):
            seen = wave(t, period_s) + own * rng.normal(size=2) + filter_sd * rng.normal(size=2)
            breathing.update(float(t), seen, filter_sd**2 * np.eye(2))
        means, cov = breathing.predict(t + AHEAD_S)
        errors.append(wave(t + AHEAD_S, period_s) - means)
        covs.append(cov)
        scatters.append(breathing.breath().scatter_m)
    return np.array(errors), np.array(covs), np.array(scatters)


@pytest.mark.parametrize(("case", "seconds"), [("fit of one period", 30.0), ("fit of many periods", 12.0)])
def test_the_covariance_matches_errors_of_the_fit_and_of_where_the_target_is_now_and_ahead(case, seconds):
    """NEES of the wave itself by the covariance less the scatter, 99.8 % bounds at each time; then the whole.

    That is of a target that scatters about the wave as it did before, drawn 20 times a run and time.
    """
    errors, covs, scatters = predicted(case, 12, seconds)
    fit = covs - (scatters**2)[:, None, None, None] * np.eye(2)
    rng, fit_bounds = np.random.default_rng(7), mean_bounds(2, len(errors), 0.998)
    low, high = mean_bounds(2, 20 * len(errors), 0.998)
    for k in range(len(AHEAD_S)):
        assert fit_bounds[0] < normalised_error_squared(errors[:, k], fit[:, k]).mean() < fit_bounds[1]
        drawn = errors[:, k] + LEVELS[case][0] * rng.normal(size=(20, *errors[:, k].shape))
        squared = [normalised_error_squared(off, covs[:, k]).mean() for off in drawn]
        assert low < np.mean(squared) < high


def test_nothing_is_said_too_early_or_of_a_track_that_does_not_breathe():
    """After one and a half breaths and not before; never of a target that wanders."""
    rng = np.random.default_rng(1)
    assert fed(4.0, 3.0, 1e-3, rng).breath() is None
    assert fed(4.0, 5.0, 1e-3, rng).breath() is None
    assert fed(4.0, 6.5, 1e-3, rng).breath() is not None
    wandering = Breathing(2)
    place = np.zeros(2)
    for t in np.arange(0.0, 20.0, FRAME_S):
        place = 0.95 * place + 2e-3 * rng.normal(size=2)
        wandering.update(float(t), place, 1e-6 * np.eye(2))
    assert wandering.breath() is None
    with pytest.raises(ValueError, match=r"^predict: expected a track with a breath, found none$"):
        wandering.predict(np.array([21.0]))
    assert Breathing(2).breath() is None


def test_the_clock_of_a_track_may_start_anywhere():
    """Times later by 100 s: nothing after 5 s of a breath of 4 s, and after 6.5 s the same breath. 1e-6 relative."""
    marks = np.random.default_rng(1).normal(0.0, 1e-3, (195, 2))
    early, late = Breathing(2), Breathing(2)
    for k, off in enumerate(marks):
        t = k * FRAME_S
        for breathing, start in ((early, 0.0), (late, 100.0)):
            breathing.update(start + t, wave(t, 4.0) + off, 1e-6 * np.eye(2))
        if k == 150:
            assert (early.breath(), late.breath()) == (None, None)
    assert late.breath().period_s == pytest.approx(early.breath().period_s, rel=1e-6)
    ahead = 195 * FRAME_S + np.array([0.1, 1.0])
    np.testing.assert_allclose(late.predict(100.0 + ahead)[0], early.predict(ahead)[0], rtol=0, atol=1e-7)


def test_bounds_of_the_settings():
    """Periods below a second and one harmonic are accepted, periods of nothing and without end are not."""
    settings = BreathingSettings(shortest_s=0.5, longest_s=0.9, n_periods=2, harmonics=1)
    np.testing.assert_allclose(Breathing(2, settings).periods_s, [0.9, 0.5], rtol=1e-15)
    for shortest_s, longest_s in ((0.0, 4.0), (-1.0, 4.0), (4.0, np.inf), (5.0, 4.0), (4.0, 4.0)):
        with pytest.raises(ValueError, match=f"expected 0 < shortest_s < longest_s, found {shortest_s}, {longest_s}"):
            BreathingSettings(shortest_s=shortest_s, longest_s=longest_s)


def test_bad_input_is_reported():
    breathing = Breathing(2)
    breathing.update(1.0, np.zeros(2), np.eye(2))
    with pytest.raises(ValueError, match=r"time_s: expected more than 1.0, found inf"):
        breathing.update(np.inf, np.zeros(2), np.eye(2))
    with pytest.raises(ValueError, match=r"time_s: expected more than 1.0, found 1.0"):
        breathing.update(1.0, np.zeros(2), np.eye(2))
    with pytest.raises(ValueError, match="mean: expected 2 finite coordinates"):
        breathing.update(2.0, np.array([0.0, np.nan]), np.eye(2))
    with pytest.raises(ValueError, match="expected 2 periods"):
        BreathingSettings(n_periods=1)
    with pytest.raises(ValueError, match="1 harmonic or more, found 2, 0"):
        BreathingSettings(n_periods=2, harmonics=0)
    for name in ("lasting_s", "forgotten"):
        with pytest.raises(ValueError, match=f"breathing {name}: expected more than 0, found 0"):
            BreathingSettings(**{name: 0})


@pytest.mark.parametrize("seed", [1, 4, 8])
def test_an_error_of_the_constants_lasts_and_is_in_the_covariance_ahead(seed):
    """Truth: the marks are led to and fro; the target balances the forces of springs off by 30 %, as is stated."""
    given, sd, step_s = four_mass_phantom(), 0.3, 1.0 / 15.0
    rng, which = np.random.default_rng(seed), parameters(given, ("stiffness",))
    true = supported(scale_parameters(given, which, sd * rng.normal(size=len(which))))
    hidden, outer = given.index(HIDDEN), [given.index(name) for name in OUTER]

    def places(time_s):
        """Positions of all nodes [m]."""
        x = given.positions.copy()
        x[outer] += 1e-3 * np.array([[-10.0, 5.0], [20.0, 5.0], [0.0, 5.0]]) * np.sin(0.5 * np.pi * time_s)

        def force(place):
            x[hidden] = place
            return node_forces(true, x, np.zeros_like(x))[hidden]

        x[hidden] = root(force, given.positions[hidden]).x
        return x

    tissue = TissueFilter(given, HIDDEN, OUTER, uncertainty=ParameterUncertainty(which, sd**2 * np.eye(len(which))))
    breathing = Breathing(2)
    for k in range(240):
        tissue.predict(k * step_s)
        marks = places(k * step_s)[outer] + 5e-4 * rng.normal(size=(3, 2))
        estimate = tissue.update(
            [MarkMeasurement(*mark, 2.5e-7 * np.eye(2)) for mark in zip(OUTER, marks, strict=True)]
        )
        if k > 10:
            breathing.update(k * step_s, *breathing_track(tissue, estimate.mean))
    ahead_s = 239 * step_s + 0.5
    means, covs = breathing_ahead(breathing, tissue, np.array([ahead_s]))
    assert normalised_error_squared(means - places(ahead_s)[hidden], covs)[0] < 9.2  # 99 %
