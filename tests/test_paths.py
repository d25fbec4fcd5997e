"""Every public function that takes a path takes a text, a Path and whatever else is `os.PathLike`."""

import inspect
import os
import re
from collections.abc import Callable
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


CALLS: dict[str, Callable[[Callable[[str], Any]], object]] = {
    "softaim.open_source": lambda of: list(softaim.open_source(of("film.avi"), live=False)),
    "softaim.read_recording": lambda of: softaim.read_recording(of("rec"), of("scene.toml")),
    "softaim.read_scene": lambda of: softaim.read_scene(of("scene.toml")),
    "softaim.write_scene": lambda of: softaim.write_scene(softaim.read_scene("scene.toml"), of("new.toml")),
    "vision.FolderFrames": lambda of: list(vision.FolderFrames(of("frames"), TIMES_S)),
    "vision.PictureFolderFrames": lambda of: list(vision.PictureFolderFrames(of("frames"), 10.0)),
    "vision.SegmentFrames": lambda of: list(vision.SegmentFrames(of("pieces"), TIMES_S)),
    "vision.SegmentWriter": lambda of: vision.SegmentWriter(of("new"), (64, 48)).write(picture()),
    "vision.VideoFileFrames": lambda of: list(vision.VideoFileFrames(of("film.avi"))),
    "vision.VideoWriter": lambda of: vision.VideoWriter(of("new.avi"), (64, 48), 10.0).close(),
    "vision.count_frames": lambda of: vision.count_frames(of("film.avi")),
    "vision.count_numbered": lambda of: vision.count_numbered(of("frames")),
    "vision.count_segment_frames": lambda of: vision.count_segment_frames(of("pieces")),
    "vision.grey_picture": lambda of: vision.grey_picture(of("frames/000000.png")),
    "vision.grey_pictures": lambda of: list(vision.grey_pictures([of("frames")])),
    "vision.join_segments": lambda of: vision.join_segments(of("pieces"), of("new.mkv"), 2, 10.0),
    "vision.open_source": lambda of: list(vision.open_source(of("film.avi"), live=False)),
    "vision.segments_in": lambda of: vision.segments_in(of("pieces")),
    "vision.sharp_frames": lambda of: list(vision.sharp_frames(of("film.avi"))),
}


def picture() -> np.ndarray:
    return np.full((48, 64, 3), 90, dtype=np.uint8)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A scene, a recording of marks, a film, its pieces, numbered pictures."""
    monkeypatch.chdir(tmp_path)
    for name in ("rec", "frames", "pieces", "new"):
        Path(name).mkdir()
    network = four_mass_phantom()
    marks = tuple(Mark(node, 0.0, 0.03) for node in ("M1", "M3", "M4"))
    write_scene(Scene(network, marks, Target("M2", 0.005), ()), Path("scene.toml"))
    Path("rec/marks.csv").write_text("time_s,node,x_mm,y_mm,sd_mm\n0,M1,0,180,1\n", encoding="utf-8")
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
@pytest.mark.parametrize("of", [str, Path, Named])
@pytest.mark.parametrize("name", CALLS)
def test_a_path_is_taken_as_text_and_as_what_is_like_one(name: str, of: Callable[[str], Any]) -> None:
    CALLS[name](of)


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
