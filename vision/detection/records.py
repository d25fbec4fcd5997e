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

    center_px: its centre [px], shape (2,)
    cov_px2: covariance of the centre [px²], shape (2, 2), which follows from the mark's area and the noise around it
    area_px: its visible area [px]
    hue_deg: the hue of its colour class
    clipped: whether it touches the border of the searched part, so that some of it was not visible
    occluded: whether something hides part of it, so that its outline gives its centre
    color_bgr: colour of its core [grey levels]
    size: its size relative to the given outline
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
    """Fewer pixels of the hue than a mark must show: it is covered, in shadow, or of another hue than stated."""
    SMALL = "too small in the picture"
    """Too few pixels of the hue, and the mark is expected so small that perhaps no pixel shows only its hue."""
    SIZE = "wrong size"
    """A whole mark of another diameter, or more pixels of its hue than a mark has."""
    SHAPE = "wrong shape"
    """Too elongated, or without an edge on the outline of a mark."""
    CONTRAST = "no contrast"
    """The pixels cannot be distinguished from the background."""
    STAIN = "uneven as a stain"
    """The pixels vary more than those of a mark of one colour."""
    COLOUR = "another colour"
    """In the mark's range of hues, but with another colour than such marks had so far."""
    UNLIKE = "unlike itself before"
    """Detected, but neither it nor any position nearby looks like the mark in earlier frames."""
    AMBIGUOUS = "one of two that touch"
    """Detected, but it touches another mark and could have that mark's name."""
    TAKEN = "taken for another mark"
    """The only mark of its hue near the expected position has another name."""
    FAR = "too far from where it was expected"
    """All detected marks of its hue are farther from the expected position than the gate allows."""
    OUTSIDE = "outside the picture"
    """Its expected position is outside the picture."""
    AWAY = "faces away from the camera"
    """In space: the mark is on a side of the body that a camera cannot see."""
    APART = "in different places for two cameras"
    """In space: two or more cameras detect the mark, but their rays do not meet."""
    FLOODED = "its hue is all over the picture"
    """Its hue covers more of the picture than marks can."""


@dataclass(frozen=True, slots=True, eq=False)
class Rejected:
    """Connected pixels of a hue that are not a mark.

    reason: why it is not a mark; detail: the numbers of the decision
    center_px: centre of the pixels [px], (2,); area_px: number of pixels [px]; hue_deg: hue of their class
    """

    reason: Reason
    detail: str
    center_px: Floats
    area_px: float
    hue_deg: float
