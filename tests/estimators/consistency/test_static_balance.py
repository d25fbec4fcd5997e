"""Forces that go on, against equilibria under known forces."""

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER, four_mass_phantom, rest_shape
from estimators import FilterSettings, MarkMeasurement, StaticBalance, TissueFilter

COV = 1e-9 * np.eye(2)


@pytest.fixture(scope="module")
def tissue() -> TissueFilter:
    return TissueFilter(four_mass_phantom(), HIDDEN, OUTER)


def seen(network, positions):
    return [MarkMeasurement(node, positions[network.index(node)], COV) for node in OUTER]


def after_a_second(balance: StaticBalance, network, positions):
    found = None
    for k in range(31):
        found = balance.update(k / 30.0, seen(network, positions))
    assert found is not None
    return found


def test_the_force_is_that_under_which_the_body_rests(tissue):
    """By `rest_shape` under a force on M1, of 0.02 N: so small that the stiffness at rest holds to 1 %."""
    network = tissue.network
    force = np.zeros((len(network.free), 2))
    force[list(network.free).index(network.index("M1"))] = [0.02, -0.01]
    found = after_a_second(StaticBalance(tissue), network, rest_shape(network, force))
    expected = np.zeros((3, 2))
    expected[found.nodes.index("M1")] = [0.02, -0.01]
    np.testing.assert_allclose(found.force, expected, atol=2e-4)
    assert found.probability > 0.5


def test_what_pushes_all_nodes_alike_is_a_breath_and_what_pulls_one_is_none(tissue):
    """2 N on each of three marks and 2 N on one: the pokes' mean has a sd of 5 m/s² 0.2 kg (0.4 / 6)^½ = 0.26 N."""
    network = tissue.network
    rows = [list(network.free).index(network.index(node)) for node in OUTER]
    alike, alone = np.zeros((2, len(network.free), 2))
    alike[rows] = [0.0, 2.0]
    alone[rows[0]] = [2.0, 0.0]
    balance = StaticBalance(tissue)
    assert after_a_second(balance, network, rest_shape(network, alike)).probability > 0.01
    balance.forget()
    assert balance.update(0.0, seen(network, network.positions)) is None
    balance.forget()
    assert after_a_second(balance, network, rest_shape(network, alone)).probability < 1e-6


def test_a_body_that_sways_far_is_not_squeezed(tissue):
    """Under 1.5 N on each mark it sways by 60 mm: the force is found to 0.1 N; the stiffness at rest errs by 1.2 N."""
    network = tissue.network
    force = np.zeros((len(network.free), 2))
    force[[list(network.free).index(network.index(node)) for node in OUTER]] = [1.5, 0.0]
    found = after_a_second(StaticBalance(tissue), network, rest_shape(network, force))
    np.testing.assert_allclose(found.force, [[1.5, 0.0]] * 3, atol=0.1)


def test_a_body_with_a_node_that_is_led_has_no_balance():
    network = four_mass_phantom()
    balance = StaticBalance(TissueFilter(network, HIDDEN, OUTER, FilterSettings(led_nodes=("M1",))))
    assert all(balance.update(k / 30.0, seen(network, network.positions)) is None for k in range(40))
