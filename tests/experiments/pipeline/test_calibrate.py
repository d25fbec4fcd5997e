"""`softaim calibrate` as a user calls it: files that come out, and every fault in one line with exit code 2."""

import tomllib
from pathlib import Path

import cv2
import numpy as np
import pytest

from experiments.formats.camera_file import read_camera_toml
from experiments.formats.camera_yaml import read_lens_file
from experiments.pipeline.calibrate import board_of, views_of
from experiments.plots.calibration import calibration_figure
from tests.experiments.command import softaim
from tests.experiments.plots.printed import check_printed
from tests.vision.drawn_boards import BOARD, LENS, SIZE_PX, drawn, poses, sub_pixel_rays
from vision import Board, Pose, VideoWriter, calibrate

CHESS = ("--board", "9x6", "--square-mm", "25")
CHARUCO = ("--charuco", "4X4_50")
TO_RIGHT = Pose(cv2.Rodrigues(np.array([0.0, 0.15, 0.0]))[0], np.array([-0.05, 0.0, 0.0]))


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Drawn pictures: left/ and right/ of two cameras, charuco/, alike/ all from one place."""
    root, rng = tmp_path_factory.mktemp("boards"), np.random.default_rng(1)
    rays, at = sub_pixel_rays(LENS), poses(5, rng, far_m=0.38)
    charuco, alike = Board(8, 5, 0.025, "4X4_50", 0.018), drawn(BOARD, at[0], rays, rng=rng)
    for name in ("left", "right", "charuco", "alike"):
        (root / name).mkdir()
    for k, pose in enumerate(at):
        cv2.imwrite(str(root / "left" / f"{k}.png"), drawn(BOARD, pose, rays, rng=rng))
        cv2.imwrite(str(root / "right" / f"{k}.png"), drawn(BOARD, TO_RIGHT.after(pose), rays, rng=rng))
        cv2.imwrite(str(root / "charuco" / f"{k}.png"), drawn(charuco, pose, rays, rng=rng))
        cv2.imwrite(str(root / "alike" / f"{k}.png"), alike)
    return root


def test_a_folder_becomes_a_camera_a_picture_and_yaml(pictures, tmp_path, capsys):
    out, also = tmp_path / "front.toml", ("--opencv-yaml", tmp_path / "o.yml", "--ros-yaml", tmp_path / "r.yaml")
    plane = ("--plane", pictures / "left" / "2.png")
    assert softaim("calibrate", pictures / "left", *CHESS, *plane, "--out", out, *also, "--vector", "pdf") == 0
    camera = read_camera_toml(out)
    assert camera.name == "front"
    # standard errors with 5 pictures are about 0.1 % of the focal length
    np.testing.assert_allclose(camera.lens.matrix[[0, 1], [0, 1]], LENS.matrix[[0, 1], [0, 1]], rtol=0.006)
    assert tomllib.loads(out.read_text(encoding="utf-8"))["plane_image"] == "2.png"
    for other in (read_lens_file(tmp_path / "o.yml"), read_lens_file(tmp_path / "r.yaml")):
        np.testing.assert_array_equal(other.lens.matrix, camera.lens.matrix)
        np.testing.assert_array_equal(other.lens.distortion, camera.lens.distortion)
    drawing = cv2.imread(str(tmp_path / "front.png"))
    assert drawing.shape[1] > 300
    assert "5 pictures used" in capsys.readouterr().out
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"front.pdf", "front.png", "front.provenance.json", "front.toml", "o.yml", "r.yaml"}
    assert (tmp_path / "front.pdf").read_bytes().startswith(b"%PDF")
    for name in ("front.toml", "front.png"):
        (tmp_path / name).unlink()
    words = ("calibrate", pictures / "left", *CHESS, "--out", out, "--vector", "pdf")
    assert softaim(*words) == 2
    assert "front.pdf: expected a new file, found an existing one; --force replaces it" in capsys.readouterr().err


def test_the_picture_can_be_printed(pictures: Path, tmp_path: Path) -> None:
    """Five pictures, 54 corners each: an arrow for each, a bar for each picture."""
    views = views_of(board_of("9x6", 25.0), [pictures / "left"], "front")
    done = calibrate(views.views, views.size_px, None, name=views.name)
    figure = calibration_figure(done)
    check_printed(figure)
    arrows, bars = figure.axes
    assert arrows.collections[0].N == 5 * 54
    assert [bar.get_height() for bar in bars.patches] == list(done.rms_px_each)


@pytest.mark.usefixtures("without_pictures")
def test_a_charuco_board_counts_squares(pictures: Path, tmp_path: Path) -> None:
    board = ("--board", "9x6", "--square-mm", "25", "--charuco", "DICT_4X4_50", "--marker-mm", "18")
    assert softaim("calibrate", pictures / "charuco", *board, "--out", tmp_path / "c.toml") == 0
    camera = read_camera_toml(tmp_path / "c.toml")
    np.testing.assert_allclose(camera.lens.matrix[[0, 1], [0, 1]], LENS.matrix[[0, 1], [0, 1]], rtol=0.02)


@pytest.mark.usefixtures("without_pictures")
def test_a_film_is_calibrated_from_and_the_picture_of_the_plane_may_lie_elsewhere(pictures, tmp_path) -> None:
    with VideoWriter(tmp_path / "film.avi", SIZE_PX, 5.0, codec="FFV1") as film:
        for path in sorted((pictures / "left").iterdir()):
            film.write(cv2.imread(str(path)))
    plane = tmp_path / "phantom.png"
    plane.write_bytes((pictures / "left" / "1.png").read_bytes())
    words = (tmp_path / "film.avi", *CHESS, "--plane", plane, "--out", tmp_path / "c.toml")
    assert softaim("calibrate", *words) == 0
    written = tomllib.loads((tmp_path / "c.toml").read_text(encoding="utf-8"))
    assert written["plane_image"] == "phantom.png"
    assert sorted(written["images_used"]) == [*(f"frame {k:06d}" for k in range(5)), "phantom.png"]


@pytest.mark.usefixtures("without_pictures")
def test_two_cameras_get_one_world(pictures: Path, tmp_path: Path) -> None:
    both = [word for name in ("left", "right") for word in ("--camera", f"{name}={pictures / name}")]
    assert softaim("calibrate", *both, *CHESS, "--out", tmp_path / "rig") == 0
    names = {path.name for path in (tmp_path / "rig").iterdir()}
    assert names == {"left.png", "left.toml", "provenance.json", "right.png", "right.toml", "softaim.log"}
    left, right = (read_camera_toml(tmp_path / "rig" / f"{name}.toml") for name in ("left", "right"))
    between = right.pose.after(left.pose.inverse())
    turn = cv2.Rodrigues(between.rotation @ TO_RIGHT.rotation.T)[0]
    assert np.linalg.norm(turn) < 0.01
    assert np.linalg.norm(between.translation_m - TO_RIGHT.translation_m) < 2e-3
    assert left.calibration.shape == right.calibration.shape == (30, 15)


BAD = [
    (("{p}/left", *CHESS, "--charuco", "4X4_50"), "--marker-mm: expected a length below --square-mm,"),
    (("{p}/left", *CHESS, "--board", "12x10", *CHARUCO, "--marker-mm", "9"), "--charuco: board dictionary"),
    (("{p}/left/0.png", "{t}/small.png", *CHESS), "small.png: expected 400x300 as 0.png has, found 40x30"),
    (("{p}/left", *CHESS, "--board", "8x6"), "--board: expected the inner corners of the whole board, found 9x6"),
    (("{p}/left/0.png", "{p}/left/1.png", *CHESS), "pictures: expected the board in 4 or more, found it in 2 of 2;"),
    (("{p}/alike", *CHESS), "pictures: expected boards that face 10 degrees or more apart, found"),
    (("{p}/left", *CHESS, "--plane", "x.png"), "x.png: expected a picture of the board on the plane, found no such"),
    (("--camera", "left", *CHESS), '--camera: expected NAME=FOLDER, found "left"'),
]


@pytest.mark.parametrize(("words", "line"), BAD, ids=[line.split(" found")[0] for _, line in BAD])
def test_bad_input_is_one_line_and_leaves_nothing(words, line, pictures, tmp_path, capsys):
    cv2.imwrite(str(tmp_path / "small.png"), np.full((30, 40), 9, dtype=np.uint8))
    filled = [word.format(p=pictures, t=tmp_path) for word in words]
    assert softaim("calibrate", *filled, "--out", tmp_path / "out.toml") == 2
    reported = capsys.readouterr().err
    assert reported.count("\n") == 1
    assert line in reported
    assert sorted(p.name for p in tmp_path.iterdir()) == ["small.png"]
