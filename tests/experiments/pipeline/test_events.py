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
    offsets = rest_offsets(off(scene))
    assert offsets[scene.network.index("M1")] == pytest.approx(5e-3, abs=1e-9)
    assert np.delete(offsets, scene.network.index("M1")).max() < 1e-9
    said = rest_line(off(scene))
    assert "up to 5.0 mm from its drawing (node M1; target 0.0 mm)" in said
    assert "softaim identify RECORDING --at-rest" in said
    assert said.isprintable()


def tuned(scene):
    """The scene with a level of discrepancy of its own, and the step that gave it."""
    settings = replace(scene.settings, discrepancy=0.0123)
    return with_step(replace(scene, settings=settings), "tune", "1")


def damped(scene):
    """The scene with more drag: it rests where it did."""
    return replace(scene, network=replace(scene.network, drag=scene.network.drag + 0.1))


def off(scene):
    """The scene with M1 drawn 5 mm off."""
    return drawn_off(scene, "M1", [3e-3, -4e-3])


def found(scene):
    """The scene after its constants were identified."""
    return with_step(scene, "identify", "1")


def simulated(scene):
    """The scene of a simulated recording: its constants are the true ones."""
    return with_step(scene, "simulate", "1")


def rested(scene):
    """The scene drawn 5 mm off after its rest and then its constants were found, which move it again."""
    return found(with_step(off(scene), "at-rest", "1"))


@pytest.mark.parametrize(
    ("made", "command", "left_out"),
    [
        (off, "simulate", ["at-rest"]),
        (off, "identify", ["at-rest"]),
        (off, "tune", ["at-rest", "identify"]),
        (off, "track", ["at-rest", "identify", "tune"]),
        (found, "track", ["tune"]),
        (lambda scene: tuned(found(scene)), "track", []),
        (simulated, "simulate", []),
        (simulated, "track", ["simulated truth", "tune"]),
        (lambda scene: tuned(simulated(scene)), "track", ["simulated truth"]),
        (lambda scene: found(simulated(scene)), "track", ["tune"]),
        (lambda scene: damped(simulated(scene)), "track", ["identify", "tune"]),
        (tuned, "track", ["identify"]),
        (lambda scene: damped(tuned(found(scene))), "track", ["identify"]),
        (lambda scene: found(tuned(scene)), "track", ["tune"]),
        (rested, "track", ["tune"]),
        (lambda scene: found(off(scene)), "track", ["at-rest", "tune"]),
        (lambda scene: drawn_off(rested(scene), "M1", [1e-3, 0.0]), "track", ["at-rest", "identify", "tune"]),
    ],
)
def test_steps_before_a_command_that_were_not_done_are_left_out(scene, made, command, left_out):
    """Nor are those that were done before the network was edited, or constants were found."""
    assert list(steps_left_out(made(scene), command)) == left_out


def test_a_step_that_was_left_out_is_named_with_what_that_means(scene):
    lines = steps_left_out(off(scene), "track")
    unknown = "constants were not identified (softaim identify): covariances do not include their errors"
    assert lines["identify"] == unknown
    assert lines["tune"] == "noise levels were not tuned (softaim tune): covariances and probabilities may be wrong"
    changed = steps_left_out(damped(tuned(found(scene))), "track")["identify"]
    assert "not identified since the network was changed after softaim tune" in changed
    assert "tuned before softaim identify, for other constants" in steps_left_out(found(tuned(scene)), "track")["tune"]


def test_constants_of_the_simulation_are_reported(scene):
    line = steps_left_out(simulated(scene), "track")["simulated truth"]
    assert "the constants are the simulated truth" in line
    assert "--scene" in line


def test_what_is_assumed_is_one_line(scene):
    """Of the phantom: four free nodes, three of them measured."""
    assert scene_line(scene) == (
        f"scene: 4 free nodes and {len(scene.network.springs)} springs in 2 dimensions, marks measured on M1, M3, M4, "
        "target M2; constants exact; noise levels default; done: nothing"
    )
    done = with_step(tuned(with_step(scene, "at-rest", "1")), "identify", "1")
    assert scene_line(done).endswith("noise levels stated; done: at-rest, tune, identify")


def test_a_target_that_is_measured_is_said(scene):
    seen = replace(scene, marks=tuple(replace(mark, measured=True) for mark in scene.marks))
    line = steps_left_out(with_step(seen, "identify", "1"), "identify")["hidden target"]
    assert "the target M2 is not hidden" in line
    assert "hidden target" not in steps_left_out(scene, "track")
