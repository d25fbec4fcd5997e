"""Marks of a double pendulum, and the network that stands for it."""

import numpy as np
import pytest

from dynamics import MassSpringNetwork
from estimators import MarkMeasurement
from tests.estimators.identification.pendulum import GRAVITY, LENGTHS, MASSES, SD, swung


@pytest.fixture(scope="session")
def swing():
    """1.6 s at 100 frames/s from the first frame on in motion, both masses seen to SD."""
    times, places = swung(160)
    noisy = places + np.random.default_rng(4).normal(0.0, SD, places.shape)
    cov = SD**2 * np.eye(2)
    return [
        (float(time_s), [MarkMeasurement(name, place, cov) for name, place in zip(("joint", "end"), now, strict=True)])
        for time_s, now in zip(times, noisy, strict=True)
    ]


@pytest.fixture(scope="session")
def links():
    """The same as a network: links of 2,000 N/m, hanging, with rest lengths by these factors and this gravity."""

    def network(factors=(1.0, 1.0), gravity=GRAVITY):
        depths = np.array([0.0, -LENGTHS[0], -LENGTHS.sum()])
        return MassSpringNetwork(
            names=("pin", "joint", "end"),
            positions=np.column_stack([np.zeros(3), depths]),
            masses=np.array([1.0, *MASSES]),
            fixed=np.array([True, False, False]),
            drag=np.zeros(3),
            friction=np.zeros(3),
            springs=np.array([[0, 1], [1, 2]]),
            stiffness=np.full(2, 2000.0),
            rest_lengths=LENGTHS * factors,
            damping=np.full(2, 0.5),
            gravity=np.array([0.0, -gravity]),
        )

    return network
