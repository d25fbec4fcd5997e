"""Cameras of a scene in space: by keys, and by a lens file of ROS or OpenCV with a pose."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from experiments.errors import InputError
from experiments.formats.camera_file import camera_text
from experiments.formats.camera_yaml import LensFile
from experiments.formats.scene.scene import SceneError, read_scene, scene_text, write_scene
from experiments.formats.toml_file import toml_value
from tests.experiments.formats.scene.test_cameras import LENSES, TABLE
from tests.experiments.in_space import breast, two_cameras
from tests.vision.cameras.test_rig import RIGHT, TO_RIGHT
from tests.vision.drawn_boards import BOARD, SIZE_PX, noisy_views, poses
from tests.vision.drawn_boards import LENS as LEFT
from vision import CameraViews, PlaneCamera, Pose, SpaceCamera, calibrate_together, fronto_parallel_camera, triangulated

POINTS = np.array([[0.0, 0.0, 0.0], [0.02, -0.03, 0.05]])


def scene_with(folder: Path, *tables: str) -> Path:
    path = folder / "scene.toml"
    bare = scene_text(replace(breast(), space_cameras=()))
    path.write_text(bare + "".join(f"\n[[camera]]\n{table}\n" for table in tables), encoding="utf-8")
    return path


def posed(pose: Pose) -> str:
    shift = [1e3 * x for x in pose.translation_m.tolist()]
    return f"rotation = {toml_value(pose.rotation.tolist(), repr)}\ntranslation_mm = {toml_value(shift, repr)}\n"


def test_two_cameras_are_written_and_read(tmp_path: Path) -> None:
    calibration = 1e-3 * np.random.default_rng(0).normal(size=(2, 30, 15))
    cameras = tuple(
        replace(camera, calibration=own, calibration_sd_px=0.1)
        for camera, own in zip(two_cameras(), calibration, strict=True)
    )
    scene = replace(breast(), space_cameras=cameras)
    write_scene(scene, tmp_path / "scene.toml")
    again = read_scene(tmp_path / "scene.toml")
    assert again.cameras == ()
    assert [camera.name for camera in again.space_cameras] == ["left", "right"]
    for own, written in zip(again.space_cameras, cameras, strict=True):
        np.testing.assert_allclose(own.project(POINTS), written.project(POINTS), atol=1e-9)
        np.testing.assert_allclose(own.calibration, written.calibration, rtol=1e-12)
        assert (own.size_px, own.calibration_sd_px) == ((640, 480), 0.1)
    assert again.n_calibration == scene.n_calibration
    assert 3 < scene.n_calibration <= 30


@pytest.mark.parametrize("kind", LENSES)
def test_a_lens_of_another_program_needs_a_pose(tmp_path: Path, kind: str) -> None:
    camera = two_cameras()[0]
    (tmp_path / "left.yaml").write_text(LENSES[kind](camera.lens), encoding="utf-8")
    scene = read_scene(scene_with(tmp_path, f'file = "left.yaml"\n{posed(camera.pose)}'))
    np.testing.assert_allclose(scene.space_cameras[0].project(POINTS), camera.project(POINTS), atol=1e-9)
    (lens,) = read_scene(scene_with(tmp_path, 'file = "left.yaml"')).lenses
    assert isinstance(lens, LensFile)


def test_a_scale_is_of_a_flat_scene(tmp_path: Path) -> None:
    message = r"camera\[0\]\.scale_sd: expected a flat scene, found a network in space; give matrix and pose"
    with pytest.raises(InputError, match=message):
        read_scene(scene_with(tmp_path, TABLE.replace("[[camera]]", "") + "scale_sd = 0.01"))


def test_cameras_fit_the_dimension_of_the_scene() -> None:
    plane: PlaneCamera = fronto_parallel_camera("front", (640, 480), (0.3, 0.3))
    with pytest.raises(SceneError, match="camera: expected a flat scene, found a network in space"):
        replace(breast(), cameras=(plane,), space_cameras=())


def test_cameras_calibrated_together_are_those_of_the_scene(tmp_path: Path) -> None:
    """The files of `softaim calibrate --camera left=... --camera right=...`, from corners with noise of 0.1 px."""
    rng = np.random.default_rng(0)
    at = poses(10, rng)
    left = noisy_views(BOARD, LEFT, at, 0.1, rng)
    right = noisy_views(BOARD, RIGHT, [TO_RIGHT.after(pose) for pose in at], 0.1, rng)
    both = [CameraViews("left", SIZE_PX, tuple(left)), CameraViews("right", SIZE_PX, tuple(right))]
    for done in calibrate_together(BOARD, both):
        (tmp_path / f"{done.name}.toml").write_text(camera_text(done), encoding="utf-8")
    scene = read_scene(scene_with(tmp_path, 'file = "left.toml"', 'file = "right.toml"\ncalibration_sd_px = 0.1'))
    assert [len(camera.calibration) for camera in scene.space_cameras] == [30, 30]
    assert 2 < scene.n_calibration <= 30
    true = [SpaceCamera("left", SIZE_PX, LEFT, at[-1]), SpaceCamera("right", SIZE_PX, RIGHT, TO_RIGHT.after(at[-1]))]
    point = np.array([0.01, 0.02, 0.015])
    places = np.array([camera.project(point[None])[0] for camera in true])
    found = triangulated(scene.space_cameras, places, np.tile(1e-4 * np.eye(2), (2, 1, 1)), scene.calibration_steps)
    away, cov = found.positions[0] - point, found.covs[0] + found.shared[0] @ found.shared[0].T
    assert away @ np.linalg.solve(cov, away) < chi2.ppf(0.999, 3)
    assert np.linalg.norm(away) < 0.002
