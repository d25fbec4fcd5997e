"""Films of several cameras in a recording of a scene in space; each film has its own exposure times."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from experiments.arrays import Floats
from experiments.errors import InputError, shown
from experiments.formats.films.pictures import (
    FRAMES,
    MARKS,
    VIDEOS,
    Pictures,
    check_pictures,
    open_pictures,
    source_in,
)
from experiments.formats.scene.scene import Scene
from vision import TOGETHER_S, Exposure, Frame

SUFFIXES = "|".join(re.escape(Path(name).suffix) for name in VIDEOS)


@dataclass(frozen=True, slots=True, eq=False)
class CameraFilm:
    """The film of one camera, with its exposure times [s], (n,); `source` is a video file or a folder of pictures."""

    camera: str
    source: Path
    exposures_s: Floats

    def open_frames(self) -> Pictures:
        """Open the frames; raises InputError if they cannot be opened."""
        return open_pictures(self.source, self.exposures_s.tolist())


def film_name(camera: str, i: int) -> str:
    """The name `camera` of the camera with index i; InputError if the name of a film's file must not contain it."""
    if re.fullmatch(r"\w[\w .-]*", camera) is None:
        raise InputError.at(f"camera[{i}].name", "letters, digits, blanks, dots and dashes for its film", shown(camera))
    return camera


def films_in(folder: Path) -> dict[str, Path]:
    """Film `video.NAME.avi` or folder `frames.NAME/` of each camera, by name; InputError if a camera has several."""
    films: dict[str, Path] = {}
    for path in sorted(folder.glob("*.*")):
        named = re.fullmatch(rf"{FRAMES}\.(.+)" if path.is_dir() else rf"video\.(.+)({SUFFIXES})", path.name)
        if named is None:
            continue
        if named[1] in films:
            raise InputError.at(folder, f"one film of camera {named[1]}", f"{films[named[1]].name} and {path.name}")
        films[named[1]] = path
    return films


def read_films(
    folder: Path,
    scene: Scene,
    scene_path: Path,
    read_times: Callable[[Path], Floats],
    advance: Callable[[float], None] = lambda _share: None,
) -> tuple[CameraFilm, ...]:
    """The films of a recording in the order of the scene's cameras; raises InputError.

    read_times: reads the exposure times of a `frames.NAME.csv`
    """
    if scene.network.dim == 2:
        source_in(folder)  # raises InputError for several cameras
    if len(scene.reference.looks) < len(scene.reference.marks):
        raise InputError.at(f"{scene_path}: reference.mark", "hue_deg and diameter_mm, which films need", "none")
    others = [name for name in (*VIDEOS, FRAMES, MARKS) if (folder / name).exists()]
    if others:
        raise InputError.at(folder, "no other source beside films of named cameras", " and ".join(others))
    sources, names = films_in(folder), [camera.name for camera in scene.space_cameras]
    for name, path in sources.items():
        if name not in names:
            expected = f"the name of a camera with lens and pose in the scene ({', '.join(names) or 'none'})"
            raise InputError.at(path, expected, shown(name))
    films: list[CameraFilm] = []
    for i, camera in enumerate(scene.space_cameras):
        if camera.name in sources:
            times, done = folder / f"frames.{camera.name}.csv", len(films)
            film = CameraFilm(camera.name, sources[camera.name], read_times(times))
            check_pictures(
                film.source,
                film.exposures_s,
                times,
                camera.size_px,
                f"{scene_path}: camera[{i}].size_px",
                lambda share, k=done: advance((k + share) / len(sources)),  # type: ignore[misc]
            )
            films.append(film)
    return tuple(films)


def merged(films: Sequence[CameraFilm]) -> tuple[Floats, tuple[tuple[int, ...], ...]]:
    """Exposure times of all cameras [s], (n,), and for each time the indices of the films that have a picture.

    If cameras expose within `vision.TOGETHER_S`, their pictures get the time of the first picture.
    """
    times = np.concatenate([film.exposures_s for film in films])
    owners = np.repeat(np.arange(len(films)), [len(film.exposures_s) for film in films])
    order = np.argsort(times, kind="stable")
    begins: list[float] = []
    groups: list[list[int]] = []
    for time_s, owner in zip(times[order].tolist(), owners[order].tolist(), strict=True):
        if groups and time_s - begins[-1] <= TOGETHER_S and owner not in groups[-1]:
            groups[-1].append(owner)
        else:
            begins.append(time_s)
            groups.append([owner])
    return np.array(begins), tuple(tuple(group) for group in groups)


def exposures_of(films: Sequence[CameraFilm]) -> Iterator[Exposure]:
    """The pictures of all films in order of time. Raises InputError or SourceError if a picture cannot be read."""
    times_s, groups = merged(films)
    with ExitStack() as opened:
        frames: list[Iterator[Frame]] = [iter(opened.enter_context(film.open_frames())) for film in films]
        for time_s, group in zip(times_s.tolist(), groups, strict=True):
            yield Exposure(time_s, {films[k].camera: next(frames[k]).image for k in group})
