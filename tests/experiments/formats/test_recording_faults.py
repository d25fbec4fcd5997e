"""Every fault of a recording is reported in one line: file, row, column, expected, found."""

from collections.abc import Callable
from pathlib import Path

import cv2
import pytest

from experiments.formats.recording import read_recording
from tests.experiments.formats.test_recording import SIZE_PX, folder, picture
from tests.experiments.rows import complaint, rows
from vision import VideoWriter

__all__ = ["folder"]

FRAMES = "frame,exposure_s\n0,0.0\n1,0.1\n2,0.2\n"
TRUTH = "time_s,node,x_mm,y_mm\n0.0,M1,1,2\n0.0,M2,3,4\n0.1,M1,1,2\n"
MARKS = "time_s,node,x_mm,y_mm,sd_mm\n0.0,M1,1,2,0.5\n0.0,M2,3,4,0.5\n0.1,M1,1,2,0.5\n"
FIXES = "time_s,x_mm,y_mm,sd_mm\n0.0,1,2,0.5\n0.1,1,2,0.5\n"


def write_video(path: Path, n_frames: int) -> None:
    with VideoWriter(path, SIZE_PX, 30.0) as video:
        for _ in range(n_frames):
            video.write(picture(0))


def fault_of(folder: Path) -> str:
    """What is said of a bad recording, without the folder's own name; nothing in it may have changed."""
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*")}
    reported = complaint(read_recording, folder)
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*")} == before
    return reported.replace(f"{folder}/", "").replace(str(folder), "rec")


BAD_TABLES = r"""
frames.csv | frame,exposure_s\n0,0.0\n1,0.1\n2,0.2\n |  | expected columns frame, exposure_s, found an empty file
frames.csv | frame, | camera,frame, | camera: one camera is supported
frames.csv | 1,0.1 | 2,0.1 | row 3: frame: expected 1, found 2
frames.csv | 0,0.0\n |  | row 2: frame: expected 0, found 1
frames.csv | 0.1 | 0.3 | row 4: exposure_s: expected more than 0.3 (the row before), found 0.2
frames.csv | 0.1 | nan | row 3: exposure_s: expected a finite number, found "nan"
truth.csv | 0.0,M1,1,2\n0.0,M2,3,4\n0.1,M1,1,2\n |  | expected a row for each time and node, found none
frames.csv | 0,0.0\n1,0.1\n2,0.2\n |  | expected a row for each frame, found none
truth.csv | 0.1,M1 | 0.0,M1 | row 4: time_s: expected more than 0 (row 2), found 0
truth.csv | 3,4 | 3,NaN | row 3: y_mm: expected a finite number, found "NaN"
truth.csv | y_mm | y_mm,z_mm | z_mm: expected no such column for a flat scene, found it
truth.csv | ,y_mm |  | row 1: expected one column y_mm, found none in "time_s,node,x_mm"
marks.csv | 4,0.5 | 4,0 | row 3: sd_mm: expected 1e-6 to 1e6, found 0
marks.csv | 4,0.5 | 4,1e-200 | row 3: sd_mm: expected 1e-6 to 1e6, found 1e-200
marks.csv | 4,0.5 | 4,1e200 | row 3: sd_mm: expected 1e-6 to 1e6, found 1e+200
marks.csv | 3,4 | 1e300,4 | row 3: x_mm: expected -1e6 to 1e6, found 1e+300
marks.csv | 3,4 | nan,4 | row 3: x_mm: expected a finite number, found "nan"
marks.csv | sd_mm | sd_mm,camera | camera: one camera is supported
marks.csv | 0.0,M1,1,2,0.5\n0.0,M2,3,4,0.5\n0.1,M1,1,2,0.5\n |  | expected a row for each mark, found none, and no
    frames.csv
fixes.csv | 2,0.5\n0.1 | 2,0\n0.1 | row 2: sd_mm: expected 1e-6 to 1e6, found 0
fixes.csv | 1,2,0.5 | 1,1e300,0.5 | row 2: y_mm: expected -1e6 to 1e6, found 1e+300
fixes.csv | 0.1 | -1 | row 3: time_s: expected 0 (the row before) or more, found -1
"""


@pytest.mark.parametrize(("name", "old", "new", "message"), rows(BAD_TABLES))
def test_a_fault_of_a_table_is_reported_with_row_and_column(folder: Path, name: str, old: str, new: str, message: str):
    if name == "marks.csv":
        tables = {"marks.csv": MARKS}
    else:
        write_video(folder / "video.avi", 3)
        tables = {"frames.csv": FRAMES, "truth.csv": TRUTH, "fixes.csv": FIXES}
    for table, content in tables.items():
        (folder / table).write_text(content, encoding="utf-8")
    read_recording(folder)  # good before
    assert old in tables[name]
    (folder / name).write_text(tables[name].replace(old, new, 1), encoding="utf-8")
    assert fault_of(folder) == f"{name}: {message}"


def pictures(*names: str) -> Callable[[Path], None]:
    """Write pictures into frames/."""

    def write(folder: Path) -> None:
        (folder / "frames").mkdir()
        for name in names:
            cv2.imwrite(str(folder / "frames" / name), picture(0))

    return write


def text(name: str, content: str) -> Callable[[Path], object]:
    """Write a file."""
    return lambda folder: (folder / name).write_text(content, encoding="utf-8")


def touched(*names: str) -> Callable[[Path], object]:
    return lambda folder: [(folder / name).touch() for name in names]


def with_cameras(n: int) -> Callable[[Path], None]:
    """A film and a scene with so many cameras."""

    def write(folder: Path) -> None:
        write_video(folder / "video.avi", 3)
        scene, head, camera = (folder / "scene.toml").read_text(encoding="utf-8").partition("[[camera]]")
        cameras = [head + camera.replace("front", f"front {k}") for k in range(n)]
        (folder / "scene.toml").write_text("\n".join([scene, *cameras]), encoding="utf-8")

    return write


KINDS = "video.avi, video.mp4, video.mkv, frames/ or marks.csv"
ONE = "(one camera is supported)"
ROW_4 = "marks.csv: row 4: time_s: expected an exposure time of frames.csv, found"
BAD_FOLDERS = [
    (touched("video.avi", "video.mkv"), f"rec: expected one of {KINDS}, found video.avi and video.mkv"),
    (
        touched("video.left.avi", "video.right.avi"),
        f"rec: expected video.avi, video.mp4 or video.mkv {ONE}, found video.left.avi and video.right.avi",
    ),
    (with_cameras(2), f"scene.toml: camera: expected one for video.avi {ONE}, found 2"),
    (with_cameras(0), f"scene.toml: camera: expected one for video.avi {ONE}, found 0"),
    (lambda f: [(f / "scene.toml").unlink(), text("video.avi", "")(f)], "scene.toml: expected a file, found none"),
    (text("frames", ""), "frames: expected a folder, found a file"),
    (lambda f: (f / "video.avi").mkdir(), "video.avi: expected a file, found a folder"),
    (
        lambda f: write_video(f / "video.avi", 2),
        "frames.csv: expected a row for each of the 2 frames of video.avi, found 3 rows",
    ),
    (pictures("000000.png", "000002.png"), "frames/000001.png: expected a picture for frame 1, found none"),
    (text("marks.csv", MARKS.replace("0.1,M1", "0.15,M1")), f"{ROW_4} 0.15"),
    (text("marks.csv", MARKS.replace("0.1,M1", "0.21,M1")), f"{ROW_4} 0.21"),
]


@pytest.mark.parametrize(("spoil", "message"), BAD_FOLDERS, ids=[said for _, said in BAD_FOLDERS])
def test_a_fault_of_the_folder_is_reported(folder: Path, spoil: Callable[[Path], object], message: str):
    (folder / "frames.csv").write_text(FRAMES, encoding="utf-8")
    spoil(folder)
    assert fault_of(folder) == message


def test_a_film_cut_off_is_reported_by_its_counts(folder: Path):
    """The header still says 30 frames."""
    write_video(folder / "video.avi", 30)
    whole = (folder / "video.avi").read_bytes()
    (folder / "video.avi").write_bytes(whole[: len(whole) // 2])
    rows = "".join(f"{k},{k}\n" for k in range(30))
    (folder / "frames.csv").write_text(f"frame,exposure_s\n{rows}", encoding="utf-8")
    reported = fault_of(folder)
    assert reported.startswith("frames.csv: expected a row for each of the ")
    assert reported.endswith(" frames of video.avi, found 30 rows")


def test_a_scene_of_another_s_is_named_by_its_own_path(folder: Path, tmp_path: Path):
    (folder / "marks.csv").write_text(MARKS, encoding="utf-8")
    said = complaint(read_recording, folder, tmp_path / "other.toml")
    assert said == f"{tmp_path}/other.toml: expected a file, found none"
