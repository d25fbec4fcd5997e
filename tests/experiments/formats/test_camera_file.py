"""camera.toml and the YAML of OpenCV and ROS: what is written is read back, and every fault names file and key."""

import tomllib
from pathlib import Path

import cv2
import numpy as np
import pytest

from experiments.errors import InputError
from experiments.formats.camera_file import camera_text, read_camera_toml
from experiments.formats.camera_yaml import (
    LensFile,
    opencv_text,
    read_lens_file,
    ros_text,
)
from tests.experiments.rows import rows, spoilt
from tests.real_data import DATA
from tests.vision.drawn_boards import BOARD, LENS, SIZE_PX, noisy_views, poses
from vision import Calibration, calibrate

PUBLISHED = DATA / "chessboard" / "left_intrinsics.yml"
CONTENT = LensFile(LENS, (640, 480), "left eye")

ROS = """# as camera_calibration writes it
image_width: 640
image_height: 480
camera_name: narrow_stereo
camera_matrix:
  rows: 3
  cols: 3
  data: [535.5,   0. , 342.25,
           0. , 536. , 235.5 ,
           0. ,   0. ,   1.  ]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data:
  - -0.25
  - 0.5
  - 1e-3
  - -2.5e-4
  - 0.0
rectification_matrix: {rows: 3, cols: 3}
"""


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    rng = np.random.default_rng(1)
    return calibrate(
        noisy_views(BOARD, LENS, poses(6, rng), 0.1, rng), SIZE_PX, name="front", left_out=['a"b.png: board not found']
    )


def test_camera_toml_is_read_back_and_sums_to_the_covariance_in_millimetres(calibration, tmp_path) -> None:
    path = tmp_path / "camera.toml"
    path.write_text(camera_text(calibration), encoding="utf-8")
    back, data = read_camera_toml(path), tomllib.loads(path.read_text(encoding="utf-8"))
    assert (back.name, back.size_px) == ("front", SIZE_PX)
    np.testing.assert_array_equal(back.lens.matrix, calibration.matrix)
    np.testing.assert_array_equal(back.lens.distortion, calibration.distortion)
    np.testing.assert_array_equal(back.pose.rotation, calibration.pose.rotation)
    np.testing.assert_allclose(back.pose.translation_m, calibration.pose.translation_m, rtol=1e-14)
    np.testing.assert_allclose(back.calibration.T @ back.calibration, calibration.joint_cov, rtol=1e-12)
    sds = np.linalg.norm(data["uncertainty"], axis=0)
    np.testing.assert_allclose(sds[:9], [*data["matrix_sd"], *data["distortion_sd"]], rtol=1e-12)
    np.testing.assert_allclose(sds[12:], 1e3 * np.sqrt(np.diag(calibration.joint_cov)[12:]), rtol=1e-12)
    np.testing.assert_allclose(data["translation_mm"], 1e3 * calibration.pose.translation_m, rtol=1e-12)
    np.testing.assert_array_equal(data["mm_per_px"], calibration.mm_per_px)
    assert data["images_used"] == [f"{k:02d}.png" for k in range(6)]
    assert data["images_left_out"] == ['a"b.png: board not found']
    assert len(data["reprojection_rms_px_each"]) == 6
    assert data["plane_image"] == "05.png"


CAMERA_FAULTS = r"""
version = 1 | version = 2 | version: expected 1, found 2
mm_per_px | mm_px | mm_px: expected one of
plane_image | # plane_image | plane_image: expected this key, found none
[0.0, 0.0, 1.0] | [0.0, 0.0, 2.0] | matrix: expected [[fx, 0, cx]
rotation = [\n    [ | rotation = [\n    [1 | rotation: expected a rotation matrix
"00.png",\n |  | reprojection_rms_px_each: expected 5 entries, one for each image used, found 6
uncertainty = [\n    [ | uncertainty = [\n    [1.0, 2.0, | uncertainty[0]: expected 15
"""


@pytest.mark.parametrize(("old", "new", "message"), rows(CAMERA_FAULTS))
def test_faults_of_camera_toml_name_file_and_key(calibration, tmp_path, old, new, message):
    said = spoilt(read_camera_toml, tmp_path / "camera.toml", camera_text(calibration), old, new)
    assert said.startswith(message)


def test_opencv_yaml_is_read_back_here_and_by_opencv(tmp_path: Path) -> None:
    path = tmp_path / "lens.yml"
    path.write_text(opencv_text(CONTENT), encoding="utf-8")
    back = read_lens_file(path)
    assert back.size_px == (640, 480)
    np.testing.assert_array_equal(back.lens.matrix, LENS.matrix)
    np.testing.assert_array_equal(back.lens.distortion, LENS.distortion)
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    np.testing.assert_array_equal(storage.getNode("camera_matrix").mat(), LENS.matrix)


def test_ros_yaml_is_read_back(tmp_path: Path) -> None:
    path = tmp_path / "lens.yaml"
    path.write_text(ros_text(CONTENT), encoding="utf-8")
    back = read_lens_file(path)
    assert (back.size_px, back.name) == ((640, 480), "left eye")
    np.testing.assert_array_equal(back.lens.matrix, LENS.matrix)
    text = path.read_text(encoding="utf-8")
    assert "rectification_matrix:\n  rows: 3\n  cols: 3\n  data: [1.0, 0.0, 0.0, 0.0, 1.0," in text
    assert "projection_matrix:\n  rows: 3\n  cols: 4\n  data: [380.0, 0.0, 205.0, 0.0, 0.0, 384.0, 147.0, 0.0," in text


def test_ros_yaml_of_other_programs_is_read(tmp_path: Path) -> None:
    path = tmp_path / "ros.yaml"
    path.write_text(ROS, encoding="utf-8")
    back = read_lens_file(path)
    assert (back.size_px, back.name) == ((640, 480), "narrow_stereo")
    np.testing.assert_array_equal(back.lens.matrix, [[535.5, 0, 342.25], [0, 536, 235.5], [0, 0, 1]])
    np.testing.assert_array_equal(back.lens.distortion, [-0.25, 0.5, 1e-3, -2.5e-4, 0.0])


def of_ros(model: str, coefficients: list[float]) -> str:
    """As ROS writes it, with other coefficients."""
    head, _, rest = ROS.partition("distortion_model")
    data = f"  rows: 1\n  cols: {len(coefficients)}\n  data: {coefficients}\n"
    return f"{head}distortion_model: {model}\ndistortion_coefficients:\n{data}{rest[rest.index('rectification') :]}"


def of_opencv(coefficients: list[float], path: Path) -> str:
    """As cv2.FileStorage writes it, XML or YAML by the name."""
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", 640)
    storage.write("image_height", 480)
    storage.write("camera_matrix", LENS.matrix)
    storage.write("distortion_coefficients", np.array(coefficients).reshape(-1, 1))
    storage.release()
    return path.read_text(encoding="utf-8")


COEFFICIENTS = [-0.25, 0.5, 1e-3, -2.5e-4, 0.01, 0.02, -0.03, 0.04, 0.001, 0.002, -0.003, 0.004, 0.0, 0.0]


@pytest.mark.parametrize("name", ["ost.yaml", "cv.yml", "cv.xml", "cv.json"])
@pytest.mark.parametrize("n", [4, 5, 8, 12, 14])
def test_lenses_of_other_programs_are_known_by_their_content(tmp_path: Path, n: int, name: str) -> None:
    path, own = tmp_path / name, COEFFICIENTS[:n]
    text = of_ros("plumb_bob" if n < 8 else "rational_polynomial", own) if "ost" in name else of_opencv(own, path)
    (tmp_path / "camera.txt").write_text(text, encoding="utf-8")
    found = read_lens_file(tmp_path / "camera.txt")
    assert found.size_px == (640, 480)
    np.testing.assert_array_equal(found.lens.distortion, (*own, 0.0)[: max(5, min(n, 12))])
    (tmp_path / "again.yaml").write_text(ros_text(found), encoding="utf-8")
    again = read_lens_file(tmp_path / "again.yaml")
    np.testing.assert_array_equal(again.lens.distortion, found.lens.distortion)


KALIBR = """cam0:
  camera_model: pinhole
  distortion_coeffs: [-0.28, 0.07, 0.0002, 0.00001]
  distortion_model: radtan
  intrinsics: [458.6, 457.3, 367.2, 248.4]
  resolution: [752, 480]
"""


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (KALIBR, "expected camera_matrix and distortion_coefficients in the form of ROS, .* found a file of Kalibr"),
        ("\n".join(f"{0.5 * k:.3e},{-k}" for k in range(11)), "expected plane_to_px = .* found DLT coefficients"),
        (" ".join(map(str, range(11))), r"expected plane_to_px = \[\[L1, L2, L4\], .* found DLT coefficients"),
        (of_ros("equidistant", [0.1] * 4), 'distortion_model: .* found "equidistant"; .* fisheye lens first'),
        (of_ros("rational_polynomial", [0.1] * 14), r"distortion_coefficients: expected a sensor that is not tilted"),
        (
            of_ros("plumb_bob", [0.1] * 6),
            r"distortion_coefficients: expected 4, 5, 8, 12 or 14 numbers, .* found \[0.1",
        ),
        (opencv_text(CONTENT) + "fisheye_model: 1\n", "fisheye_model: expected 0; undistort pictures .* found 1"),
    ],
)
def test_what_cannot_be_read_is_one_line_that_helps(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "camera.txt").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=f"camera.txt: {message}") as fault:
        read_lens_file(tmp_path / "camera.txt")
    assert "\n" not in str(fault.value)


ROS_FAULTS = r"""
plumb_bob | equidistant | distortion_model: expected plumb_bob, found "equidistant"
image_width: 640 | image_width: wide | image_width: expected a whole number of 1 or more, found "wide"
image_height: 480\n |  | image_height: expected a whole number of 1 or more, found none
  cols: 5\n |  | distortion_coefficients.cols: expected this key, found none
  cols: 5\n |   cols: 4\n | distortion_coefficients.data: expected rows times cols numbers in brackets
  cols: 5\n |   cols: -5\n | distortion_coefficients.data: expected rows times cols numbers in brackets, found 5 entries
  cols: 5\n |   cols: 2.5\n | distortion_coefficients.data: expected rows times cols numbers in brackets
  rows: 3\n  cols: 3\n |   rows: -3\n  cols: -3\n | camera_matrix.data: expected rows times cols numbers in brackets
  rows: 3\n  cols: 3\n |   rows: 4.5\n  cols: 2\n | camera_matrix.data: expected rows times cols numbers in brackets
image_width: 640 | image_width: 640.5 | image_width: expected a whole number of 1 or more, found 640.5
image_width: 640 | image_width: 99999999999999999999 | image_width: expected a whole number of 1 or more, found 9.2
[535.5, | [x, | camera_matrix.data: expected rows times cols numbers in brackets, found "x"
[535.5, | [-535.5, | camera_matrix: expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], found [[-535.5, 0.0, 342.25], [0
0. ,   1.  ] | 0. ,   2.  ] | camera_matrix: expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], found [[535.5,
0. ,   1.  ] | 0.5,   1.  ] | camera_matrix: expected [[fx, 0, cx]
   0. , 536. |    3. , 536. | camera_matrix: expected [[fx, 0, cx]
   0. , 342.25 |    3. , 342.25 | camera_matrix: expected [[fx, 0, cx]
  rows: 3\n  cols: 3\n |   rows: 1\n  cols: 9\n | camera_matrix: expected [[fx, 0, cx]
camera_matrix: | matrix: | camera_matrix: expected rows, cols and data, found none
image_width: 640 | what is this | line 2: expected YAML of OpenCV or ROS, found Only
"""


@pytest.mark.parametrize(("old", "new", "message"), rows(ROS_FAULTS))
def test_faults_of_ros_yaml_name_file_and_key(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert spoilt(read_lens_file, tmp_path / "ros.yaml", ROS, old, new).startswith(message)


@pytest.mark.parametrize(
    ("stated", "name"),
    [
        ("00123", "00123"),
        ("12345678 # a serial number", "12345678"),
        ("HD camera: left", "HD camera: left"),
        ("'eye #1'", "eye #1"),
        ('"eye #1"', "eye #1"),
        ("", None),
    ],
)
def test_a_name_in_ros_yaml_may_be_any_text(tmp_path: Path, stated: str, name: str | None) -> None:
    path = tmp_path / "ros.yaml"
    path.write_text(ROS.replace("narrow_stereo", stated), encoding="utf-8")
    assert read_lens_file(path).name == name


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("%YAML", "YAML?", "line 1: expected YAML of OpenCV or ROS, found Only collections"),
        ("image_width: 640", "width: 640", "image_width: expected a whole number of 1 or more, found none"),
        ("camera_matrix", "matrix", "camera_matrix: expected rows, cols and data, found none"),
        ("camera_matrix: !!", "camera_matrix: 5\nother: !!", "camera_matrix: expected rows, cols and data, found none"),
        ("rows: 5\n", "rows: 2\n", "distortion_coefficients.data: expected rows times cols numbers in brackets, found"),
    ],
)
def test_faults_of_opencv_yaml_name_file_and_key(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert spoilt(read_lens_file, tmp_path / "lens.yml", opencv_text(CONTENT), old, new).startswith(message)


@pytest.mark.skipif(not PUBLISHED.is_file(), reason="no left_intrinsics.yml: set SOFTAIM_DATA to the real pictures")
def test_the_published_calibration_reads() -> None:
    back = read_lens_file(PUBLISHED)
    assert back.size_px == (640, 480)
    assert back.lens.matrix[0, 0] == 535.91573396163199
    assert back.lens.distortion[4] == 0.23839153080878486
