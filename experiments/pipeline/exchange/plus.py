"""A recording and its estimates as a sequence file of PLUS: what `softaim export --to plus` does."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import BinaryIO

import numpy as np

from experiments.arrays import Floats
from experiments.formats.exchange.plus_file import WHOLE_READ_BYTES, transform_fields, write_plus
from experiments.formats.exchange.results import Results
from experiments.formats.recording import Recording
from experiments.formats.scene.scene import Scene
from experiments.log import LOG
from experiments.pipeline.exchange.exported import Exported
from vision import Frame
from vision.arrays import Image

Advance = Callable[[float], None]


def export_plus(of: Exported, stream: BinaryIO, advance: Advance = lambda _share: None) -> int:
    """Write a PLUS sequence file; returns the number of usable target estimates. Raises SourceError."""
    recording, estimates = of.recording, of.estimates
    n_frames = len(recording.exposures_s)
    if recording.source is None:
        write_plus(stream, _fields(of), None, n_frames=n_frames, size_px=(1, 1))
    else:
        size_px = recording.scene.cameras[0].size_px
        if 3 * size_px[0] * size_px[1] * n_frames >= WHOLE_READ_BYTES:
            LOG.warning("PLUS does not read sequences of 4 GiB or more, like these %d pictures", n_frames)
        with recording.open_frames() as pictures:
            images = _images(recording, pictures, advance)
            write_plus(stream, _fields(of), images, n_frames=n_frames, size_px=size_px)
    return 0 if estimates is None else int(estimates.trusted[[*_by_frame(estimates).values()]].sum())


def _fields(of: Exported) -> Iterator[dict[str, str]]:
    """The sequence file's fields for each frame."""
    recording, estimates, advice = of.recording, of.estimates, of.advice
    picture = None if recording.source is None else picture_to_plane(recording.scene)
    rows, advised = _by_frame(estimates), _by_frame(advice)
    trusted = np.zeros(0, dtype=bool) if estimates is None else estimates.trusted
    for k, exposure_s in enumerate(recording.exposures_s):
        seconds, nanoseconds = divmod(of.time_ns(float(exposure_s)), 10**9)
        fields = {"Timestamp": f"{seconds}.{nanoseconds:09d}"}
        if picture is not None:
            fields |= transform_fields("ImageToReference", picture)
        if estimates is not None:
            row = rows.get(k)
            known = row is not None and bool(trusted[row])
            fields |= transform_fields("TargetToReference", translation_mm(estimates.means[row]) if known else None)
            if row is not None:
                fields["TargetStatus"] = estimates.table.texts["status"][row]
            if known:
                fields["TargetCovariance"] = " ".join(f"{1e6 * x:.9g}" for x in estimates.covs[row].ravel())
        if advice is not None and k in advised:
            fields["Advice"] = advice.table.texts["advice"][advised[k]]
        yield fields


def _by_frame(rows: Results | None) -> dict[int, int]:
    """Map from a frame's index to the row that has the frame's result; frames without a row are omitted."""
    return {} if rows is None else {int(frame): row for row, frame in enumerate(rows.frames) if frame >= 0}


def _images(recording: Recording, pictures: Iterable[Frame], advance: Advance) -> Iterator[Image]:
    """The pictures' pixels."""
    for picture in pictures:
        yield picture.image
        advance((picture.index + 1) / len(recording.exposures_s))


def translation_mm(place_m: Floats) -> Floats:
    """Homogeneous matrix of the translation from the origin to a position [m], (dim,); the matrix, (4, 4), is in mm."""
    shift = np.eye(4)
    shift[: len(place_m), 3] = 1e3 * place_m
    return shift


def picture_to_plane(scene: Scene) -> Floats:
    """Affine map from pixels to the plane [mm], (4, 4): the camera's own map, linearised at the centre of the marks."""
    camera, network = scene.cameras[0], scene.network
    middle_m = np.mean([network.positions[network.index(mark.node)] for mark in scene.marks], axis=0)
    u, v = camera.project(middle_m[None])[0]
    around = np.array([[u + 0.5, v], [u - 0.5, v], [u, v + 0.5], [u, v - 0.5]])
    right, left, down, up = 1e3 * camera.to_plane(around)
    matrix = np.eye(4)
    matrix[:2, 0], matrix[:2, 1] = right - left, down - up
    matrix[:2, 3] = 1e3 * middle_m - matrix[:2, :2] @ (u, v)
    matrix[2, 2] = np.sign(det := np.linalg.det(matrix[:2, :2])) * np.sqrt(abs(det))
    return matrix


def picture_off_mm(scene: Scene) -> float:
    """Largest error of the affine map `picture_to_plane` at a mark's position in the scene [mm]."""
    camera, network = scene.cameras[0], scene.network
    places_m = np.array([network.positions[network.index(mark.node)] for mark in scene.marks])
    matrix = picture_to_plane(scene)
    shown_mm = camera.project(places_m) @ matrix[:2, :2].T + matrix[:2, 3]
    return float(np.linalg.norm(shown_mm - 1e3 * places_m, axis=1).max())
