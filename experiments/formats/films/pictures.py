"""Pictures of a recording: a film, numbered files, or the pieces of a film that is being recorded."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from experiments.arrays import Floats
from experiments.errors import InputError, placed, shown
from vision import (
    FolderFrames,
    SegmentFrames,
    SourceError,
    VideoFileFrames,
    count_frames,
    count_numbered,
    count_segment_frames,
)

VIDEOS = ("video.avi", "video.mp4", "video.mkv")
FRAMES, MARKS, SEGMENTS = "frames", "marks.csv", "segments"
FOLDERS = (FRAMES, SEGMENTS)
ONE_CAMERA = "one camera is supported"

Pictures = VideoFileFrames | FolderFrames | SegmentFrames


def source_in(folder: Path) -> Path:
    """The film, folder of pictures or marks.csv in a recording's folder; InputError unless there is exactly one."""
    several = sorted(path.name for path in folder.glob("video.*.*") if f"video{path.suffix}" in VIDEOS)
    if several:
        raise InputError.at(folder, f"{', '.join(VIDEOS[:-1])} or {VIDEOS[-1]} ({ONE_CAMERA})", " and ".join(several))
    names = (*VIDEOS, FRAMES, MARKS, SEGMENTS)
    present = [name for name in names if (folder / name).exists()]
    if SEGMENTS in present and any(name in VIDEOS for name in present):
        present.remove(SEGMENTS)  # these pieces have been joined, and will be removed
    if len(present) != 1:
        found = " and ".join(f"{name}/" if name in FOLDERS else name for name in present)
        if not found and any(folder.glob(f"{SEGMENTS}.*")):
            found = f"pieces of films; softaim record --recover {folder} joins them"
        raise InputError.at(folder, f"one of {', '.join(VIDEOS)}, {FRAMES}/ or {MARKS}", found or "none")
    source = folder / present[0]
    if source.is_dir() != (source.name in FOLDERS):
        kinds = ("a file", "a folder")
        raise InputError.at(source, kinds[source.name in FOLDERS], kinds[source.is_dir()])
    return source


def growing_in(folder: Path, camera: str) -> Path:
    """Folder in which a film's pieces and times are stored during the recording. A single camera has the name ""."""
    return folder / f"{SEGMENTS}.{camera}" if camera else folder


def is_folder(source: Path) -> bool:
    """Whether the pictures are numbered files in a folder `frames/` or `frames.NAME/`."""
    return source.name == FRAMES or source.name.startswith(f"{FRAMES}.")


def open_pictures(source: Path, exposures_s: Sequence[float]) -> Pictures:
    """The frames exposed at these times [s]; InputError if they cannot be opened."""
    with placed("", SourceError):
        if is_folder(source):
            return FolderFrames(source, exposures_s)
        return (SegmentFrames if source.name == SEGMENTS else VideoFileFrames)(source, exposures_s)


def count_pictures(source: Path, advance: Callable[[float], None] = lambda _share: None) -> tuple[int, str]:
    """The number of frames, and a noun for them in messages. Raises InputError or SourceError if a picture is missing.

    A film is read completely. `advance` is called with the completed share.
    """
    if source.name == SEGMENTS:
        return count_segment_frames(source), f"frames of {SEGMENTS}/"
    if not is_folder(source):
        return count_frames(source, advance), f"frames of {source.name}"
    n_frames = count_numbered(source)
    for k in range(n_frames):
        if not (source / f"{k:06d}.png").is_file():
            raise InputError.at(source / f"{k:06d}.png", f"a picture for frame {k}", "none")
    return n_frames, f"pictures {source.name}/*.png"


def check_pictures(
    source: Path,
    exposures_s: Floats,
    times: Path,
    size_px: tuple[int, int],
    place: str,
    advance: Callable[[float], None] = lambda _share: None,
) -> None:
    """Raise InputError if pictures are missing, or if their number or their size is wrong.

    times: the file of exposure times, for messages
    size_px: picture size that the scene file states; place: key that states it, for messages
    """
    with placed("", SourceError):
        n_frames, what = count_pictures(source, advance)
        n_rows = len(exposures_s)
        # A killed recorder may have finished a piece without writing its rows.
        if n_frames < n_rows or (n_frames > n_rows and source.name != SEGMENTS):
            raise InputError.at(times, f"a row for each of the {n_frames} {what}", f"{n_rows} rows")
        with open_pictures(source, exposures_s.tolist()) as frames:
            height, width = next(iter(frames)).image.shape[:2]
    if size_px != (width, height):
        expected = f"[{width}, {height}], as the pictures of {source.name} have"
        raise InputError.at(place, expected, shown(list(size_px)))
