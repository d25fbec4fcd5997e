"""Every public function that takes a path takes a text, a Path and whatever else is `os.PathLike`."""

import inspect
import os
import re
from collections.abc import Callable, Iterable
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import dynamics
import estimators
import softaim
import vision
from dynamics import four_mass_phantom
from experiments.formats.scene.scene import Mark, Scene, Target, write_scene

TIMES_S = (0.0, 0.1)


class Named:
    """A path that is neither text nor `Path`."""

    def __init__(self, path: str) -> None:
        self._path = path

    def __fspath__(self) -> str:
        return self._path


Of = Callable[[str], Any]
CALLS: dict[str, tuple[Callable[[Of], object], object]] = {
    "softaim.open_source": (lambda of: length(softaim.open_source(of("film.avi"), live=False)), 2),
    "softaim.read_recording": (lambda of: len(softaim.read_recording(of("rec"), of("scene.toml")).exposures_s), 1),
    "softaim.read_result": (lambda of: len(softaim.read_result(of("result")).estimates), 1),
    "softaim.read_scene": (lambda of: softaim.read_scene(of("scene.toml")).target.node, "M2"),
    "softaim.write_scene": (lambda of: (softaim.write_scene(scene(), of("new.toml")), exists("new.toml"))[1], True),
    "vision.FolderFrames": (lambda of: length(vision.FolderFrames(of("frames"), TIMES_S)), 2),
    "vision.PictureFolderFrames": (lambda of: length(vision.PictureFolderFrames(of("frames"), 10.0)), 2),
    "vision.SegmentFrames": (lambda of: length(vision.SegmentFrames(of("pieces"), TIMES_S)), 2),
    "vision.SegmentWriter": (lambda of: write_piece(of("new")), 1),
    "vision.VideoFileFrames": (lambda of: length(vision.VideoFileFrames(of("film.avi"))), 2),
    "vision.VideoWriter": (lambda of: write_film(of("new.avi")), 2),
    "vision.count_frames": (lambda of: vision.count_frames(of("film.avi")), 2),
    "vision.count_numbered": (lambda of: vision.count_numbered(of("frames")), 2),
    "vision.count_segment_frames": (lambda of: vision.count_segment_frames(of("pieces")), 2),
    "vision.grey_picture": (lambda of: vision.grey_picture(of("frames/000000.png")).shape, (48, 64)),
    "vision.grey_pictures": (lambda of: length(vision.grey_pictures([of("frames")])), 2),
    "vision.join_segments": (
        lambda of: (vision.join_segments(of("pieces"), of("new.mkv"), 2, 10.0), exists("new.mkv"))[1],
        True,
    ),
    "vision.open_source": (lambda of: length(vision.open_source(of("film.avi"), live=False)), 2),
    "vision.segments_in": (lambda of: length(vision.segments_in(of("pieces"))), 1),
    "vision.sharp_frames": (lambda of: length(vision.sharp_frames(of("film.avi"))), 2),
}
"""A call, and what comes of it: mostly how many frames there are."""


def length(made: Iterable[object]) -> int:
    return len(list(made))


def exists(name: str) -> bool:
    return Path(name).is_file()


def write_piece(folder: Any) -> int:
    pieces = vision.SegmentWriter(folder, (64, 48))
    pieces.write(picture())
    pieces.finish()
    return vision.count_segment_frames("new")


def write_film(film: Any) -> int:
    with vision.VideoWriter(film, (64, 48), 10.0) as frames:
        for _ in TIMES_S:
            frames.write(picture())
    return vision.count_frames("new.avi")


def scene() -> Scene:
    marks = tuple(Mark(node, 0.0, 0.03) for node in ("M1", "M3", "M4"))
    return Scene(four_mass_phantom(), marks, Target("M2", 0.005), ())


def picture() -> np.ndarray:
    return np.full((48, 64, 3), 90, dtype=np.uint8)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A scene, a recording of marks, its result, a film, its pieces, numbered pictures."""
    monkeypatch.chdir(tmp_path)
    for name in ("rec", "result", "frames", "pieces", "new"):
        Path(name).mkdir()
    write_scene(scene(), Path("scene.toml"))
    Path("rec/marks.csv").write_text("time_s,node,x_mm,y_mm,sd_mm\n0,M1,0,180,1\n", encoding="utf-8")
    rows = "time_s,status,x_mm,y_mm,marks_used,model_only\n0,TRACKING,0,180,3,False\n"
    Path("result/estimates.csv").write_text(rows, encoding="utf-8")
    with vision.VideoWriter("film.avi", (64, 48), 10.0) as film:
        for k, _ in enumerate(TIMES_S):
            film.write(picture())
            cv2.imwrite(f"frames/{k:06d}.png", picture())
    pieces = vision.SegmentWriter(Path("pieces"), (64, 48))
    for _ in TIMES_S:
        pieces.write(picture())
    pieces.finish()
    return tmp_path


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize("of", [str, Named])
@pytest.mark.parametrize("name", CALLS)
def test_a_path_is_taken_as_text_and_as_what_is_like_one(name: str, of: Of) -> None:
    call, result = CALLS[name]
    assert call(of) == result


def takers() -> dict[str, list[str]]:
    """Public functions and classes, records aside, with the types of those of their parameters that are paths."""
    found: dict[str, list[str]] = {}
    for package in (softaim, dynamics, estimators, vision):
        for name in package.__all__:
            one = getattr(package, name)
            if not callable(one) or is_dataclass(one):
                continue
            try:
                parameters = inspect.signature(one).parameters.values()
            except ValueError:  # of a class of Python's own
                continue
            types = [str(p.annotation) for p in parameters if re.search(r"\b(File)?Path\b|PathLike", str(p.annotation))]
            if types:
                found[f"{package.__name__}.{name}"] = types
    return found


def test_every_function_that_takes_a_path_is_tried() -> None:
    assert set(takers()) == set(CALLS)


def test_every_path_is_declared_as_one_type() -> None:
    assert vision.FilePath == str | os.PathLike[str]
    for name, types in takers().items():
        assert not [text for text in types if re.search(r"(?<!File)\bPath\b", text)], name
