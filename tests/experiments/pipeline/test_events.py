"""What is reported of a scene on standard error before a run."""

from dataclasses import replace

import numpy as np
import pytest

from estimators import FilterSettings
from experiments.formats.scenario import read_scenario
from experiments.formats.scene.scene import with_step
from experiments.pipeline.events import rest_line, rest_offsets, scene_line, steps_left_out
from experiments.simulation.simulate import scene_of


@pytest.fixture(scope="module")
def scene():
    """One that the usual filter follows, which can be tuned."""
    return replace(scene_of(read_scenario("webcam")), settings=FilterSettings())


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


def tuned(scene):
    """The scene with a level of discrepancy of its own, and the step that gave it."""
    settings = replace(scene.settings, discrepancy=0.0123)
    return with_step(replace(scene, settings=settings), "tune", "1")


def damped(scene):
    """The scene with more drag: it rests where it did."""
    return replace(scene, network=replace(scene.network, drag=scene.network.drag + 0.1))


def test_each_step_that_was_left_out_is_named_with_what_that_means(scene):
    """Those before the command, and no others."""
    off = drawn_off(scene, "M1", [3e-3, -4e-3])
    assert list(steps_left_out(off, "simulate")) == ["at-rest"]
    assert list(steps_left_out(off, "identify")) == ["at-rest"]
    assert list(steps_left_out(off, "tune")) == ["at-rest", "identify"]
    lines = steps_left_out(off, "track")
    assert list(lines) == ["at-rest", "identify", "tune"]
    assert lines["identify"] == "constants were not identified (softaim identify): no covariance has their errors"
    assert lines["tune"] == (
        "settings were not tuned (softaim tune): covariances may be too large, probabilities too low"
    )


def test_what_was_done_is_not_left_out(scene):
    found = with_step(scene, "identify", "1")
    assert list(steps_left_out(found, "track")) == ["tune"]
    assert steps_left_out(tuned(found), "track") == {}
    assert list(steps_left_out(with_step(scene, "simulate", "1"), "track")) == ["tune"]
    assert list(steps_left_out(tuned(scene), "track")) == ["identify"]


def test_what_was_changed_by_hand_since_is_left_out_again(scene):
    changed = steps_left_out(damped(tuned(with_step(scene, "identify", "1"))), "track")
    assert list(changed) == ["identify"]
    assert "not identified since the network was changed after softaim tune" in changed["identify"]
    again = steps_left_out(with_step(tuned(scene), "identify", "1"), "track")
    assert "tuned before softaim identify, for other constants" in again["tune"]


def test_rest_that_was_found_is_not_left_out_until_the_network_is_changed_by_hand(scene):
    """Constants found later move it: that is no reason to find it again. Another step than this finds no rest."""
    off = drawn_off(scene, "M1", [3e-3, -4e-3])
    rested = with_step(with_step(off, "at-rest", "1"), "identify", "1")
    assert "at-rest" not in steps_left_out(rested, "track")
    assert "at-rest" in steps_left_out(with_step(off, "identify", "1"), "track")
    assert "at-rest" in steps_left_out(drawn_off(rested, "M1", [1e-3, 0.0]), "track")


def test_what_is_assumed_is_one_line(scene):
    """Of the phantom: four free nodes, three of them measured."""
    assert scene_line(scene) == (
        f"scene: 4 free nodes and {len(scene.network.springs)} springs in 2 dimensions, marks measured on M1, M3, M4, "
        "target M2; constants exact; levels the usual; done: nothing"
    )
    done = with_step(tuned(with_step(scene, "at-rest", "1")), "identify", "1")
    assert scene_line(done).endswith("levels its own; done: at-rest, tune, identify")


def test_a_target_that_is_measured_is_said(scene):
    seen = replace(scene, marks=tuple(replace(mark, measured=True) for mark in scene.marks))
    line = steps_left_out(with_step(seen, "identify", "1"), "identify")["hidden target"]
    assert "the target M2 has a measured mark" in line
    assert "hidden target" not in steps_left_out(scene, "track")
