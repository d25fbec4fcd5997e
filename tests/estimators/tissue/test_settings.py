"""Rates of the modes that follow from the settings."""

from dataclasses import replace

import numpy as np
import pytest

from estimators import FilterSettings
from estimators.tissue.settings import LED, stationary


def test_odds_of_the_modes():
    """Rates: rows sum to zero, 1/100 and 1/1.5 a second into a poke, 1/0.3 out of it, 5 % of that into calm.

    From any of them once in 10,000 s a blow of 1/30 s; then the same between pokes and poked, with a blow every 1.5 s
    and back after twenty of these.
    """
    rates = FilterSettings().rates
    np.testing.assert_allclose(rates.sum(axis=1), 0.0, atol=1e-15)
    off = np.array(
        [
            [0, 0, 1 / 100, 0, 0, 1e-4],
            [0, 0, 1 / 1.5, 0, 0, 1e-4],
            [0.05 / 0.3, 0.95 / 0.3, 0, 0, 0, 1e-4],
            [0, 0.05 / 1.5, 0, 0, 1 / 1.5, 1 / 1.5],
            [0, 0, 0.05 / 1.5, 0.95 / 0.3, 0, 1 / 1.5],
            [0, 0, 0, 30.0, 0, 0],
        ]
    )
    np.testing.assert_allclose(rates - np.diag(np.diag(rates)), off, rtol=1e-14)


def test_where_led_nodes_are_stated_no_other_is_led():
    """Two modes of a stiff body in place of three, between which the rates keep probability."""
    stated = FilterSettings(led_nodes=("grip",)).for_stiff_or_large()
    assert len(FilterSettings().for_stiff_or_large().modes) == 3
    assert stated.modes == (stated.quiet, stated.poked)
    assert stated.of_state == (0, 0, 1)
    np.testing.assert_allclose(stated.rates, FilterSettings(unstruck_s=np.inf).rates[:3, :3], rtol=1e-14)


def test_a_hand_that_leads_is_seldom_until_it_has_led():
    """From calm, between and poked once in 10,000 s; where it is about, for 1.5 s, from poked every 0.3 s and back.

    States where it is about act as those before: three modes, of which searches for marks expect the first two.
    """
    led = FilterSettings().for_stiff_or_large()
    assert led.of_state == (0, 0, 1, 0, 1, 2)
    assert (led.n_usual, led.quiet_modes) == (2, (0,))
    off = np.array(
        [
            [0, 0, 1 / 100, 0, 0, 1e-4],
            [0, 0, 1 / 1.5, 0, 0, 1e-4],
            [0.05 / 0.3, 0.95 / 0.3, 0, 0, 0, 1e-4],
            [0, 1 / 1.5, 0, 0, 1 / 1.5, 0],
            [0, 0, 1 / 1.5, 0.95 / 0.3, 0, 1 / 0.3],
            [0, 0, 0, 0, 1 / 0.3, 0],
        ]
    )
    np.testing.assert_allclose(led.rates - np.diag(np.diag(led.rates)), off, rtol=1e-14)
    np.testing.assert_allclose(led.rates.sum(axis=1), 0.0, atol=1e-14)


def test_one_poke_at_a_time_of_a_body_that_may_be_led():
    """A mode and two states for each of three nodes, as probable together as the one mode for all of them."""
    one = replace(FilterSettings(), one_of=3).for_stiff_or_large()
    assert one.of_state == (0, 0, 1, 2, 3, 0, 1, 2, 3, 4)
    np.testing.assert_allclose(one.rates.sum(axis=1), 0.0, atol=1e-13)
    together = [[0], [1], [2, 3, 4], [5], [6, 7, 8], [9]]
    lumped = np.array([[one.rates[i[0], j].sum() for j in together] for i in together])
    np.testing.assert_allclose(lumped, FilterSettings().for_stiff_or_large().rates, rtol=1e-12)


def test_tuned_noise_of_a_stiff_body_is_what_was_tuned():
    """The usual levels are raised to 0.3 and 1 m/s²/sqrt(Hz), those that a recording told are not."""
    usual, tuned = FilterSettings(), replace(FilterSettings(), least_white=(0.0, 0.0))
    raised, kept = usual.for_stiff_or_large(), tuned.for_stiff_or_large()
    assert (raised.quiet.white, raised.poked.white) == (0.3, 1.0)
    assert (kept.quiet, kept.poked) == (usual.quiet, usual.poked)


def test_the_level_of_a_stiff_body_falls_to_a_quarter():
    """And that of others to a tenth; one that is stated stays."""
    usual, stated = FilterSettings(), FilterSettings(white_bounds=(1.0, 1.0))
    assert usual.white_bounds == (0.1, 16.0)
    assert usual.for_stiff_or_large().white_bounds == (0.25, 16.0)
    assert stated.for_stiff_or_large().white_bounds == (1.0, 1.0)


def test_a_hand_is_as_strong_as_bending_the_body_takes():
    """50 m/s² where gravity returns a body; a tenth of what an elastic one returns with, if that is more.

    Its white noise in proportion; applied again it stays.
    """
    usual = FilterSettings().for_stiff_or_large(9.81)
    assert usual.led == LED
    strong = FilterSettings().for_stiff_or_large(4000.0)
    assert strong.led is not None
    assert (strong.led.poke, strong.led.white) == (pytest.approx(8.0 * LED.poke), pytest.approx(8.0 * LED.white))
    assert strong.for_stiff_or_large(4000.0).led == strong.led


def test_innovations_are_remembered_for_half_a_slow_oscillation():
    """Half a second for what swings in a second or faster."""
    assert FilterSettings().for_stiff_or_large(9.81, 1.0).remember_s == 0.5
    assert FilterSettings().for_stiff_or_large(9.81, 3.0).remember_s == 1.5


def test_blows_have_modes_of_their_own_where_nothing_explains_them():
    """The strongest force, in the last mode, is as strong as a poke but for its jolt; no other has one.

    Not of a body that is led, nor where masses are known to be poked one at a time.
    """
    settings = FilterSettings()
    assert settings.of_state == tuple(range(6))
    assert settings.quiet_modes == (0, 1, 3)
    assert [mode.jolt for mode in settings.modes] == [0.0] * 5 + [settings.jolt]
    assert replace(settings.modes[-1], jolt=0.0) == settings.poked
    assert settings.poked_share(np.array([0.1, 0.2, 0.3, 0.05, 0.15, 0.2])) == pytest.approx(0.65)
    assert settings.blow_share(np.array([0.1, 0.2, 0.3, 0.05, 0.15, 0.2])) == 0.2
    for other in (settings.for_stiff_or_large(), FilterSettings(one_of=3)):
        assert not any(mode.jolt for mode in other.modes)
        assert other.blow_share(np.full(len(other.modes), 1.0 / len(other.modes))) == 0.0


def test_long_run_odds_of_a_poke():
    """Of calm 100 s, between 1.5 s and poked 0.3 s without blows: 0.3 s of a cycle of 0.05 100 + 0.95 1.5 + 0.3 s."""
    cycle = 0.05 * 100.0 + 0.95 * 1.5 + 0.3
    settings = FilterSettings(unstruck_s=np.inf)
    assert settings.poked_share(stationary(settings.rates)) == pytest.approx(0.3 / cycle, rel=1e-9)
