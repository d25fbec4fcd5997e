"""Opening of a source of marks by its name: udp://, stdin, marks.csv, or a recording with marks.csv."""

from __future__ import annotations

from pathlib import Path

from experiments.errors import InputError, placed
from experiments.formats.films.pictures import MARKS, source_in
from experiments.formats.marks.drawing import first_marks_line
from experiments.formats.recording import read_frames, read_marks
from experiments.formats.scene.scene import Scene, usable_scene
from experiments.log import LOG
from experiments.pipeline.live.marks.feeds import PipeFeed, udp_feed
from experiments.pipeline.live.marks.receiver import LiveMarks, MarkSource
from experiments.pipeline.live.marks.replay import MarksReplay
from vision import SourceError

STDIN = ("-", "stdin")
UDP = "udp://"


def is_mark_source(spec: str) -> bool:
    """Whether a source of this name delivers marks, not pictures."""
    path = Path(spec)
    return spec in STDIN or spec.startswith(UDP) or path.suffix == ".csv" or (path / MARKS).is_file()


def open_mark_source(spec: str, scene_path: Path | None) -> tuple[Scene, MarkSource]:
    """The scene and the marks of the source `spec`. Raises InputError.

    If scene_path is None, the scene is scene.toml beside marks.csv. A source without marks.csv needs a scene_path.
    """
    path = source_in(Path(spec)) if Path(spec).is_dir() else Path(spec)
    if path.suffix == ".csv":
        scene = usable_scene(path.with_name("scene.toml") if scene_path is None else scene_path)
        frames_csv = path.with_name("frames.csv")
        times_s = read_frames(frames_csv) if path.name == MARKS and frames_csv.exists() else None
        exposures_s, marks = read_marks(path, scene, times_s)
        if (line := first_marks_line(scene, marks)) is not None:
            LOG.warning("%s: %s", path, line)
        return scene, MarksReplay(exposures_s, marks)
    name = f"--source {spec}"
    if scene_path is None:
        raise InputError.at(name, "--scene scene.toml beside it", "none")
    scene = usable_scene(scene_path)
    with placed(name, SourceError):
        return scene, LiveMarks(scene, PipeFeed() if spec in STDIN else udp_feed(spec))
