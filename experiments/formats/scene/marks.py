"""Marks of a scene file, `[[mark]]`."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

from experiments.arrays import Floats
from experiments.formats.toml_file import in_millimetres
from vision import MarkHue, PlaneCamera

HUE_KEYS = ("hue_deg", "half_width_deg", "min_saturation", "min_value")
"""Fields that `Mark` and `MarkHue` have in common."""


@dataclass(frozen=True, slots=True)
class Mark:
    """A coloured mark on a node.

    measured: whether filters use the mark; if not, it only serves to score estimates
    hue_deg, half_width_deg, min_saturation, min_value: its colour range, as in `MarkHue`
    even: whether its colour is uniform, unlike that of a shaded ball
    ball: True for a ball, whose image is a circle; False for a disc, whose image is an ellipse
    """

    node: str
    hue_deg: float
    diameter_m: float
    measured: bool = True
    half_width_deg: float = 18.0
    min_saturation: float = 0.4
    min_value: float = 0.2
    even: bool = True
    ball: bool = False

    @property
    def hue(self) -> MarkHue:
        """The colour range of this mark."""
        return MarkHue(**{key: getattr(self, key) for key in HUE_KEYS})

    def shape_px(self, camera: PlaneCamera, place_m: Floats) -> Floats:
        """Shape of the mark's image [px], (2, 2), see `Outline.shape_px`. The mark lies at `place_m` [m], (2,)."""
        seen = camera.ball_shape if self.ball else camera.disc_shape
        return seen(place_m, self.diameter_m / 2.0)

    def coloured(self, hue: MarkHue) -> Mark:
        """A copy of the mark in another colour."""
        return replace(self, **{key: getattr(hue, key) for key in HUE_KEYS})


def mark_keys(mark: Mark) -> dict[str, Any]:
    """The keys of a mark's table. Keys with the value None are not written."""
    return in_millimetres(asdict(mark)) | {"ball": mark.ball or None}
