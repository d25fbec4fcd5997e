"""Frames from the pictures in a folder. The pictures may have any names."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from pathlib import Path

import numpy as np

from vision.sources.frames import FilePath, Frame, SourceError, read_picture

SUFFIXES = (".png", ".jpg", ".jpeg")


def natural_order(path: Path) -> tuple[list[str | int], str, Path]:
    """Sort key for files by name. Numbers in names are compared as numbers: frame2 comes before frame10."""
    parts = re.split(r"(\d+)", path.name)
    return [int(part) if k % 2 else part for k, part in enumerate(parts)], path.name, path


def pictures_in(folder: Path, suffixes: Collection[str] = SUFFIXES) -> list[Path]:
    """The pictures of a folder in `natural_order`; files that begin with a dot are skipped."""
    found = (path for path in folder.iterdir() if path.suffix.lower() in suffixes and not path.name.startswith("."))
    return sorted((path for path in found if path.is_file()), key=natural_order)


class PictureFolderFrames:
    """Pictures of a folder in `natural_order`, at a given frame rate.

    Raises SourceError if there are no pictures. Iteration raises SourceError for a picture that cannot be read.
    """

    def __init__(self, folder: FilePath, fps: float) -> None:
        if not (np.isfinite(fps) and fps > 0):
            raise ValueError(f"fps: expected more than 0, found {fps}")
        self.folder, self._fps = Path(folder), fps
        if not self.folder.is_dir():
            raise SourceError(f"{self.folder}: expected a folder of pictures, found none")
        self._paths = pictures_in(self.folder)
        if not self._paths:
            raise SourceError(f"{self.folder}: expected pictures, *.png or *.jpg, found none")

    def __iter__(self) -> Iterator[Frame]:
        for index, path in enumerate(self._paths):
            yield Frame(index, index / self._fps, read_picture(path))

    def close(self) -> None:
        """Nothing to release."""
