"""Reasons why marks were not found in a frame, derived from what the finder's stages rejected."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from vision.arrays import Floats
from vision.detection.components import BLOCK_AREA_PX
from vision.detection.expected import Expected
from vision.detection.records import Detection, HueError, Reason, Rejected
from vision.tracking.association import squared_distance
from vision.tracking.settings import FinderSettings


@dataclass(frozen=True, slots=True, eq=False)
class LostMark:
    """A mark that was not found in a frame.

    reason: why it was not found; detail: numbers on which the decision is based, as text; may be empty
    candidate_px: centre of the rejected pixels [px], (2,); None if no pixels were rejected
    """

    name: str
    reason: Reason
    detail: str = ""
    candidate_px: Floats | None = None


@dataclass(slots=True, eq=False)
class Rejections:
    """What the finder rejected in one frame.

    pieces: rejected groups of connected pixels; detections: rejected detections, each with the reason
    dropped: reason and detection of each mark that was found and later rejected, by name of the mark
    flooded: HueError of a hue that covers most of the picture; None: there is no such hue
    """

    pieces: list[Rejected] = field(default_factory=list)
    detections: list[tuple[Detection, Reason]] = field(default_factory=list)
    dropped: dict[str, tuple[Reason, Detection | None]] = field(default_factory=dict)
    flooded: HueError | None = None

    def note(self, reason: Reason | None, name: str | None, seen: Detection | None) -> None:
        """Record a rejected candidate. Without a reason, nothing is recorded: a later stage may find the mark."""
        if reason is None:
            return
        if name is not None:
            self.dropped[name] = reason, seen
        elif seen is not None:
            self.detections.append((seen, reason))

    def begin_again(self) -> None:
        """Clear all rejections, because the whole picture will be searched."""
        self.pieces.clear()
        self.detections.clear()
        self.dropped.clear()


def lost_marks(
    missing: Sequence[Expected],
    found: Mapping[str, Detection],
    unassigned: Sequence[Detection],
    rejections: Rejections,
    *,
    size_px: tuple[int, int],
    settings: FinderSettings,
) -> tuple[LostMark, ...]:
    """The reason why each missing mark was not found.

    found: detections of the found marks, by name; unassigned: detections that belong to no expected mark
    size_px: width and height of the picture

    The first reason that applies is returned. (1) A hue covers the picture. (2) The mark was found but rejected later.
    (3) A large group of rejected pixels, a rejected detection or a found mark of this hue lies within the gate around
    the expected position. (4) A detection of this hue lies beyond the gate. (5) The expected position is outside the
    picture. (6) The mark's expected area is below `BLOCK_AREA_PX`. (7) Too few pixels have this hue.
    """
    return tuple(_by_size(one, next(_causes(one, found, unassigned, rejections, size_px, settings))) for one in missing)


def _by_size(one: Expected, lost: LostMark) -> LostMark:
    """The lost mark, with the reason SMALL in place of FEW_PIXELS if the mark is expected to be too small."""
    if lost.reason is not Reason.FEW_PIXELS or one.outline is None or one.outline.area_px >= BLOCK_AREA_PX:
        return lost
    across, least = (2.0 * (area_px / np.pi) ** 0.5 for area_px in (one.outline.area_px, BLOCK_AREA_PX))
    return replace(lost, reason=Reason.SMALL, detail=f"{across:.1f} px across of at least {least:.1f}")


def _causes(
    one: Expected,
    found: Mapping[str, Detection],
    unassigned: Sequence[Detection],
    rejections: Rejections,
    size_px: tuple[int, int],
    settings: FinderSettings,
) -> Iterator[LostMark]:
    """The reasons that apply to a mark, in the order that `lost_marks` states."""
    gate = settings.association.gate
    if rejections.flooded is not None:
        yield LostMark(one.name, Reason.FLOODED, str(rejections.flooded))
    if one.name in rejections.dropped:
        reason, seen = rejections.dropped[one.name]
        yield LostMark(one.name, reason, "", None if seen is None else seen.center_px)
    near = [
        piece for piece in rejections.pieces if piece.hue_deg == one.hue_deg and _piece_distance(one, piece) <= gate
    ]
    largest = max(near, key=lambda piece: piece.area_px, default=None)
    if largest is not None and largest.area_px >= _speck_px(one, settings):
        yield LostMark(one.name, largest.reason, largest.detail, largest.center_px)
    for seen, reason in rejections.detections:
        if seen.hue_deg == one.hue_deg and squared_distance(one, seen) <= gate:
            yield LostMark(one.name, reason, "", seen.center_px)
    for name, seen in found.items():
        if seen.hue_deg == one.hue_deg and squared_distance(one, seen) <= gate:
            yield LostMark(one.name, Reason.TAKEN, name, seen.center_px)
    taken = [id(seen) for seen in found.values()]  # a later stage may have assigned them
    of_its_hue = [seen for seen in unassigned if seen.hue_deg == one.hue_deg and id(seen) not in taken]
    if of_its_hue:
        nearest = min(of_its_hue, key=lambda seen: squared_distance(one, seen))
        away_px = float(np.hypot(*(nearest.center_px - one.center_px)))
        sds = squared_distance(one, nearest) ** 0.5
        yield LostMark(
            one.name, Reason.FAR, f"{away_px:.0f} px, {sds:.0f} sigma of at most {gate**0.5:.1f}", nearest.center_px
        )
    u, v = one.center_px.tolist()
    if not (-0.5 <= u < size_px[0] - 0.5 and -0.5 <= v < size_px[1] - 0.5):
        yield LostMark(one.name, Reason.OUTSIDE)
    if largest is not None:
        yield LostMark(one.name, largest.reason, largest.detail, largest.center_px)
    yield LostMark(one.name, Reason.FEW_PIXELS, "none where it was expected")


def _piece_distance(one: Expected, piece: Rejected) -> float:
    """Squared Mahalanobis distance of a rejected piece from the expected mark, of which it may be any part."""
    anywhere = piece.area_px if one.outline is None else max(piece.area_px, one.outline.area_px)
    # the variance of a random point in a disc is a quarter of its squared radius
    cov_px2 = anywhere / (4.0 * np.pi) * np.eye(2)
    return squared_distance(one, Detection(piece.center_px, cov_px2, piece.area_px, piece.hue_deg, False))


def _speck_px(one: Expected, settings: FinderSettings) -> float:
    """Least number of pixels for which `lost_marks` calls a group of rejected pixels large [px]."""
    least = BLOCK_AREA_PX if one.outline is None else settings.detection.outline.min_share * one.outline.area_px
    return min(BLOCK_AREA_PX, least)
