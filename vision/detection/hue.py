"""Hues on the colour circle, and the range of colours of a kind of mark."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

from vision.arrays import Floats

Hues = TypeVar("Hues", float, Floats)


def hue_distance(a_deg: Hues, b_deg: Hues) -> Hues:
    """Distance of two hues, or arrays of hues, on the circle [degrees], 0 to 180.

    >>> hue_distance(355.0, 5.0)
    10.0
    """
    return abs((a_deg - b_deg + 180.0) % 360.0 - 180.0)


def on_circle(hue_deg: float) -> float:
    """The hue from 0 up to 360 degrees; for a value just below 0 it is 0, because the remainder would round to 360.

    >>> on_circle(-1e-15)
    0.0
    """
    return hue_deg % 360.0 % 360.0


@dataclass(frozen=True, slots=True)
class MarkHue:
    """Range of colours of one kind of mark.

    hue_deg: the hue, 0 red, 120 green, 240 blue
    half_width_deg: largest difference of a pixel's hue from it [degrees]
    min_saturation, min_value: least saturation and value, 0 to 1, at which a pixel's hue is used
    seen_deg: the hue of such marks in the present light, if it differs from hue_deg
    saturation, value: their saturation and value, 0 to 1, if known
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
