"""The study of identified constants' standard errors: its phantom, one short fit, its table."""

import numpy as np
import pandas as pd
import pytest

from dynamics import node_forces, pack
from experiments.studies.estimation.identification import PRIOR_SD, five_mass_phantom, identified, page_table, pulls


def test_the_users_phantom_rests_where_it_stands():
    network = five_mass_phantom()
    rest = network.positions
    forces = node_forces(network, rest, np.zeros_like(rest))
    np.testing.assert_allclose(forces[network.free], 0.0, atol=1e-6)
    assert pack(rest[network.free], np.zeros((5, 2))).shape == (network.n_state,) == (20,)


@pytest.mark.slow
def test_a_short_fit_states_what_it_knows():
    """1.2 s of five masses: errors within 4.5 standard errors, rest lengths nearer, none surer than known."""
    table = pd.DataFrame(identified({"phantom": "five-mass", "seed": 7, "duration_s": 1.2}))
    prior = np.array([PRIOR_SD[kind] for kind in table["kind"]])
    assert len(table) == 3 * 14 + 2 * 5
    assert (np.abs(table["error"] / table["sd"]) < 4.5).all()
    assert (table["sd"] < 1.2 * prior).all()
    rest = table[table["kind"] == "rest_length"]
    assert (rest["error"] ** 2).mean() < (rest["before"] ** 2).mean()


def test_pulls_and_their_table():
    """Errors of 1 and 3 standard errors: mean 2, spread sqrt 2, out of both bounds; of -1 and 1: mean 0."""
    rows = [("built-in", "drag", s, e, 0.5, 0.1) for s, e in ((1, 0.1), (2, 0.3))]
    rows += [("built-in", "damping", s, e, 0.5, 0.1) for s, e in ((1, -0.08), (2, 0.08))]
    table = pd.DataFrame(rows, columns=["phantom", "kind", "seed", "error", "before", "sd"])
    found = pulls(table)
    assert found["built-in", "drag"]["mean"] == pytest.approx(2.0)
    assert found["built-in", "drag"]["spread"] == pytest.approx(np.sqrt(2.0))
    assert page_table(found).splitlines()[2:] == [
        "| built-in | drag | 2 | **2.00**, **1.41** | 50%, 22.4% | 10% |",
        "| built-in | damping | 2 | 0.00, 1.13 | 50%, 8% | 10% |",
    ]
