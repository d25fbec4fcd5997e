"""Records of detected marks, and of rejected pixels with the reason.

Image axes: u right, v down, the centre of the first pixel is (0, 0).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from vision.arrays import Floats


class HueError(ValueError):
    """Error for a range of hues that cannot distinguish marks from the scene."""


@dataclass(frozen=True, slots=True, eq=False)
class Detection:
    """One detected mark.

    center_px: centre of the mark [px], shape (2,)
    cov_px2: covariance of the centre [px²], shape (2, 2)
    area_px: visible area of the mark [px]
    hue_deg: nominal hue of the kind of mark [degrees]
    clipped: whether the mark touches the border of the searched part, so that some of it may be outside
    occluded: whether the centre follows from the visible part of the outline, because something may hide the rest
    color_bgr: colour of the mark's core [grey levels]
    size: size of the mark, relative to the given outline
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
    """Reason why pixels are not a mark, or why a mark was not found."""

    FEW_PIXELS = "too few pixels of its hue"
    """The hue has fewer pixels than a mark must show: the mark is covered, in shadow, or of another hue than stated."""
    SMALL = "too small in the picture"
    """Too few pixels have the hue. The mark is expected to be so small that perhaps no pixel shows only the mark."""
    SIZE = "wrong size"
    """The pixels form a whole mark of another diameter, or there are more pixels than a mark has."""
    SHAPE = "wrong shape"
    """The pixels are too elongated, or have no edge on the outline of a mark."""
    CONTRAST = "no contrast"
    """The pixels cannot be distinguished from the background."""
    STAIN = "uneven as a stain"
    """The noise around the pixels is too strong, relative to their contrast, for a mark of one colour."""
    COLOUR = "another colour"
    """The pixels are in the mark's range of hues, but differ in colour from marks of this kind in earlier frames."""
    UNLIKE = "unlike itself before"
    """A mark was detected, but neither the detection nor any position nearby looks like this mark in earlier frames."""
    AMBIGUOUS = "one of two that touch"
    """The mark was detected, but it touches another mark, and their names may be exchanged."""
    TAKEN = "taken for another mark"
    """The only detection of this hue near the expected position was assigned to another mark."""
    FAR = "too far from where it was expected"
    """All detections of this hue are beyond the gate around the expected position."""
    OUTSIDE = "outside the picture"
    """The expected position is outside the picture."""
    AWAY = "faces away from the camera"
    """For cameras in space: the mark is on a side of the body that a camera cannot see."""
    APART = "in different places for two cameras"
    """For cameras in space: two or more cameras detect the mark, but their rays do not meet."""
    FLOODED = "its hue is all over the picture"
    """The hue covers a larger part of the picture than marks can cover."""


@dataclass(frozen=True, slots=True, eq=False)
class Rejected:
    """Connected pixels of a hue that are not a mark.

    reason: why they are not a mark; detail: numbers on which this decision is based, as text
    center_px: centre of the pixels [px], (2,); area_px: number of pixels [px]; hue_deg: nominal hue [degrees]
    """

    reason: Reason
    detail: str
    center_px: Floats
    area_px: float
    hue_deg: float
