"""Open a source by its name: those of `vision.open_source`, recordings, and the simulated phantom."""

from __future__ import annotations

from pathlib import Path

import vision
from experiments.errors import InputError
from experiments.formats.recording import read_recording
from experiments.formats.scenario import read_scenario
from experiments.formats.scene.scene import Scene, usable_scene, with_step
from experiments.simulation.phantom_process import PHANTOM, SCENARIO, PhantomProcess
from experiments.simulation.simulate import scene_of
from experiments.version import version

FILM = "film+"
"""Prefix of udp:// for a film; `softaim live` otherwise reads datagrams as marks."""


def open_source(
    spec: str,
    scene_path: Path | None,
    *,
    live: bool,
    fps: float | None = None,
    usual_fps: float | None = None,
    phantom: PhantomProcess | None = None,
) -> tuple[Scene | None, vision.Source]:
    """The frames of `spec`, and the scene: that of scene_path, else its own, or None.

    live, fps: as in `vision.open_source`, fps also for the phantom; usual_fps: for a folder of pictures without fps;
    phantom: its process, if started ahead. Raises InputError, also if the scene has no camera.
    """
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
    folder = Path(spec)
    if folder.is_dir() and ((folder / "frames.csv").exists() or (folder / "scene.toml").exists()):
        without_fps(spec, fps, "a recording")
        recording = read_recording(folder, scene_path)
        return recording.scene, vision.from_file(recording.open_frames(), live=live)
    try:
        if fps is None and folder.is_dir():
            fps = usual_fps
        return scene, vision.open_source(spec.removeprefix(FILM), live=live, fps=fps)
    except vision.SourceError as error:
        raise InputError(str(error)) from error


def without_fps(spec: str, fps: float | None, what: str) -> None:
    """Raise InputError for a frame rate with a source that has its own times."""
    if fps is not None:
        raise InputError.at(spec, f"no fps beside {what}", f"{fps:g}")


def filmed_scene(path: Path) -> Scene:
    """The scene of a file; InputError if it has no camera."""
    scene = usable_scene(path, rests=False)
    if not scene.cameras:
        in_space = f"{len(scene.space_cameras)} in space" if scene.space_cameras else "none"
        raise InputError.at(f"{path}: camera", "one", scene.n_cameras if scene.lenses else in_space)
    return scene


def check_size(frame: vision.Frame, scene: Scene) -> None:
    """Raise InputError for a frame of another size than the scene's camera."""
    height, width = frame.image.shape[:2]
    size_px = scene.cameras[0].size_px
    if size_px != (width, height):
        raise InputError.at("scene: camera[0].size_px", f"[{width}, {height}], like the frames", str(list(size_px)))
