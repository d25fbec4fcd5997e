"""Films of several cameras in a recording: their names, times and faults."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from experiments.errors import InputError
from experiments.formats.films.several import CameraFilm, exposures_of, film_name, merged
from experiments.formats.recording import read_recording, write_frames_csv
from experiments.formats.scene.scene import write_scene
from tests.experiments.in_space import breast
from vision import TOGETHER_S


def film(name: str, times_s: list[float]) -> CameraFilm:
    return CameraFilm(name, Path(f"video.{name}.avi"), np.array(times_s))


def test_times_of_films_are_merged_in_order() -> None:
    near = 0.9 * TOGETHER_S
    times_s, groups = merged([film("a", [0.0, 0.1, 0.2]), film("b", [near, 0.15, 0.2 - near, 0.3])])
    np.testing.assert_allclose(times_s, [0.0, 0.1, 0.15, 0.2 - near, 0.3])
    assert groups == ((0, 1), (0,), (1,), (1, 0), (1,))


def test_one_camera_has_one_picture_of_a_time() -> None:
    times_s, groups = merged([film("a", [0.0, 0.5 * TOGETHER_S, 0.1])])
    assert (times_s.tolist(), groups) == ([0.0, 0.5 * TOGETHER_S, 0.1], ((0,), (0,), (0,)))


def recording(folder: Path, **n_pictures: int) -> Path:
    """Folders of black pictures, by camera, the second 10 ms after the first."""
    write_scene(breast(), folder / "scene.toml")
    for k, (name, n) in enumerate(n_pictures.items()):
        (folder / f"frames.{name}").mkdir()
        for i in range(n):
            cv2.imwrite(str(folder / f"frames.{name}" / f"{i:06d}.png"), np.full((480, 640, 3), 10 * k + i, np.uint8))
        write_frames_csv(folder / f"frames.{name}.csv", 0.01 * k + 0.1 * np.arange(n))
    return folder


def test_pictures_of_two_folders_come_in_order_of_time(tmp_path: Path) -> None:
    opened = read_recording(recording(tmp_path, left=3, right=2))
    assert (opened.source, opened.marks) == (None, None)
    exposures = list(exposures_of(opened.films))
    assert [round(one.exposure_s, 6) for one in exposures] == [0.0, 0.01, 0.1, 0.11, 0.2]
    seen = [{name: int(image[0, 0, 0]) for name, image in one.images.items()} for one in exposures]
    assert seen == [{"left": 0}, {"right": 10}, {"left": 1}, {"right": 11}, {"left": 2}]
    with pytest.raises(InputError, match="expected a video or frames, found films of cameras in space"):
        opened.open_frames()


def test_one_camera_of_two_is_enough(tmp_path: Path) -> None:
    assert [one.camera for one in read_recording(recording(tmp_path, right=3)).films] == ["right"]


def test_pieces_of_killed_films_are_named(tmp_path: Path) -> None:
    (recording(tmp_path) / "segments.left").mkdir()
    with pytest.raises(InputError, match=f"found pieces of films; softaim record --recover {tmp_path} joins them"):
        read_recording(tmp_path)


def larger(folder: Path) -> None:
    for path in (folder / "frames.right").iterdir():
        cv2.imwrite(str(path), np.zeros((240, 320, 3), np.uint8))


ALONE = "expected no other source beside films of named cameras, found"
FAULTS = [
    (
        lambda f: (f / "frames.right").rename(f / "frames.top"),
        r'frames\.top: expected the name of a camera with lens and pose in the scene \(left, right\), found "top"',
    ),
    (lambda f: (f / "video.avi").touch(), f"{ALONE} video.avi"),
    (lambda f: (f / "marks.csv").touch(), f"{ALONE} marks.csv"),
    (
        lambda f: write_frames_csv(f / "frames.right.csv", np.array([0.0, 0.1, 0.2])),
        r"frames\.right\.csv: expected a row for each of the 2 pictures frames\.right/\*\.png, found 3 rows",
    ),
    (larger, r"camera\[1\]\.size_px: expected \[320, 240\], as the pictures of frames\.right have, found \[640, 480\]"),
    (lambda f: (f / "frames.right.csv").unlink(), r"frames\.right\.csv: expected a file, found none"),
]


@pytest.mark.parametrize(("spoil", "message"), FAULTS)
def test_a_fault_is_named(tmp_path: Path, spoil: Callable[[Path], object], message: str) -> None:
    folder = recording(tmp_path, left=2, right=2)
    spoil(folder)
    with pytest.raises(InputError, match=message):
        read_recording(folder)


def test_a_name_of_a_camera_that_no_file_can_have_is_refused() -> None:
    assert film_name("top.left 2", 0) == "top.left 2"
    with pytest.raises(InputError, match=r'camera\[1\]\.name: expected letters, .*, found "a/b"'):
        film_name("a/b", 1)
