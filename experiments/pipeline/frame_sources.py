"""Opening of frame sources by name: those of `vision.open_source`, recordings, and the simulated phantom."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import cast

import vision
from experiments.errors import InputError, placed
from experiments.formats.recording import Recording, read_recording
from experiments.formats.scenario import read_scenario
from experiments.formats.scene.scene import Scene, usable_scene, with_step
from experiments.simulation.phantom_process import PHANTOM, SCENARIO, PhantomProcess
from experiments.simulation.simulate import scene_of
from experiments.version import version

FILM = "film+"
"""Prefix of the udp:// address of a film; without the prefix, `softaim live` reads datagrams as marks."""


def open_source(
    spec: str,
    scene_path: Path | None,
    *,
    live: bool,
    fps: float | None = None,
    usual_fps: float | None = None,
    phantom: PhantomProcess | None = None,
) -> tuple[Scene | None, vision.Source]:
    """The scene and the frames of the source `spec`.

    scene_path: the scene's file; without a file, the scene is the source's own, or None if the source has none
    live, fps: as in `vision.open_source`; fps also applies to the phantom
    usual_fps: frame rate of a folder of pictures if `fps` is None; phantom: the phantom's process, if already started
    Raises InputError, also if the scene has no camera.
    """
    recording = _recording_in(spec, scene_path, fps)
    if recording is not None:
        return recording.scene, vision.from_file(recording.open_frames(), live=live)
    scene = None if scene_path is None else filmed_scene(scene_path)
    if spec == PHANTOM:
        seen = with_step(scene_of(read_scenario(SCENARIO)), "simulate", version())
        begun = [] if phantom is None else [phantom]

        def opened() -> PhantomProcess:
            return (begun.pop() if begun else PhantomProcess(fps=fps)).opened()

        frames = vision.LiveFrames(
            opened,
            ends=lambda _capture: True,
            keep=1 if live else vision.SourceSettings().backlog,
            exposures=lambda: vision.stated_exposure_time,
        )
        return (seen if scene is None else scene), frames
    with placed("", vision.SourceError):
        if fps is None and Path(spec).is_dir():
            fps = usual_fps
        return scene, vision.open_source(spec.removeprefix(FILM), live=live, fps=fps)


def open_live(
    specs: Sequence[str], scene_path: Path | None, *, fps: float | None = None, phantom: PhantomProcess | None = None
) -> tuple[Scene | None, vision.Source | vision.SeveralFrames]:
    """Open the sources of a run; returns the scene, as in `open_source`, and a source of the newest frames."""
    named = by_camera(specs)
    if "" not in named:
        scene, cameras = open_each(specs, scene_path, live=True, fps=fps)
        return scene, vision.SeveralFrames(cast(Mapping[str, vision.LiveFrames], cameras))
    recording = _recording_in(named[""], scene_path, fps)
    if recording is not None:
        films = recording.open_films()
        played = vision.played_together(films) if recording.films else vision.from_file(films[""], live=True)
        return recording.scene, played
    return open_source(named[""], scene_path, live=True, fps=fps, phantom=phantom)


def open_each(
    specs: Sequence[str], scene_path: Path | None, *, live: bool, fps: float | None = None
) -> tuple[Scene | None, dict[str, vision.Source]]:
    """The scene, as in `open_source`, and the frames by the name of their camera. A single camera has the name ""."""
    named = by_camera(specs)
    if "" in named:
        scene, frames = open_source(named[""], scene_path, live=live, fps=fps)
        return scene, {"": frames}
    scene = None if scene_path is None else scene_in_space(scene_path, named)
    with placed("", vision.SourceError):
        return scene, {name: vision.open_source(spec, live=live, fps=fps) for name, spec in named.items()}


def _recording_in(spec: str, scene_path: Path | None, fps: float | None) -> Recording | None:
    folder = Path(spec)
    if spec == PHANTOM or not ((folder / "scene.toml").exists() or any(folder.glob("frames*.csv"))):
        return None
    without_fps(spec, fps, "a recording")
    return read_recording(folder, scene_path)


def by_camera(specs: Sequence[str]) -> dict[str, str]:
    """The sources by camera, from texts like NAME=SOURCE; the name is "" for a single source. Raises InputError."""
    named: dict[str, str] = {}
    for spec in specs:
        match = None if Path(spec).exists() else re.fullmatch(r"(\w[\w .-]*)=(.+)", spec)
        name, source = ("", spec) if match is None else match.groups()
        if name in named or (not name and len(specs) > 1):
            expected = "NAME=SOURCE with a unique name" if name else "NAME=SOURCE for each of several cameras"
            raise InputError.at("source", expected, vision.shown_source(spec))
        for other, taken in named.items():
            if Path(taken).resolve() == Path(source).resolve():
                expected = f"a source other than that of {other}"
                raise InputError.at(f"source of camera {name}", expected, vision.shown_source(source))
        named[name] = source
    return named


def scene_in_space(path: Path, cameras: Iterable[str]) -> Scene:
    """The scene of a file; InputError if the scene lacks any of these cameras in space."""
    scene = usable_scene(path, rests=False)
    names = [camera.name for camera in scene.space_cameras]
    for name in cameras:
        if name not in names:
            raise InputError.at(f"source of camera {name}", f"a camera of {path} ({', '.join(names) or 'none'})", name)
    if len(scene.reference.looks) < len(scene.reference.marks):
        raise InputError.at(f"{path}: reference.mark", "hue_deg and diameter_mm, which cameras need", "none")
    return scene


def without_fps(spec: str, fps: float | None, what: str) -> None:
    """Raise InputError if `fps` is stated for a source that has its own frame times; what: the source's kind."""
    if fps is not None:
        raise InputError.at(spec, f"no fps beside {what}", f"{fps:g}")


def filmed_scene(path: Path) -> Scene:
    """Read the scene file at `path`; raises InputError if the scene has no camera."""
    scene = usable_scene(path, rests=False)
    if not scene.cameras:
        in_space = f"{len(scene.space_cameras)} in space: give NAME=SOURCE of each" if scene.space_cameras else "none"
        raise InputError.at(f"{path}: camera", "one", scene.n_cameras if scene.lenses else in_space)
    return scene


def check_size(frame: vision.Frame | vision.Exposure, scene: Scene, camera: str = "") -> None:
    """Raise InputError if a picture does not have its camera's `size_px`; camera: name of the camera in the scene."""
    images = {camera: frame.image} if isinstance(frame, vision.Frame) else frame.images
    names = [one.name for one in scene.space_cameras] or [camera]
    for name, image in images.items():
        i, (height, width) = names.index(name), image.shape[:2]
        size_px = (scene.space_cameras or scene.cameras)[i].size_px
        if size_px != (width, height):
            place = f"scene: camera[{i}].size_px"
            raise InputError.at(place, f"[{width}, {height}], like the frames", str(list(size_px)))
