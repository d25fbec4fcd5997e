"""Marks seen in a picture, and what was seen and is not a mark.

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
    """One detected mark.

    center_px: its centre [px], shape (2,)
    cov_px2: covariance of that [px²], shape (2, 2), from the noise around the mark and its area
    area_px: its visible area [px]
    hue_deg: the hue of its class
    clipped: whether it touches the border of the searched part, so that some of it was not seen
    occluded: whether something hides part of it, so that its centre is that of its outline
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
    """Less of its hue than a mark must show: covered, in shadow, or of another hue than stated."""
    SMALL = "too small in the picture"
    """Too few pixels of its hue, and it is expected so small that none need show its hue alone."""
    SIZE = "wrong size"
    """A whole mark of another diameter, or more of its hue than a mark has."""
    SHAPE = "wrong shape"
    """Too long, or no edge of it lies on the outline of a mark."""
    CONTRAST = "no contrast"
    """It cannot be distinguished from the background."""
    STAIN = "uneven as a stain"
    """Noisier than a mark of one colour."""
    COLOUR = "another colour"
    """In its range of hues, but not of the colour that such marks have had until now."""
    UNLIKE = "unlike itself before"
    """Seen, but neither it nor any position nearby looks like the mark before."""
    AMBIGUOUS = "one of two that touch"
    """Seen, but its name could equally be that of another mark that it touches."""
    TAKEN = "taken for another mark"
    """The only mark of its hue where it is expected belongs to another name."""
    FAR = "too far from where it was expected"
    """Marks of its hue are seen, all further away than the gate allows."""
    OUTSIDE = "outside the picture"
    """It is expected outside the picture."""
    AWAY = "faces away from the camera"
    """In space: its side of the body cannot be seen by a camera."""
    APART = "in different places for two cameras"
    """In space: seen by two or more cameras, but their rays do not meet."""
    FLOODED = "its hue is all over the picture"
    """A hue takes more of the picture than marks can."""


@dataclass(frozen=True, slots=True, eq=False)
class Rejected:
    """Connected pixels of a hue that are not a mark.

    reason: why not; detail: the numbers that decided
    center_px: their middle [px], (2,); area_px: their number [px]; hue_deg: of their class
    """

    reason: Reason
    detail: str
    center_px: Floats
    area_px: float
    hue_deg: float
