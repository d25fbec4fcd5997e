"""Hues on the colour circle, and the range of colours of a kind of mark."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

from vision.arrays import Floats

Hues = TypeVar("Hues", float, Floats)


def hue_distance(a_deg: Hues, b_deg: Hues) -> Hues:
    """Distance between two hues, or arrays of hues, on the colour circle [degrees], 0 to 180.

    >>> hue_distance(355.0, 5.0)
    10.0
    """
    return abs((a_deg - b_deg + 180.0) % 360.0 - 180.0)


def on_circle(hue_deg: float) -> float:
    """The hue in the range from 0 to less than 360 degrees. A result that rounds to 360 is replaced by 0.

    >>> on_circle(-1e-15)
    0.0
    """
    return hue_deg % 360.0 % 360.0


@dataclass(frozen=True, slots=True)
class MarkHue:
    """Range of colours of one kind of mark.

    hue_deg: nominal hue of the marks [degrees]: 0 red, 120 green, 240 blue
    half_width_deg: largest difference between a pixel's hue and the middle of the range [degrees]
    min_saturation, min_value: least saturation and least value of a pixel, 0 to 1
    seen_deg: middle of the range after adaptation to the light [degrees]; None: hue_deg
    saturation, value: mean saturation and mean value of the marks, 0 to 1; None: not known
    """

    hue_deg: float
    half_width_deg: float = 18.0
    min_saturation: float = 0.4
    min_value: float = 0.2
    seen_deg: float | None = None
    saturation: float | None = None
    value: float | None = None

    @property
    def middle_deg(self) -> float:
        """Middle of the range of hues [degrees]."""
        return self.hue_deg if self.seen_deg is None else self.seen_deg

    def __post_init__(self) -> None:
        if not 0 <= self.hue_deg < 360:
            raise ValueError(f"mark hue hue_deg: expected 0 up to 360, found {self.hue_deg}")
        if not 2 <= self.half_width_deg <= 90:
            raise ValueError(f"mark hue half_width_deg: expected 2 to 90, found {self.half_width_deg}")
        for key in ("min_saturation", "min_value"):
            if not 0 < getattr(self, key) < 1:
                raise ValueError(f"mark hue {key}: expected between 0 and 1, found {getattr(self, key)}")
