"""Marks of a double pendulum, and the network that stands for it."""

import numpy as np
import pytest

from estimators import MarkMeasurement
from tests.estimators.identification.pendulum import SD, hanging_links, swung


@pytest.fixture(scope="session")
def swing():
    """0.8 s at 100 frames/s from the first frame on in motion, both masses seen to SD."""
    times, places = swung(80)
    noisy = places + np.random.default_rng(4).normal(0.0, SD, places.shape)
    cov = SD**2 * np.eye(2)
    return [
        (float(time_s), [MarkMeasurement(name, place, cov) for name, place in zip(("joint", "end"), now, strict=True)])
        for time_s, now in zip(times, noisy, strict=True)
    ]


@pytest.fixture(scope="session")
def links():
    """The same as a network, by `hanging_links`."""
    return hanging_links
