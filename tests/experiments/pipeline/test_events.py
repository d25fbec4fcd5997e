"""What is reported of a scene on standard error before a run."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.formats.scenario import read_scenario
from experiments.pipeline.events import rest_line, rest_offsets
from experiments.simulation.simulate import scene_of


@pytest.fixture(scope="module")
def scene():
    return scene_of(read_scenario("webcam"))


def drawn_off(scene, node: str, by_m):
    """The scene with one node drawn so far from where it rests [m]."""
    positions = scene.network.positions.copy()
    positions[scene.network.index(node)] += by_m
    return replace(scene, network=replace(scene.network, positions=positions))


def test_a_network_that_rests_where_it_is_drawn_is_not_mentioned(scene):
    """The phantom does, to rounding; a node drawn 0.3 mm off is within a thousandth of its half metre."""
    assert rest_offsets(scene).max() < 1e-9
    assert rest_line(scene) is None
    assert rest_line(drawn_off(scene, "M1", [3e-4, 0.0])) is None


def test_one_that_does_not_is_said_by_how_much(scene):
    """M1 drawn 3 and 4 mm off, hence 5 mm: it rests where it did, and so do all others."""
    off = drawn_off(scene, "M1", [3e-3, -4e-3])
    offsets = rest_offsets(off)
    assert offsets[scene.network.index("M1")] == pytest.approx(5e-3, abs=1e-9)
    assert np.delete(offsets, scene.network.index("M1")).max() < 1e-9
    said = rest_line(off)
    assert said is not None
    assert "up to 5.0 mm from where it is drawn (node M1; the target's 0.0 mm)" in said
    assert "softaim identify RECORDING --at-rest" in said
    assert said.isprintable()
