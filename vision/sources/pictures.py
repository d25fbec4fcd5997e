"""Grey pictures for a calibration, with their names: from files, folders of files, or a film."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain, pairwise
from pathlib import Path

import cv2
import numpy as np

from vision.arrays import Image
from vision.sources.frames import FilePath, SourceError, VideoFileFrames, count_frames, read_picture, size_text
from vision.sources.picture_folder import natural_order, pictures_in
from vision.sources.settings import DEFAULTS, SourceSettings

PICTURES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".ppm", ".webp"})
FILMS = frozenset({".avi", ".mp4", ".mkv", ".mov", ".m4v", ".webm", ".mpg", ".mpeg"})
"""File name extensions of films."""


def grey_pictures(paths: Sequence[FilePath], settings: SourceSettings = DEFAULTS) -> Iterator[tuple[str, Image]]:
    """Yield name and grey levels, (height, width), of each picture. The frames of a film come before the picture files.

    paths: picture files, folders of pictures, and at most one film. Only the sharpest frames of the film are used.
    Raises SourceError for unreadable files, a second film, repeated names, and pictures of different sizes.
    """
    given = [Path(path) for path in paths]
    films = [path for path in given if path.suffix.lower() in FILMS]
    if len(films) > 1:
        raise SourceError(f"{films[1]}: expected one film, found a second one after {films[0]}")
    frames = ((films[0], name, image) for name, image in sharp_frames(films[0], settings.sharp_frames)) if films else ()
    files = ((path, path.name, grey_picture(path)) for path in _files([p for p in given if p not in films]))
    first: tuple[str, Image] | None = None
    for path, name, image in chain(frames, files):
        if first is None:
            first = (name, image)
        if image.shape != first[1].shape:
            raise SourceError(f"{path}: expected {size_text(first[1])} as {first[0]} has, found {size_text(image)}")
        yield name, image


def grey_picture(path: FilePath) -> Image:
    """Grey levels of a picture, (height, width). Rotation in metadata is ignored. Raises SourceError if unreadable."""
    file = Path(path)
    if not file.is_file():
        raise SourceError(f"{file}: expected a picture, found no such file")
    return read_picture(file, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION)


def sharp_frames(film: FilePath, n: int = DEFAULTS.sharp_frames) -> Iterator[tuple[str, Image]]:
    """Yield the sharpest frame in each of n parts of a film: name ("frame 000123") and grey levels, (height, width).

    Raises SourceError in the cases of `VideoFileFrames`.
    """
    n_frames = count_frames(film)
    best: tuple[float, str, Image] | None = None
    part = 0
    with VideoFileFrames(film) as frames:
        for frame in frames:
            if frame.index * n // max(n_frames, n) != part and best is not None:
                yield best[1:]
                best, part = None, frame.index * n // max(n_frames, n)
            grey = np.asarray(cv2.cvtColor(frame.image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
            sharpness = float(cv2.Laplacian(grey, cv2.CV_32F).var())
            if best is None or sharpness > best[0]:
                best = (sharpness, f"frame {frame.index:06d}", grey)
    if best is not None:
        yield best[1:]


def _files(paths: Sequence[Path]) -> list[Path]:
    files: list[Path] = []
    for path in paths:
        if path.is_dir():
            found = pictures_in(path, PICTURES)
            if not found:
                raise SourceError(f"{path}: expected a folder of pictures, found none in it")
            files += found
        else:
            files.append(path)
    files.sort(key=natural_order)
    for one, other in pairwise(files):
        if one.name == other.name:
            raise SourceError(f"{other}: expected a unique name, found that of {one}")
    return files
