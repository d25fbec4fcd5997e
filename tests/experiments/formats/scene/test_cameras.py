"""Cameras of scene files: a lens and its place, read, written and read again; or the file that names them."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from experiments.errors import InputError
from experiments.formats.camera_yaml import LensFile, opencv_text, ros_text
from experiments.formats.scene.scene import read_scene, write_scene
from experiments.pipeline.frame_sources import filmed_scene
from tests.experiments.rows import complaint
from vision import Lens, Pose

GOOD = (Path(__file__).parents[2] / "good_scene.toml").read_text(encoding="utf-8")
LENS = Lens(np.array([[800.0, 0, 320], [0, 790, 240], [0, 0, 1]]), np.array([-0.3, 0.1, 0.001, -0.002, 0.02]))
POSE = Pose(np.diag([1.0, -1.0, -1.0]), np.array([0.02, -0.03, 1.8]))

TABLE = """
[[camera]]
name = "front"
size_px = [640, 480]
matrix = [[800.0, 0.0, 320.0], [0.0, 790.0, 240.0], [0.0, 0.0, 1.0]]
distortion = [-0.3, 0.1, 0.001, -0.002, 0.02]
rotation = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]
translation_mm = [20.0, -30.0, 1800.0]
"""


LENS_FAULT = "camera[0]: expected a lens that shows mid-picture and every node, found one that cannot; check the units"


def scene_with(folder: Path, camera: str) -> Path:
    path = folder / "scene.toml"
    path.write_text(GOOD[: GOOD.index("[[camera]]")] + camera, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("translation_mm = [20.0, -30.0, 1800.0]\n", "", "camera[0]: translation_mm: expected this key beside matrix"),
        ("[0.0, -1.0, 0.0]", "[0.0, 1.0, 0.0]", "camera[0].rotation: expected a rotation matrix, found"),
        ("[800.0, 0.0, 320.0]", "[-800.0, 0.0, 320.0]", "camera[0].matrix: expected [[fx, 0, cx], [0, fy, cy]"),
        (TABLE, '[[camera]]\nfile = "no.toml"\n', "no.toml"),
        ("-0.002, 0.02]", "-0.002, 0.02, 0.1]", "camera[0]: distortion: expected 5, 8 or 12 numbers, found 6"),
        (", 1800.0]", ", -1800.0]", "camera[0].translation_mm: expected a pose before the plane z = 0, found [20"),
        ("30.0, 1800.0]", "30.0, 1.8]", LENS_FAULT),
        ("[800.0, 0.0, 320.0]", "[800.0, 0.0, 320000.0]", LENS_FAULT),
        ("[[800.0, 0.0, 320.0], [0.0, 790.0, 240.0]", "[[0.8, 0.0, 0.5], [0.0, 0.8, 0.5]", LENS_FAULT),
        ("[-0.3,", "[1e6,", LENS_FAULT),
        ("matrix = ", "plane_to_px = ", "camera[0]: distortion: expected no such key beside plane_to_px, found one"),
    ],
)
def test_faults_of_cameras_are_reported(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert TABLE.count(old) == 1
    path = scene_with(tmp_path, TABLE.replace(old, new))
    said = complaint(read_scene, path)
    assert message in said
    assert said.startswith(str(tmp_path))


POSED = "".join(line + "\n" for line in TABLE.splitlines() if line.startswith(("rotation", "translation")))
LENSES = {
    "ros": lambda lens: ros_text(LensFile(lens, (640, 480), "front")),
    "opencv": lambda lens: opencv_text(LensFile(lens, (640, 480))),
}


@pytest.mark.parametrize("n", [5, 8, 12])
@pytest.mark.parametrize("kind", LENSES)
def test_a_lens_of_another_program_stands_where_the_scene_says(tmp_path: Path, kind: str, n: int) -> None:
    """OpenCV's own projection is the oracle; a scene that is written and read again has the same camera."""
    lens = Lens(LENS.matrix, np.append(LENS.distortion, np.linspace(0.01, 0.001, 7))[:n])
    (tmp_path / "front.yaml").write_text(LENSES[kind](lens), encoding="utf-8")
    path = scene_with(tmp_path, f'[[camera]]\nfile = "front.yaml"\n{POSED}scale_sd = 0.01\n')
    points = np.array([[0.1, 0.05, 0.0], [-0.2, 0.1, 0.0]])
    turn = cv2.Rodrigues(POSE.rotation)[0]
    expected = cv2.projectPoints(points, turn, POSE.translation_m, lens.matrix, lens.distortion)[0].reshape(-1, 2)
    write_scene(read_scene(path), tmp_path / "again.toml")
    for scene in (read_scene(path), read_scene(tmp_path / "again.toml")):
        (camera,) = scene.cameras
        assert (camera.name, camera.size_px, camera.scale_sd, scene.lenses) == ("front", (640, 480), 0.01, ())
        np.testing.assert_allclose(camera.project(points[:, :2]), expected, atol=1e-9)


@pytest.mark.parametrize("kind", LENSES)
def test_a_lens_that_stands_nowhere_is_kept_and_no_camera(tmp_path: Path, kind: str) -> None:
    (tmp_path / "front.yaml").write_text(LENSES[kind](LENS), encoding="utf-8")
    path = scene_with(tmp_path, '[[camera]]\nfile = "front.yaml"\n')
    write_scene(read_scene(path), tmp_path / "again.toml")
    for scene in (read_scene(path), read_scene(tmp_path / "again.toml")):
        (lens,) = scene.lenses
        assert (scene.cameras, lens.name, lens.size_px) == ((), "front", (640, 480))
        np.testing.assert_array_equal(lens.lens.distortion, LENS.distortion)
    said = "camera: expected one, found 0; front has a lens but no pose: rotation and translation_mm"
    with pytest.raises(InputError, match=said):
        filmed_scene(path)


def test_a_lens_without_a_name_is_written_with_one(tmp_path: Path) -> None:
    text = LENSES["ros"](LENS)
    (tmp_path / "lens.yaml").write_text("".join(line for line in text.splitlines(True) if "name" not in line), "utf-8")
    write_scene(read_scene(scene_with(tmp_path, '[[camera]]\nfile = "lens.yaml"\n')), tmp_path / "again.toml")
    assert read_scene(tmp_path / "again.toml").lenses[0].name == "camera"


FRONT = 'file = "front.yaml"'

CALIBRATED = f"""version = 1
{TABLE.removeprefix(chr(10) + "[[camera]]")}
matrix_sd = [0.0, 0.0, 0.0, 0.0]
distortion_sd = [0.0, 0.0, 0.0, 0.0, 0.0]
reprojection_rms_px = 0.1
reprojection_rms_px_each = []
images_used = []
images_left_out = []
mm_per_px = [2.0, 2.0]
plane_image = "plane.png"
uncertainty = [[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]]
"""


@pytest.mark.parametrize(
    ("camera", "message"),
    [
        (f"{FRONT}\n{POSED.splitlines()[0]}", "camera[0]: translation_mm: expected this key beside file, found"),
        (f'file = "camera.toml"\n{POSED}', "camera[0].rotation: expected no such key beside camera.toml, which has"),
        (f"{FRONT}\nmatrix = [[1.0, 0, 0], [0, 1, 0], [0, 0, 1]]", "camera[0]: expected one of plane_to_px, matrix"),
        (f'file = "empty.yml"\n{POSED}', "empty.yml: expected a camera of OpenCV or ROS, found an empty file"),
        (f'file = "other.yaml"\n{POSED}', "other.yaml: expected a camera of OpenCV or ROS, found neither"),
        (f'file = "other.toml"\n{POSED}', "other.toml: name: expected this key, found none"),
        ('file = "behind.toml"', "behind.toml: translation_mm: expected a pose before the plane z = 0, found [20"),
        ('file = "none.yaml"', "none.yaml: expected a file, found none"),
    ],
)
def test_faults_of_a_lens_file_are_reported(tmp_path: Path, camera: str, message: str) -> None:
    (tmp_path / "front.yaml").write_text(LENSES["ros"](LENS), encoding="utf-8")
    (tmp_path / "empty.yml").touch()
    (tmp_path / "other.yaml").write_text("K: [1, 2]\n", encoding="utf-8")
    (tmp_path / "other.toml").write_text("version = 1\n", encoding="utf-8")
    (tmp_path / "camera.toml").write_text(CALIBRATED, encoding="utf-8")
    (tmp_path / "behind.toml").write_text(CALIBRATED.replace("1800", "-1800"), encoding="utf-8")
    assert message in complaint(read_scene, scene_with(tmp_path, f"[[camera]]\n{camera}\n"))


@pytest.mark.slow
def test_a_calibration_moves_all_marks_of_a_frame_together(tmp_path: Path) -> None:
    import vision
    from experiments.pipeline.line import Line

    rows = "uncertainty = [[4.0, 4.0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 8.0]]\n"
    scene = read_scene(scene_with(tmp_path, TABLE + rows))
    camera, rng = scene.cameras[0], np.random.default_rng(0)
    discs = []
    for mark in scene.marks:
        at = scene.network.positions[scene.network.index(mark.node)]
        size = np.linalg.norm(camera.disc_shape(at, mark.diameter_m / 2.0), axis=1)
        discs.append(vision.Disc(camera.project(at[None])[0], (size[0], size[1]), mark.hue_deg))
    line = Line(scene, baseline=False)
    assert line.filter.n_calibration == scene.n_calibration == 1
    step = line.see(0.0, vision.draw_frame(camera.size_px, discs, vision.Lighting(), rng))
    assert len(step.marks) == len(scene.marks)
    for mark in step.marks:
        at = scene.network.positions[scene.network.index(mark.node)]
        # a camera that stands half a percent further off, by 8 mm of 1.8 m, sees the same with a lens as much longer
        np.testing.assert_allclose(mark.shared, camera.calibration_error(at[None])[0], rtol=0.05, atol=1e-5)
        assert np.abs(mark.position - at).max() < 1e-3
        mean, _ = line.filter.expected(mark.node)
        _, cov = line.filter.expected(mark.node, camera.calibration_error(mean[None])[0])
        found = line._looked_for(camera, mark.node, line.filter.expected).cov_px2
        np.testing.assert_allclose(found, camera.cov_to_px(mean[None], cov[None])[0], rtol=1e-9)
