"""Scales of a body."""

import pytest

from experiments.simulation.bodies.body import Scale
from experiments.simulation.bodies.zoo import BODIES, make_body


def test_another_size_sags_by_the_same_share():
    """The ratio m g / (k L) stays: k with the square of the size, m with its cube."""
    scale = Scale(size=10.0)
    assert scale.m / (scale.k * scale.size) == pytest.approx(1.0)
    assert scale.c == pytest.approx((scale.k * scale.m) ** 0.5)
    assert (scale.oscillation, scale.swing) == pytest.approx((10.0**0.5, 10.0**0.5))


@pytest.mark.parametrize("name", ["chain3", "phantom", "sheet"])
def test_sizes_go_with_the_scale(name):
    assert set(BODIES) >= {name}
    plain, large = (make_body(name, 0, Scale(size=size), seconds=0.1) for size in (1.0, 10.0))
    assert large.size_m == pytest.approx(10.0 * plain.size_m, rel=0.01)
    assert large.mark_sd_m == pytest.approx(10.0 * plain.mark_sd_m)
