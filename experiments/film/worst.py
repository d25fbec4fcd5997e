"""Worst frames of a film on one sheet: one for each kind of fault, with the number of such frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from estimators import Status
from experiments.film.overlay import LIGHT, Fate, Overlay, wrapped
from experiments.film.strokes import draw_text, text_height
from experiments.pipeline.scores.marks import REFUSED
from experiments.plain import counted
from vision.arrays import Image

TILE_PX = 640
"""Largest width of a picture in worst.png [px]."""
MOST_TILES = 6
"""Largest number of pictures in worst.png: more are illegible on a screen."""
CAPTION_LINES = 2
"""Lines of text above a picture."""
SEVERE = (Status.LOST, Status.DIVERGED, Status.COASTING, Status.TRACKING, Status.INITIALISING)
"""Statuses, the worst first; initialisation is last because it is not a fault of the filter."""


@dataclass(slots=True, eq=False)
class Still:
    """The worst frame of a kind so far, its severity (`badness`), and the number of frames of this kind (`count`)."""

    badness: tuple[float, ...]
    picture: Image
    count: int


class WorstFrames:
    """The worst frame of each kind. A kind is the status, together with the reason why the first mark was missed."""

    def __init__(self) -> None:
        self._stills: dict[tuple[str, str], Still] = {}

    def take(self, overlay: Overlay, picture: Image) -> None:
        """Count a drawn frame, and store it if it is the worst frame of its kind so far."""
        missed = [mark for mark in overlay.marks if mark.fate is not Fate.FOUND and mark.measured]
        # a reason has its numbers in parentheses
        faults = [REFUSED if mark.fate is Fate.REFUSED else mark.why.split(" (")[0] for mark in missed]
        kind = overlay.status, faults[0] if faults else ""
        badness = float(len(missed)), _spread(overlay)
        known = self._stills.get(kind)
        if known is None:
            self._stills[kind] = Still(badness, _tile(picture), 1)
            return
        known.count += 1
        if badness > known.badness:
            known.badness, known.picture = badness, _tile(picture)

    def sheet(self) -> Image | None:
        """The worst frame of each faulty kind, the worst kinds first. Without faulty kinds, the sheet has all kinds."""
        faults = [kind for kind in self._stills if kind != (Status.TRACKING, "") and kind[0] != Status.INITIALISING]
        kinds = faults or list(self._stills)
        if not kinds:
            return None
        kinds.sort(key=lambda kind: (SEVERE.index(Status(kind[0])), -self._stills[kind].count))
        stills = {", ".join(filter(None, kind)): self._stills[kind] for kind in kinds}
        return side_by_side(
            [captioned(one.picture, f"{counted(one.count, 'picture')}: {k}") for k, one in stills.items()]
        )


def captioned(picture: Image, text: str) -> Image:
    """A picture, reduced to at most the width `TILE_PX`, with one or two lines of text above it."""
    tile, line = _tile(picture), text_height(1.0)
    caption = np.zeros((CAPTION_LINES * line + 6, tile.shape[1], 3), dtype=np.uint8)
    for k, words in enumerate(wrapped(text, tile.shape[1] - 8.0, 1.0)[:CAPTION_LINES]):
        draw_text(caption, words, (4.0, 2.0 + k * line), LIGHT, 1.0)
    return np.vstack([caption, tile])


def side_by_side(tiles: Sequence[Image]) -> Image:
    """The first `MOST_TILES` pictures on a sheet, in rows of two. Smaller pictures get a black edge."""
    tiles = tiles[:MOST_TILES]
    height, width = np.max([one.shape[:2] for one in tiles], axis=0)
    shown = [np.pad(one, ((height - len(one), 0), (0, width - one.shape[1]), (0, 0))) for one in tiles]
    across = min(2, len(shown))
    shown += [np.zeros_like(shown[0])] * (-len(shown) % across)
    return np.vstack([np.hstack(shown[k : k + across]) for k in range(0, len(shown), across)])


def _spread(overlay: Overlay) -> float:
    """Standard deviation of the target in the picture [px]; infinite without a covariance, 0 outside the view."""
    if not np.isfinite(overlay.target_px).all():
        return 0.0
    cov = overlay.target_cov_px2
    return float("inf") if cov is None or not np.isfinite(cov).all() else float(np.sqrt(np.trace(cov)))


def _tile(picture: Image) -> Image:
    height, width = picture.shape[:2]
    if width <= TILE_PX:
        return picture
    size = TILE_PX, round(height * TILE_PX / width)
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
