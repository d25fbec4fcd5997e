"""Calibration of cameras from pictures of a board: what `softaim calibrate` does."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path

from experiments.errors import InputError, placed, shown
from experiments.formats.camera_file import camera_text
from experiments.formats.camera_yaml import LensFile, opencv_text, ros_text
from experiments.formats.outputs import check_new, write_whole
from vision import (
    DICTIONARIES,
    FILMS,
    Board,
    Calibration,
    CalibrationError,
    CameraViews,
    SourceSettings,
    View,
    board_text,
    calibrate,
    calibrate_together,
    find_board,
    grey_pictures,
)
from vision.cameras.board import larger_board


def board_of(text: str, square_mm: float, charuco: str | None = None, marker_mm: float | None = None) -> Board:
    """The board that the command's options describe; an InputError names the faulty option.

    text: columns x rows, such as 9x6: numbers of inner corners of a chessboard, or of squares of a ChArUco board
    """
    parts = re.fullmatch(r"([1-9]\d{0,2})[xX×]([1-9]\d{0,2})", text.strip())
    if parts is None:
        raise InputError.at("--board", "columns x rows, such as 9x6", shown(text))
    less = 0 if charuco is None else 1
    columns, rows = int(parts[1]) - less, int(parts[2]) - less
    if min(columns, rows) < 3 - less:
        raise InputError.at("--board", f"3 or more {'squares' if less else 'inner corners'} each way", shown(text))
    if charuco is None:
        if marker_mm is not None:
            raise InputError.at("--marker-mm", "--charuco with it", "none")
        return Board(columns, rows, 1e-3 * square_mm)
    dictionary = charuco.upper().removeprefix("DICT_")
    if dictionary not in DICTIONARIES:
        raise InputError.at("--charuco", f"one of {', '.join(DICTIONARIES)}", shown(charuco))
    if marker_mm is None or marker_mm >= square_mm:
        found = "none" if marker_mm is None else str(marker_mm)
        raise InputError.at("--marker-mm", "a length below --square-mm", found)
    with placed("--charuco", ValueError):
        return Board(columns, rows, 1e-3 * square_mm, dictionary, 1e-3 * marker_mm)


def views_of(
    board: Board, paths: Sequence[Path], name: str, advance: Callable[[float], None] = lambda share: None
) -> CameraViews:
    """Views of the board in pictures; name: the camera's name. Raises SourceError for pictures that cannot be read."""
    views: list[View] = []
    left_out: list[str] = []
    size = (0, 0)
    # the number of pictures is known only for files
    expected = sum(_expected(path) for path in paths)
    for k, (picture, image) in enumerate(grey_pictures(paths), start=1):
        size = (image.shape[1], image.shape[0])
        corners = find_board(board, image)
        if corners is None:
            left_out.append(f"{picture}: board not found")
        else:
            larger = None if views else larger_board(board, image, corners)
            if larger is not None:
                raise CalibrationError(
                    f"--board: expected the inner corners of the whole board, found {larger.columns}x{larger.rows}"
                    f" or more in {picture}, with {board.columns}x{board.rows} stated"
                )
            views.append(View(picture, corners))
        advance(min(k / max(expected, 1), 1.0))
    if not views:
        places = ", ".join(map(str, paths[:3])) + (" …" if len(paths) > 3 else "")
        raise CalibrationError(
            f"{places}: expected pictures of {board_text(board)},"
            f" found it in none of {len(left_out)}; check --board, and show the whole board, sharp and evenly lit"
        )
    return CameraViews(name, size, tuple(views), tuple(left_out))


def _expected(path: Path) -> int:
    if path.suffix.lower() in FILMS:
        return SourceSettings().sharp_frames
    return len(list(path.iterdir())) if path.is_dir() else 1


def with_plane(pictures: Sequence[Path], plane: Path | None) -> list[Path]:
    """The paths of pictures; if `plane` is a file that is not among the pictures, its path is appended."""
    if plane is None or not plane.is_file():
        return [*pictures]
    among = any(path.is_file() and path.samefile(plane) for path in pictures)
    inside = any(path.is_dir() and path.samefile(plane.parent) for path in pictures)
    return [*pictures] if among or inside else [*pictures, plane]


def named_folders(cameras: Sequence[str]) -> dict[str, Path]:
    """The folder of each camera, from texts like `left=DIR`; InputError for a text of another form."""
    folders: dict[str, Path] = {}
    for text in cameras:
        name, equals, folder = text.partition("=")
        if not (equals and folder and re.fullmatch(r"\w[\w .-]*", name)):
            raise InputError.at("--camera", "NAME=FOLDER", shown(text))
        if name in folders:
            raise InputError.at("--camera", "a unique name for each camera", f"{shown(name)} twice")
        if not Path(folder).is_dir():
            raise InputError.at(f"--camera {name}", "a folder of pictures", shown(folder))
        for other, taken in folders.items():
            if taken.samefile(folder):
                raise InputError.at(f"--camera {name}", f"a folder other than that of {other}", shown(folder))
        folders[name] = Path(folder)
    if len(folders) < 2:
        raise InputError.at("--camera", "two or more cameras, or pictures without --camera", str(len(folders)))
    return folders


def command(
    pictures: Sequence[Path],
    cameras: Sequence[str],
    board: Board,
    out: Path,
    *,
    plane: Path | None,
    opencv_yaml: Path | None,
    ros_yaml: Path | None,
    vector: str | None,
    picture: Callable[[Calibration, str], bytes],
    force: bool,
    stage: Callable[[str], Callable[[float], None]],
    write: Callable[[Mapping[Path, str | bytes]], None],
    folder: Callable[[Path], AbstractContextManager[Path]],
) -> list[Calibration]:
    """Calibrate one camera from its pictures, or several cameras jointly. Raises errors for bad input.

    One camera: writes camera.toml, a plot and optional files. Several cameras: writes a .toml file and a plot for each.
    vector: additional format of the plots, pdf or svg; picture: function that returns the content of a plot file
    write: function that writes files, given as a map from path to content; folder: opens the folder for several cameras
    """
    if bool(pictures) == bool(cameras):
        found = "both" if pictures else "neither"
        raise InputError.at("calibrate", "pictures of one camera or --camera NAME=FOLDER of several", found)
    ground, forms = None if plane is None else plane.name, ["png", *([vector] if vector else [])]
    if pictures:
        if out.suffix.lower() != ".toml":
            raise InputError.at(f"--out {out}", "a file name that ends in .toml", "another")
        plots = {form: out.with_suffix(f".{form}") for form in forms}
        for path in (out, *plots.values(), opencv_yaml, ros_yaml):
            if path is not None:
                check_new(path, force)
        own = views_of(board, with_plane(pictures, plane), out.stem, stage("boards"))
        one = calibrate(own.views, own.size_px, ground, name=own.name, left_out=own.left_out)
        files: dict[Path, str | bytes] = {out: camera_text(one)}
        files |= {path: picture(one, form) for form, path in plots.items()}
        if opencv_yaml is not None:
            files[opencv_yaml] = opencv_text(LensFile(one.lens, one.size_px))
        if ros_yaml is not None:
            files[ros_yaml] = ros_text(LensFile(one.lens, one.size_px, one.name))
        write(files)
        return [one]
    if opencv_yaml is not None or ros_yaml is not None:
        raise InputError.at("--opencv-yaml, --ros-yaml", "pictures of one camera", "--camera")
    seen = [views_of(board, [pictured], name, stage(name)) for name, pictured in named_folders(cameras).items()]
    with folder(out) as inside:
        done = calibrate_together(board, seen, ground)
        for camera in done:
            write_whole(inside / f"{camera.name}.toml", camera_text(camera))
            for form in forms:
                (inside / f"{camera.name}.{form}").write_bytes(picture(camera, form))
    return done
