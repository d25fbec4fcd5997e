"""Marks corrected by reference marks: the target where the camera drifts, is moved, is turned, as where it stands."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import vision
from estimators import CameraMove, MarkMeasurement, RigidMotion, Status, coverage, normalised_error_squared
from experiments.formats.scenario import SeenMarks, read_scenario
from experiments.formats.scene.marks import Mark
from experiments.formats.scene.reference import Reference, ReferenceMark, reference_places
from experiments.pipeline.events import report_move
from experiments.pipeline.line import FILTER, Line
from experiments.simulation.film import draw
from experiments.simulation.seen_marks import Truth, seen_marks
from experiments.simulation.simulate import scene_of, true_motion

LOOK = Mark("", 300.0, 0.03)
DT = 1.0 / 30.0


def moved_camera(scene, change):
    """The scene with its camera moved so, as reference marks show it."""
    places = reference_places(scene.reference, scene.network)
    motion = RigidMotion.none(np.mean(list(places.values()), axis=0)).changed(np.array(change))
    camera = scene.cameras[0].moved(motion.rotation, motion.moved(np.zeros((1, 2)))[0])
    return replace(scene, cameras=(camera,))


def filmed_scene():
    """The four-mass phantom with reference marks on its anchors, before a fine camera."""
    scene = scene_of(read_scenario("webcam"))
    anchors = [name for name, fixed in zip(scene.network.names, scene.network.fixed, strict=True) if fixed]
    marks = tuple(ReferenceMark(f"R{k}", node, look=replace(LOOK, node=f"R{k}")) for k, node in enumerate(anchors))
    return replace(scene, reference=Reference(marks))


def unfilmed_scene():
    """The same phantom, whose marks another tracker measures."""
    scene = scene_of(read_scenario("poked"))
    anchors = [name for name, fixed in zip(scene.network.names, scene.network.fixed, strict=True) if fixed]
    marks = tuple(ReferenceMark(f"R{k}", node) for k, node in enumerate(anchors))
    return replace(scene, cameras=(), reference=Reference(marks))


@cache
def target_scores(change=(0.0, 0.0, 0.0)):
    """Mean error of the poked target [m], share covered; after 0.7 s the camera is moved by this, (3,)."""
    scene = unfilmed_scene()
    scenario = read_scenario("poked").model_copy(update={"seed": 101, "duration_s": 1.2})
    truth = true_motion(scene.network, scenario, np.random.default_rng(101))
    names, rng, cov = [scene.network.names[i] for i in scene.network.free], np.random.default_rng(7), 1e-6 * np.eye(2)
    still = reference_places(scene.reference, scene.network)
    motion, line, errors = RigidMotion.none(np.mean(list(still.values()), axis=0)), Line(scene, baseline=False), []
    covs = []
    for time_s, positions in zip(truth.times_s, truth.positions, strict=True):
        places = {node: positions[names.index(node)] for node in scene.measured_nodes} | still
        moved = motion.changed(np.array(change) if time_s > 0.7 else np.zeros(3))
        seen = moved.moved(np.array(list(places.values()))) + rng.normal(0.0, 1e-3, (len(places), 2))
        marks = [MarkMeasurement(name, place, cov) for name, place in zip(places, seen, strict=True)]
        found = line.take(float(time_s), marks).estimates[FILTER]
        errors.append(found.mean - positions[names.index(scene.target.node)])
        covs.append(found.cov)
    nees = normalised_error_squared(np.array(errors), np.array(covs))
    return np.linalg.norm(errors, axis=1).mean(), coverage(nees, 2)


def filmed(line, scene, time_s, lit=None):
    rng = np.random.default_rng(round(time_s / DT))
    image = draw(scene, scene.network.positions, lit or vision.Lighting(), rng, strays=[])
    return line.see(time_s, image)


@pytest.mark.parametrize("change", [(8e-3, 6e-3, 0.0), (0.0, 0.0, np.radians(2.0))])
def test_the_target_of_a_moving_camera_is_as_that_of_one_that_stands(change):
    error, covered = target_scores(change)
    assert error < 1.2 * target_scores()[0]
    assert covered >= 0.9


@pytest.mark.parametrize("change", [(8e-3, 6e-3, 0.0), (3e-2, 0.0, 0.03)])
def test_a_film_of_a_camera_that_was_moved_loses_no_mark_and_says_so_once(change):
    scene = filmed_scene()
    line, rest = Line(scene, baseline=False), scene.network.positions
    steps = [filmed(line, scene, k * DT) for k in range(8)]
    steps += [filmed(line, moved_camera(scene, change), k * DT) for k in range(8, 14)]
    assert {step.estimates[FILTER].marks_used for step in steps} == {len(scene.measured_nodes)}
    assert all(len(step.reference.seen) == 3 for step in steps)
    (report,) = [move for step in steps for move in step.reference.moves.values()]
    assert report.time_s == pytest.approx(8 * DT)
    assert report.distance_m == pytest.approx(np.hypot(*change[:2]), abs=1e-3)
    assert report.angle_rad == pytest.approx(change[2], abs=5e-3)
    for mark in steps[-1].marks:
        assert np.linalg.norm(mark.position - rest[scene.network.index(mark.node)]) < 1e-3
    assert steps[-1].estimates[FILTER].status == Status.TRACKING


def test_a_film_is_drawn_by_the_camera_as_it_stands():
    scene, change = filmed_scene(), (8e-3, 6e-3, 0.02)
    line = Line(scene, baseline=False)
    for k in range(3):
        filmed(line, moved_camera(scene, change), k * DT)
    rest = scene.network.positions
    true_px = moved_camera(scene, change).cameras[0].project(rest)
    np.testing.assert_allclose(line.camera.project(rest), true_px, atol=0.5)


def test_hidden_reference_marks_leave_the_pose_and_widen_what_is_known():
    scene = unfilmed_scene()
    line, cov = Line(scene, baseline=False), 1e-6 * np.eye(2)
    still = reference_places(scene.reference, scene.network)
    of_tissue = {node: scene.network.positions[scene.network.index(node)] for node in scene.measured_nodes}

    def taken(k, places):
        return line.take(k * DT, [MarkMeasurement(name, place, cov) for name, place in places.items()])

    for k in range(30):
        seen = taken(k, of_tissue | still)
    for k in range(30, 60):
        unseen = taken(k, of_tissue)
    assert seen.reference.seen == tuple(still)
    assert unseen.reference.seen == ()
    covs = [np.trace(step.marks[0].total_cov - step.marks[0].cov) for step in (seen, unseen)]
    assert covs[1] > 2.0 * covs[0]
    assert unseen.estimates[FILTER].status == Status.TRACKING


def test_simulated_marks_and_films_have_the_reference_marks():
    scene = filmed_scene()
    rest = scene.network.positions[scene.network.free]
    truth = Truth(DT * np.arange(3), np.tile(rest, (3, 1, 1)))
    recording = seen_marks(scene, truth, SeenMarks(sd_mm=0.1), np.random.default_rng(0))
    places = reference_places(scene.reference, scene.network)
    for frame in recording.marks:
        rows = {row.node: row.position_m for row in frame}
        assert set(places) < set(rows)
        assert all(np.linalg.norm(rows[name] - place) < 1e-3 for name, place in places.items())
    step = filmed(Line(scene, baseline=False), scene, 0.0)
    assert set(step.reference.seen) == set(places)


def test_a_move_is_reported_in_mm_and_degrees(caplog):
    report_move(CameraMove(0.0, 0.0104, np.radians(2.0)))
    assert caplog.messages == ["0.00 s: camera: moved by 10.4 mm, 2.0 deg: corrected by reference marks"]
