"""The pose error by reference marks: against least squares, its consistency, moves, wrong marks, and what is unseen."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.stats import chi2

from estimators import MarkMeasurement, PoseFilter, PoseSettings, RigidMotion
from tests.vision.cameras.test_space_camera import camera_at
from vision import Pose

SD_M = 1e-3
DT = 1.0 / 30.0
PLACES = {
    2: {"A": (-0.2, 0.0), "B": (0.0, 0.05), "C": (0.2, 0.0), "D": (0.1, -0.1)},
    3: {"A": (-0.1, 0.0, 0.0), "B": (0.1, 0.0, 0.02), "C": (0.0, 0.1, 0.0), "D": (0.0, -0.1, -0.02)},
}
N_CHANGES = {2: 3, 3: 6}
NEVER = replace(PoseSettings(), moved_each_s=1e12, rate_m_s=1e-9, rate_rad_s=1e-9)
"""A camera that neither drifts nor is moved."""


def seen(motion, dim, rng, names="ABCD", sd_m=SD_M):
    """Reference marks as a camera with this pose error gives them."""
    places = np.array([PLACES[dim][name] for name in names])
    noisy = motion.moved(places) + rng.normal(0.0, sd_m, places.shape)
    return [MarkMeasurement(name, place, SD_M**2 * np.eye(dim)) for name, place in zip(names, noisy, strict=True)]


def centred(dim, names="ABCD"):
    return RigidMotion.none(np.mean([PLACES[dim][name] for name in names], axis=0))


def made(dim, names="ABCD", settings=None):
    return PoseFilter({name: np.array(PLACES[dim][name]) for name in names}, settings)


def run(pose, motions, dim, rng, names="ABCD"):
    """The filter through frames of these motions; what it reported."""
    reports = []
    for k, motion in enumerate(motions):
        pose.predict(k * DT)
        reports.append(pose.update(seen(motion, dim, rng, names)))
    return reports


@pytest.mark.parametrize("dim", [2, 3])
def test_a_camera_that_stands_is_estimated_as_by_least_squares(dim):
    rng, true = np.random.default_rng(dim), centred(dim).changed(np.full(N_CHANGES[dim], 5e-4))
    pose, frames = made(dim, settings=NEVER), [seen(true, dim, rng) for _ in range(20)]
    for k, marks in enumerate(frames):
        pose.predict(k * DT)
        pose.update(marks)
    # x = (H'H / sd² + prior^-1)^-1 H'y / sd², linear about no error
    none = centred(dim)
    places = np.array([PLACES[dim][name] for name in "ABCD"])
    H = none.change_of(places).reshape(-1, N_CHANGES[dim])
    prior = np.repeat([NEVER.start_m, NEVER.start_rad], [dim, N_CHANGES[dim] - dim])
    information = len(frames) * H.T @ H / SD_M**2 + np.diag(prior**-2)
    y = sum((np.array([mark.position for mark in marks]) - places).ravel() for marks in frames)
    white = np.linalg.cholesky(information)
    np.testing.assert_allclose(white.T @ pose.estimate.cov @ white, np.eye(N_CHANGES[dim]), atol=0.02)
    expected = np.linalg.solve(information, H.T @ y / SD_M**2)
    np.testing.assert_allclose(none.change_to(pose.estimate.motion), expected, atol=5e-6)


@pytest.mark.parametrize("dim", [2, 3])
def test_nees_of_a_drifting_pose_is_within_its_bounds(dim):
    s, n, runs = PoseSettings(), N_CHANGES[dim], []
    sds = np.repeat([s.rate_m_s, s.rate_rad_s], [dim, n - dim])
    a = np.exp(-DT / s.lasting_s)
    for seed in range(8):
        rng = np.random.default_rng([dim, seed])
        start = np.repeat([s.start_m, s.start_rad], [dim, n - dim]) * rng.normal(size=n)
        true, rate, pose = centred(dim).changed(start), sds * rng.normal(size=n), made(dim)
        for k in range(20):
            pose.predict(k * DT)
            pose.update(seen(true, dim, rng))
            estimate, at = pose.estimate, true
            true, rate = true.changed(DT * rate), a * rate + np.sqrt(1.0 - a**2) * sds * rng.normal(size=n)
        error = estimate.motion.change_to(at)
        runs.append(error @ np.linalg.solve(estimate.cov, error))
    low, high = chi2.ppf([5e-4, 1.0 - 5e-4], n * len(runs)) / len(runs)
    assert low < np.mean(runs) < high


@pytest.mark.parametrize("dim", [2, 3])
def test_a_drift_is_the_integral_of_a_rate_that_fades(dim):
    """Variance of the integral of an Ornstein-Uhlenbeck process: 2 rate² T (t - T (1 - exp(-t / T)))."""
    s, pose, turns = PoseSettings(), made(dim), N_CHANGES[dim] - dim
    start, rate = (np.repeat(sds, [dim, turns]) for sds in ((s.start_m, s.start_rad), (s.rate_m_s, s.rate_rad_s)))
    for t in (0.0, 0.3, 40.0):
        pose.predict(t)
    drift = 2.0 * rate**2 * s.lasting_s * (t - s.lasting_s * (1.0 - np.exp(-t / s.lasting_s)))
    np.testing.assert_allclose(pose.estimate.cov, np.diag(start**2 + drift), rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize("dim", [2, 3])
def test_nees_of_a_moved_pose_is_within_its_bounds_where_stated_places_are_wrong(dim):
    sd_m, n, runs = 3e-3, N_CHANGES[dim], []
    for seed in range(8):
        rng = np.random.default_rng([dim, seed])
        true = centred(dim).changed(np.repeat([0.03, 0.03], [dim, n - dim]) * rng.normal(size=n))
        stated = {name: np.array(place) + rng.normal(0.0, sd_m, dim) for name, place in PLACES[dim].items()}
        pose = PoseFilter(stated, place_sd_m=sd_m)
        run(pose, [centred(dim)] * 5 + [true] * 10, dim, rng)
        estimate = pose.estimate
        at = estimate.motion
        shift = true.moved(at.centre[None])[0] - at.centre
        error = at.change_to(RigidMotion(true.rotation, shift, at.centre))
        runs.append(error @ np.linalg.solve(estimate.cov, error))
    low, high = chi2.ppf([5e-4, 1.0 - 5e-4], n * len(runs)) / len(runs)
    assert low < np.mean(runs) < high


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize(("moved_m", "turned_deg"), [(0.0, 2.0), (0.04, 3.0), (0.003, 0.0)])
def test_a_move_is_followed_within_three_frames_and_reported_once(dim, moved_m, turned_deg):
    rng, n = np.random.default_rng([dim, 5]), N_CHANGES[dim]
    change = np.zeros(n)
    change[:2], change[-1] = moved_m * np.array([0.6, 0.8]), np.radians(turned_deg)
    before, after = centred(dim), centred(dim).changed(change)
    pose = made(dim)
    reports = run(pose, [before] * 12 + [after] * 3, dim, rng)
    error = pose.estimate.motion.change_to(after)
    assert np.linalg.norm(error[:dim]) < 2.0 * SD_M
    assert error @ np.linalg.solve(pose.estimate.cov, error) < 30.0
    (report,) = [one for one in [*reports, *run_on(pose, after, dim, rng)] if one is not None]
    assert report.distance_m == pytest.approx(moved_m, abs=2e-3)
    assert np.degrees(report.angle_rad) == pytest.approx(turned_deg, abs=1.0)


def run_on(pose, motion, dim, rng, frames=10):
    reports = []
    for _ in range(frames):
        pose.predict(pose.time_s + DT)
        reports.append(pose.update(seen(motion, dim, rng)))
    return reports


def test_a_long_drift_is_reported_each_five_millimetres():
    rng, still = np.random.default_rng(3), centred(2)
    motions = [still.changed(np.array([2e-3 * k * DT, 0.0, 0.0])) for k in range(180)]
    reports = [one for one in run(made(2), motions, 2, rng) if one is not None]
    assert [one.distance_m for one in reports] == pytest.approx([5e-3, 5e-3], abs=5e-4)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("at_start", [False, True])
def test_one_wrong_mark_of_several_moves_nothing(dim, at_start):
    rng, still = np.random.default_rng([dim, 9]), centred(dim)
    pose = made(dim)
    run(pose, [] if at_start else [still] * 12, dim, rng)
    for _ in range(5):
        marks = seen(still, dim, rng)
        marks[2] = replace(marks[2], position=marks[2].position + 0.03)
        pose.predict(0.0 if pose.time_s is None else pose.time_s + DT)
        assert pose.update(marks) is None
        assert pose.wrong == {"C"}
    error = pose.estimate.motion.change_to(still)
    assert error @ np.linalg.solve(pose.estimate.cov, error) < 30.0


def test_without_marks_the_covariance_grows_and_they_are_found_again():
    rng, still = np.random.default_rng(1), centred(2)
    pose = made(2)
    run(pose, [still] * 30, 2, rng)
    before = pose.estimate.cov
    for _ in range(60):
        pose.predict(pose.time_s + DT)
        assert pose.update([]) is None
    assert (np.diag(pose.estimate.cov) > 2.0 * np.diag(before)).all()
    run_on(pose, still, 2, rng, frames=30)
    np.testing.assert_allclose(np.diag(pose.estimate.cov), np.diag(before), rtol=0.5)


def test_one_mark_says_nothing_of_the_turn():
    rng, still, s = np.random.default_rng(2), centred(2, "A"), PoseSettings()
    pose = made(2, "A")
    run(pose, [still] * 30, 2, rng, "A")
    assert np.sqrt(pose.estimate.cov[2, 2]) >= s.start_rad
    far = MarkMeasurement("M", np.array([-0.2, 0.3]), SD_M**2 * np.eye(2))
    sds = np.sqrt(np.diag(pose.estimate.corrected(far).total_cov))
    assert sds[0] > 0.3 * s.start_rad
    assert sds[1] < 1.1 * SD_M


@pytest.mark.parametrize("dim", [2, 3])
def test_a_mark_is_corrected_with_what_is_unknown_of_the_pose(dim):
    rng = np.random.default_rng([dim, 4])
    change, place = np.full(N_CHANGES[dim], 0.01), np.full(dim, 0.15)
    true, cov = centred(dim).changed(change), np.diag(np.arange(1.0, dim + 1.0)) * 1e-6
    errors, covs = [], []
    for _ in range(40):
        pose = made(dim)
        run(pose, [true] * 3, dim, rng)
        corrected = pose.estimate.corrected(MarkMeasurement("M", true.moved(place[None])[0], cov))
        errors.append(corrected.position - place)
        covs.append(corrected.shared @ corrected.shared.T)
    np.testing.assert_allclose(corrected.cov, true.rotation.T @ cov @ true.rotation, atol=1e-8)
    nees = [error @ np.linalg.solve(own, error) for error, own in zip(errors, covs, strict=True)]
    assert 0.5 * dim < np.mean(nees) < 1.3 * dim  # the rates, which are nought here, are in it


def test_an_error_of_the_calibration_is_considered_in_pose_and_marks():
    """For a scale error of one standard deviation, `shared` gives the errors exactly: there are no others."""
    sd, dim, still = 0.02, 2, centred(2)
    pose = PoseFilter({name: np.array(place) for name, place in PLACES[2].items()}, NEVER, n_calibration=1)

    def scaled(name, place):
        shift = sd * place[:, None]
        return MarkMeasurement(name, place + shift[:, 0], SD_M**2 * np.eye(dim), shift)

    for k in range(20):
        pose.predict(k * DT)
        pose.update([scaled(name, np.array(place)) for name, place in PLACES[2].items()])
    place = np.array([0.1, 0.2])
    corrected = pose.estimate.corrected(scaled("M", place))
    np.testing.assert_allclose(corrected.position - place, corrected.shared[:, 0], atol=5e-5)
    assert still.change_to(pose.estimate.motion)[0] != 0.0  # the middle of the marks is not that of the picture


def test_after_a_move_the_rate_has_no_error_by_calibration():
    """A calibration error that acts as a growing shift is in the rate; a sudden move resets the rate."""
    rng, places = np.random.default_rng(8), {name: np.array(place) for name, place in PLACES[2].items()}
    pose = PoseFilter(places, n_calibration=1)
    for k in range(20):
        pose.predict(k * DT)
        shift = np.array([0.05 if k == 19 else 0.0, 0.0])
        by = np.array([[1e-4 * k], [0.0]])
        pose.update([replace(mark, shared=by) for mark in seen(centred(2).changed(np.append(shift, 0.0)), 2, rng)])
    before = pose.estimate.columns
    pose.predict(pose.time_s + 10.0)
    np.testing.assert_allclose(pose.estimate.columns, before, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("call", ["no marks", "no time"])
def test_what_cannot_be_is_refused(call):
    with pytest.raises(ValueError, match="expected"):
        PoseFilter({}) if call == "no marks" else made(2).update([])


@pytest.mark.parametrize("names", ["ABCD", "ABC"])
def test_a_camera_in_space_is_posed_as_by_solvepnp(names):
    """From exact pixels, scaled to metres; OpenCV's iterative pose is the reference."""
    camera = camera_at(np.array([-0.2, 0.1, 0.5]), np.zeros(3))
    scale, true = 0.5 / 800.0, centred(3, names).changed(np.array([6e-3, -4e-3, 8e-3, 0.02, -0.01, 0.015]))
    places = np.array([PLACES[3][name] for name in names])
    pixels = camera.project(true.moved(places))

    def scaled(points):
        return tuple(scale * one for one in camera.viewed(points)[1:])

    pose = PoseFilter(dict(zip(names, places, strict=True)), seen=scaled)
    pose.predict(0.0)
    pose.update([MarkMeasurement(n, scale * p, 1e-14 * np.eye(2)) for n, p in zip(names, pixels, strict=True)])
    own, motion = camera.pose, pose.estimate.motion
    found = own.after(Pose(motion.rotation, motion.moved(np.zeros((1, 3)))[0]))
    start = cv2.Rodrigues(own.rotation)[0], own.translation_m.copy()
    inner = camera.lens.matrix, camera.lens.distortion
    _, turn, shift = cv2.solvePnP(places, pixels, *inner, *start, useExtrinsicGuess=True, flags=cv2.SOLVEPNP_ITERATIVE)
    np.testing.assert_allclose(found.rotation, cv2.Rodrigues(turn)[0], atol=1e-5)
    np.testing.assert_allclose(found.translation_m, shift.ravel(), atol=1e-5)
    assert pose.estimate.motion.change_to(true) == pytest.approx(np.zeros(6), abs=1e-5)


def test_marks_behind_a_camera_leave_the_pose():
    camera = camera_at(np.array([0.0, 0.0, 0.5]), np.array([0.0, 0.0, 1.0]))
    pose = PoseFilter({"A": np.zeros(3)}, seen=lambda points: camera.viewed(points)[1:])
    pose.predict(0.0)
    before = pose.estimate
    assert pose.update([MarkMeasurement("A", np.array([300.0, 200.0]), np.eye(2))]) is None
    np.testing.assert_array_equal(pose.estimate.cov, before.cov)
