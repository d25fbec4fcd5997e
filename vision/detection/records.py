"""A mark seen in a picture, and what was seen there and is none.

Image axes: u right, v down, the centre of the first pixel is (0, 0).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from vision.arrays import Floats


class HueError(ValueError):
    """A range of hues that cannot distinguish marks from the scene."""


@dataclass(frozen=True, slots=True, eq=False)
class Detection:
    """One mark seen.

    center_px: its centre [px], shape (2,)
    cov_px2: covariance of that [px²], shape (2, 2), from the noise around the mark and its area
    area_px: what is seen of it [px]
    hue_deg: the hue of its class
    clipped: it touches the border of what was searched, so part of it was not seen
    occluded: something hides part of it, so its centre is that of its outline
    color_bgr: of its core [grey levels]
    size: by that of the outline it was searched with
    """

    center_px: Floats
    cov_px2: Floats
    area_px: float
    hue_deg: float
    clipped: bool
    occluded: bool = False
    color_bgr: tuple[float, ...] = (0.0, 0.0, 0.0)
    size: float = 1.0


class Reason(StrEnum):
    """Why something seen is not a mark, or a mark was not found."""

    FEW_PIXELS = "too few pixels of its hue"
    """Less of its hue than the least that a mark must show: covered, in shadow, or of another hue than stated."""
    SIZE = "wrong size"
    """A whole mark of another diameter, or more of its hue than a mark has."""
    SHAPE = "wrong shape"
    """Too long, or no edge of it lies on the outline of a mark."""
    CONTRAST = "no contrast"
    """It cannot be distinguished from what lies behind it."""
    STAIN = "uneven as a stain"
    """Noisier than a mark of one colour."""
    COLOUR = "another colour"
    """Of its range of hues, but not of the colour that such marks have shown until now."""
    UNLIKE = "unlike itself before"
    """Seen, but neither it nor any place near looks as the mark did."""
    AMBIGUOUS = "one of two that touch"
    """Seen, but its name could as well be that of another mark that it touches."""
    TAKEN = "taken for another mark"
    """The only mark of its hue where it is expected is another's."""
    FAR = "too far from where it was expected"
    """Marks of its hue are seen, all further away than the gate allows."""
    OUTSIDE = "outside the picture"
    """It is expected where the camera does not look."""
    FLOODED = "its hue is all over the picture"
    """A hue takes more of the picture than marks can."""


@dataclass(frozen=True, slots=True, eq=False)
class Rejected:
    """Pixels of a hue that hang together and are no mark.

    reason: why not; detail: the numbers that decided
    center_px: the middle of them [px], (2,); area_px: how many [px]; hue_deg: of their class
    """

    reason: Reason
    detail: str
    center_px: Floats
    area_px: float
    hue_deg: float
