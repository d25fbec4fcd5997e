"""Rates of the modes that follow from the settings."""

import numpy as np

from estimators import FilterSettings


def test_odds_of_the_modes():
    """Rates: rows sum to zero, 1/100 and 1/1.5 a second into a poke, 1/0.3 out of it, 5 % of that into calm."""
    rates = FilterSettings().rates
    np.testing.assert_allclose(rates.sum(axis=1), 0.0, atol=1e-15)
    expected = [[-1 / 100, 0, 1 / 100], [0, -1 / 1.5, 1 / 1.5], [0.05 / 0.3, 0.95 / 0.3, -1 / 0.3]]
    np.testing.assert_allclose(rates, expected, rtol=1e-14)


def test_where_led_nodes_are_stated_no_other_is_led():
    """Three modes of a stiff body in place of four, between which the rates keep probability."""
    stated = FilterSettings(led_nodes=("grip",)).for_stiff_or_large()
    assert len(FilterSettings().for_stiff_or_large().modes) == 4
    assert stated.modes == (stated.quiet, stated.quiet, stated.poked)
    np.testing.assert_allclose(stated.rates, FilterSettings().rates, rtol=1e-14)
