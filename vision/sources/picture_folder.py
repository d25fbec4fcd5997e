"""Pictures of any names in a folder as frames."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from vision.sources.frames import Frame, SourceError, quiet_opencv

SUFFIXES = (".png", ".jpg", ".jpeg")


def pictures_in(folder: Path) -> list[Path]:
    """The PNG and JPEG pictures of a folder, sorted by name, hidden ones left out."""
    found = (path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES and not path.name.startswith("."))
    return sorted(path for path in found if path.is_file())


class PictureFolderFrames:
    """The pictures of a folder in the order of their names, so many a second.

    Raises SourceError if there are none, and while iterating for one that cannot be read.
    """

    def __init__(self, folder: str | Path, fps: float) -> None:
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
            with quiet_opencv():
                image = cv2.imread(str(path), cv2.IMREAD_COLOR)
            if image is None:
                raise SourceError(f"{path}: expected a picture, found a file that cannot be read as one")
            yield Frame(index, index / self._fps, np.asarray(image, dtype=np.uint8))

    def close(self) -> None:
        """Nothing is held open."""
