"""Expected position of a mark: the input of a detector."""

from __future__ import annotations

from dataclasses import dataclass

from vision.arrays import Floats
from vision.detection.outline import Outline


@dataclass(frozen=True, slots=True, eq=False)
class Expected:
    """Expected position of a mark, with its covariance and shape.

    name: name of the node that bears the mark
    center_px: expected centre [px], shape (2,)
    cov_px2: covariance of the expected centre, without the error of a detection [px²], shape (2, 2)
    hue_deg: nominal hue of the kind of mark [degrees]
    outline: shape and size of the mark; None: not known
    """

    name: str
    center_px: Floats
    cov_px2: Floats
    hue_deg: float
    outline: Outline | None = None
