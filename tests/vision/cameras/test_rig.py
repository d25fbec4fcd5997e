"""Cameras calibrated together: relative poses as good as their joint covariance says."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.stats import chi2

from tests.vision.drawn_boards import BOARD, LENS, SIZE_PX, noisy_views, poses
from vision import Board, Calibration, CalibrationError, CameraViews, Lens, Pose, calibrate_together

RIGHT = Lens(LENS.matrix * np.array([[1.1], [1.1], [1.0]]), 0.8 * LENS.distortion)
TO_RIGHT = Pose(cv2.Rodrigues(np.array([0.03, 0.2, -0.02]))[0], np.array([-0.08, 0.004, 0.02]))
"""From the left camera's axes to the right one's."""


def pair(at: list[Pose], rng: np.random.Generator) -> tuple[CameraViews, CameraViews]:
    """What both cameras see, the right one with five times the noise; each misses one picture."""
    left = noisy_views(BOARD, LENS, at, 0.05, rng)
    right = noisy_views(BOARD, RIGHT, [TO_RIGHT.after(pose) for pose in at], 0.25, rng)
    return CameraViews("left", SIZE_PX, tuple(left[1:])), CameraViews("right", SIZE_PX, (*right[:2], *right[3:]))


def pose_error(done: Calibration, pose: Pose) -> np.ndarray:
    turn = cv2.Rodrigues(done.pose.rotation @ pose.rotation.T)[0].ravel()
    return np.concatenate([turn, done.pose.translation_m - pose.translation_m])


def test_errors_of_both_poses_are_as_large_as_the_joint_covariance_says() -> None:
    # chi-square of both cameras' poses together, (12,), with the covariance between them, and of each; 0.05 % a side
    runs, total, own = 8, 0.0, np.zeros(2)
    for seed in range(runs):
        rng = np.random.default_rng(100 + seed)
        at = poses(6, rng)
        left, right = calibrate_together(BOARD, pair(at, rng))
        assert left.plane_image == right.plane_image == "05.png"
        both = np.column_stack([left.uncertainty[:, 9:], right.uncertainty[:, 9:]])
        e = np.concatenate([pose_error(left, at[5]), pose_error(right, TO_RIGHT.after(at[5]))])
        total += e @ np.linalg.solve(both.T @ both, e)
        own += [
            e[:6] @ np.linalg.solve(left.joint_cov[9:, 9:], e[:6]),
            e[6:] @ np.linalg.solve(right.joint_cov[9:, 9:], e[6:]),
        ]
    for sums, n in ((total, 12), (own, 6)):
        low, high = chi2.ppf([0.0005, 0.9995], n * runs)
        assert ((low < sums) & (sums < high)).all(), (sums / runs, n)


def test_a_plane_that_one_camera_alone_saw_is_the_world_of_both() -> None:
    rng = np.random.default_rng(1)
    at = poses(8, rng)
    left, right = calibrate_together(BOARD, pair(at, rng), "00.png")
    assert "00.png" not in left.images_used
    for done, pose in ((left, at[0]), (right, TO_RIGHT.after(at[0]))):
        e = pose_error(done, pose)
        assert (np.abs(e) < 4 * np.sqrt(np.diag(done.joint_cov)[9:])).all()
        assert np.abs(e[3:]).max() < 2e-3


@pytest.mark.slow
def test_pictures_that_were_not_taken_together_are_reported() -> None:
    rng = np.random.default_rng(2)
    left, right = pair(poses(6, rng), rng)
    names = [view.name for view in right.views]
    shifted = tuple(replace(v, name=n) for v, n in zip(right.views, [*names[1:], names[0]], strict=True))
    with pytest.raises(CalibrationError, match=r"camera \w+: expected pictures of the same name taken together, found"):
        calibrate_together(BOARD, [left, replace(right, views=shifted)])


def test_faults_name_the_camera() -> None:
    rng = np.random.default_rng(3)
    left, right = pair(poses(8, rng), rng)
    renamed = tuple(replace(v, name=f"b{v.name}") for v in right.views)
    with pytest.raises(CalibrationError, match=r"camera right: expected pictures named as those of the other cameras"):
        calibrate_together(BOARD, [left, replace(right, views=renamed)])
    with pytest.raises(CalibrationError, match=r"camera right: pictures: expected the board in 4 or more, found it"):
        calibrate_together(BOARD, [left, replace(right, views=right.views[:3])])
    with pytest.raises(CalibrationError, match=r"nine\.png: expected a picture of the board on the plane, found none"):
        calibrate_together(BOARD, [left, right], "nine.png")
    with pytest.raises(CalibrationError, match=r"columns and rows are odd and even, found 7x5"):
        calibrate_together(Board(7, 5, 0.025), [left, right])
