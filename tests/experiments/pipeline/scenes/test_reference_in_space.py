"""Reference marks correct the pose of each camera in space: the target of moved cameras as that of cameras that stand.

The truth is simulated. Moved cameras draw the pictures; the scene states them as they were calibrated.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

import vision
from estimators import MarkMeasurement, PoseSettings, RigidMotion, coverage, normalised_error_squared
from experiments.formats.scenario import read_scenario
from experiments.formats.scene.marks import Mark
from experiments.formats.scene.reference import Reference, ReferenceMark, reference_places
from experiments.formats.scene.scene import write_scene
from experiments.pipeline.line import FILTER, Line
from experiments.pipeline.sight.camera import CameraPose
from experiments.projects.check import checked
from experiments.simulation.film import draw_in_space
from experiments.simulation.simulate import true_motion
from tests.experiments.command import softaim
from tests.experiments.in_space import breast
from tests.experiments.pipeline.sight.test_space import SCENARIO, recorded
from vision import Exposure, Pose

PLACES_MM = [(-100.0, -60.0), (0.0, -85.0), (100.0, -60.0), (100.0, 60.0), (0.0, 85.0), (-100.0, 60.0)]
HUES_DEG = (40.0, 80.0, 160.0, 200.0, 280.0, 320.0)
DT = 1.0 / 30.0


def marked(names="012345"):
    """The breast before two cameras, with reference marks on the table around it."""
    marks = []
    for name in names:
        x, y = np.array(PLACES_MM[int(name)]) / 1e3
        marks.append(
            ReferenceMark(f"R{name}", position_m=(x, y, 0.0), look=Mark(f"R{name}", HUES_DEG[int(name)], 0.008))
        )
    return replace(breast(), reference=Reference(tuple(marks)))


def moved(camera, change, centre=(0.0, 0.0, 0.0)):
    """The camera in which the world seems to be moved so: shift [m], rotation about the centre [rad]."""
    motion = RigidMotion.none(np.array(centre)).changed(np.array(change, dtype=float))
    return replace(camera, pose=camera.pose.after(Pose(motion.rotation, motion.moved(np.zeros((1, 3)))[0])))


def exposure(scene, time_s, cameras, rng, positions=None):
    x = scene.network.positions if positions is None else positions
    return Exposure(time_s, {one.name: draw_in_space(scene, one, x, vision.Lighting(), rng) for one in cameras})


@pytest.fixture(scope="module")
def truth(tmp_path_factory):
    folder, scene = tmp_path_factory.mktemp("truth"), breast()
    write_scene(scene, folder / "scene.toml")
    (folder / "film.toml").write_text(SCENARIO.format(duration_s=0.6, stagger_s=0.0), "utf-8")
    return true_motion(scene.network, read_scenario(str(folder / "film.toml")), np.random.default_rng(3))


@pytest.fixture(scope="module")
def tracked(truth):
    """Function that tracks the poked target before cameras that `change(time_s, number)` moves."""

    def errors(change):
        scene, found, rng = marked(), [], np.random.default_rng(7)
        line, x, target = Line(scene, baseline=False), scene.network.positions.copy(), scene.network.index("T")
        moves = []
        for time_s, positions in zip(truth.times_s, truth.positions, strict=True):
            x[scene.network.free] = positions
            cameras = [moved(camera, change(time_s, k)) for k, camera in enumerate(scene.space_cameras)]
            step = line.see_all(exposure(scene, float(time_s), cameras, rng, x))
            estimate = step.estimates[FILTER]
            found.append((estimate.mean - x[target], estimate.cov))
            moves += [(camera, move) for camera, move in step.reference.moves.items()]
        away, covs = (np.array(one) for one in zip(*found, strict=True))
        return np.linalg.norm(away, axis=1).mean(), coverage(normalised_error_squared(away, covs), 3), moves

    return errors


@pytest.fixture(scope="module")
def standing(tracked):
    return tracked(lambda _time_s, _number: np.zeros(6))


BY_10_MM = (0.006, 0.0, 0.008, 0.0, 0.0, 0.0)
BY_2_DEGREES = (0.0, 0.0, 0.0, np.radians(2.0), 0.0, 0.0)


def test_the_target_before_cameras_that_are_moved_is_as_before_ones_that_stand(tracked, standing):
    """The left one by 10 mm, later the right one by 2 degrees."""
    changes, moved_s = np.array([BY_10_MM, BY_2_DEGREES]), (0.2, 0.4)
    error, covered, moves = tracked(lambda time_s, number: changes[number] * (time_s > moved_s[number]))
    assert error < 1.1 * standing[0]
    assert covered >= 0.9
    assert [camera for camera, _ in moves] == ["left", "right"]
    for (_, move), change, time_s in zip(moves, changes, moved_s, strict=True):
        assert move.time_s == pytest.approx(time_s, abs=1.1 * DT)
        assert move.distance_m == pytest.approx(np.linalg.norm(change[:3]), abs=3e-4)
        assert move.angle_rad == pytest.approx(np.linalg.norm(change[3:]), abs=3e-3)


def test_the_target_before_cameras_that_drift_apart_by_1_mm_s_is_as_before_standing_ones(tracked, standing):
    rate = np.array([0.8e-3, 0.6e-3, 0.0, 0.0, 0.0, 0.0])
    error, covered, _ = tracked(lambda time_s, number: time_s * rate * (1 if number else -1))
    assert error < 1.1 * standing[0]
    assert covered >= 0.9


def test_marks_are_covered_where_calibration_pose_and_stated_places_are_wrong():
    """NEES of a mark: lenses, poses, pose errors, a move and, in every other world, places are drawn as stated."""
    steps, nees, settings = np.zeros((5, 15)), [], PoseSettings()
    steps[0, [0, 1]], steps[1, 2], steps[2, 9], steps[3, 12], steps[4, 14] = 2.0, 1.0, 2e-3, 1e-3, 1e-3
    for seed in range(10):
        rng, scene, place_sd_m = np.random.default_rng(seed), marked(), (5e-4, 0.0)[seed % 2]
        calibrated = tuple(replace(camera, calibration=steps) for camera in scene.space_cameras)
        scene, errors = replace(scene, space_cameras=calibrated), rng.normal(size=(2, 5)) @ steps
        true = [
            replace(one, lens=one.lens.moved(error[:9]), pose=one.pose.moved(error[9:]))
            for one, error in zip(calibrated, errors, strict=True)
        ]
        wrong = [np.array(mark.position_m) + rng.normal(0.0, place_sd_m, 3) for mark in scene.reference.marks]
        wrong = [replace(mark, position_m=at) for mark, at in zip(scene.reference.marks, wrong, strict=True)]
        drawn, scene = scene, replace(scene, reference=Reference(tuple(wrong), position_sd_m=place_sd_m))
        centre = np.mean([mark.position_m for mark in drawn.reference.marks], axis=0)
        starts = rng.normal(0.0, np.repeat([settings.start_m, settings.start_rad], 3), (2, 6))
        true = [moved(one, start, centre) for one, start in zip(true, starts, strict=True)]
        line, change = Line(scene, baseline=False), rng.normal(0.0, 0.007, 6)
        assert scene.n_calibration == len(scene.calibration_steps[0]) + 12
        for k in range(2):
            cameras = [moved(true[0], change * (k > 0)), true[1]]
            step = line.see_all(exposure(drawn, k * DT, cameras, rng))
        (mark,) = (mark for mark in step.marks if mark.node == "S1")
        off = mark.position - scene.network.positions[scene.network.index("S1")]
        nees.append(off @ np.linalg.solve(mark.total_cov, off))
    low, high = chi2.ppf([0.001, 0.999], 3 * len(nees))
    assert low < np.sum(nees) < high


def test_errors_of_a_pose_turn_it_about_the_centre_of_its_reference_marks():
    """Steps of the pose before the first picture against differences: the settings' sd along and about each axis."""
    scene, settings = marked("23"), PoseSettings()
    sight, centre = CameraPose(scene, 1).sight, np.array([0.1, 0.0, 0.0])
    points = np.random.default_rng(0).uniform(-0.05, 0.05, (5, 3))
    shifts = sight.camera.moved_by(points, sight.steps)
    assert shifts.shape == (5, 2, 12)
    np.testing.assert_array_equal(shifts[:, :, :6], 0.0)  # the pose of the other camera
    for k, change in enumerate(np.diag(np.repeat([settings.start_m, settings.start_rad], 3))):
        there, back = (RigidMotion.none(centre).changed(way * change).moved(points) for way in (1.0, -1.0))
        slope = 0.5 * (sight.camera.project(there) - sight.camera.project(back))
        np.testing.assert_allclose(shifts[:, :, 6 + k], slope, atol=2e-3)


def test_marks_that_no_reference_mark_corrects_are_known_less_and_less_well():
    scene, rng = marked(), np.random.default_rng(1)
    line, hidden = Line(scene, baseline=False), breast()

    def sd_m(k, drawn):
        step = line.see_all(exposure(drawn, k * DT, scene.space_cameras, rng))
        (mark,) = (mark for mark in step.marks if mark.node == "S1")
        return step.reference.seen, np.sqrt(np.trace(mark.total_cov))

    seen = [sd_m(k, scene) for k in range(5)]
    unseen = [sd_m(k, hidden) for k in range(5, 20)]
    assert all(len(names) == 6 for names, _ in seen)
    assert not any(names for names, _ in unseen)
    assert unseen[-1][1] > 2.0 * seen[-1][1]


@pytest.mark.usefixtures("without_pictures")
def test_a_camera_moved_since_its_calibration_is_reported_and_corrected(tmp_path: Path, capsys):
    scene = marked()
    left, right = scene.space_cameras
    folder = recorded(tmp_path, replace(scene, space_cameras=(moved(left, BY_10_MM), right)), duration_s=0.2)
    write_scene(scene, tmp_path / "stated.toml")
    assert softaim("track", folder, "--scene", tmp_path / "stated.toml", "--out", tmp_path / "out") == 0
    assert "camera left: moved by 10.0 mm, 0.0 deg: corrected by reference marks" in capsys.readouterr().err
    errors_mm = np.genfromtxt(tmp_path / "out" / "estimates.csv", delimiter=",", names=True)["err_mm"]
    assert errors_mm[3:].max() < 1.0


def calibrated():
    """The scene with cameras whose focal lengths are uncertain by 2 px."""
    steps, scene = np.zeros((1, 15)), marked()
    steps[0, 0] = 2.0
    return replace(scene, space_cameras=tuple(replace(one, calibration=steps) for one in scene.space_cameras))


def test_check_includes_calibration_errors_that_reference_marks_share(tmp_path: Path):
    scene = calibrated()
    write_scene(scene, tmp_path / "scene.toml")
    done = checked(tmp_path / "scene.toml")
    assert not done.unfound
    for mark in done.seen:
        assert mark.shared is not None
        assert np.linalg.norm(mark.shared[:, :2]) > 0.0
        assert mark.shared.shape == (3, 2 + 12 - 6)
    # mean of the marks by both cameras: from the pixels' error and 2 of 1100 px at up to 0.06 m from the axis
    assert 1e-5 < done.mark_sd_m < 2e-4


def test_marks_of_another_tracker_are_corrected_together_beside_calibrated_cameras():
    scene = calibrated()
    line, shift = Line(scene, baseline=False), np.array([0.006, 0.0, 0.008])
    network = scene.network
    places = {node: network.positions[network.index(node)] for node in scene.measured_nodes}
    places |= reference_places(scene.reference, network)
    seen = [MarkMeasurement(name, place + shift, 1e-8 * np.eye(3)) for name, place in places.items()]
    step = line.take(0.0, seen)
    assert step.reference.moves.keys() == {""}
    for mark in step.marks:
        assert np.linalg.norm(mark.position - places[mark.node]) < 1e-4


def test_reference_marks_before_cameras_need_a_look():
    scene = marked()
    (first, *others) = scene.reference.marks
    with pytest.raises(ValueError, match="expected hue_deg and diameter_mm, which a camera needs, found none"):
        replace(scene, reference=Reference((replace(first, look=None), *others)))
