"""The breath of a track: its period, where the target will be, and when nothing is to be said."""

import numpy as np
import pytest

from estimators import Breathing, BreathingSettings, coverage, normalised_error_squared

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


@pytest.mark.parametrize("period_s", [3.0, 3.71, 4.6, 6.0])
def test_the_period_is_found_and_the_wave_foretold(period_s):
    """Errors of 1 mm a coordinate, 15 s: the period to 2 %, the wave half a second ahead to 0.4 mm on average."""
    rng = np.random.default_rng(3)
    breathing = fed(period_s, 15.0, 1e-3, rng)
    assert breathing.breath().period_s == pytest.approx(period_s, rel=0.02)
    ahead = 15.0 + np.linspace(0.0, 0.5, 6)
    means, _ = breathing.predict(ahead)
    assert np.linalg.norm(means - wave(ahead, period_s), axis=1).mean() < 4e-4


def test_the_scatter_is_the_target_s_own():
    """The target scatters by 0.8 mm, the filter errs by 0.6 mm, and says so: 0.8 to 0.96 mm; region of 95 %.

    Up to a fifth too much: independent errors are taken for alike within 0.2 s, and 4.2 s lies between two periods.
    """
    rng = np.random.default_rng(5)
    breathing = Breathing(2)
    squared = []
    for t in np.arange(0.0, 40.0, FRAME_S):
        true = wave(t, 4.2) + 0.8e-3 * rng.normal(size=2)
        if t > 20.0:
            mean, cov = breathing.predict(np.array([t]))
            squared.append(normalised_error_squared(true - mean, cov)[0])
        breathing.update(float(t), true + 0.6e-3 * rng.normal(size=2), 0.36e-6 * np.eye(2))
    assert 0.8e-3 <= breathing.breath().scatter_m <= 0.96e-3
    assert 0.92 <= coverage(squared, 2) <= 0.99


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
    with pytest.raises(ValueError, match="predict: expected a track that breathes"):
        wandering.predict(np.array([21.0]))


def test_the_past_fades():
    """From 5.5 s to 3.2 s a breath: four memories later the new period, to 3 %."""
    settings = BreathingSettings(memory_s=5.0)
    breathing = fed(5.5, 15.0, 1e-3, np.random.default_rng(2), settings)
    for t in np.arange(15.0, 35.0, FRAME_S):
        breathing.update(float(t), wave(t, 3.2), 1e-6 * np.eye(2))
    assert breathing.breath().period_s == pytest.approx(3.2, rel=0.03)


def test_bad_input_is_told():
    breathing = Breathing(2)
    breathing.update(1.0, np.zeros(2), np.eye(2))
    with pytest.raises(ValueError, match=r"time_s: expected more than 1.0, found 1.0"):
        breathing.update(1.0, np.zeros(2), np.eye(2))
    with pytest.raises(ValueError, match="mean: expected 2 finite coordinates"):
        breathing.update(2.0, np.array([0.0, np.nan]), np.eye(2))
    with pytest.raises(ValueError, match="expected 0 < shortest_s < longest_s"):
        BreathingSettings(shortest_s=5.0, longest_s=4.0)
    with pytest.raises(ValueError, match="expected 2 periods"):
        BreathingSettings(n_periods=1)
