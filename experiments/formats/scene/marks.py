"""Marks of a scene file: read from `[[mark]]`, and written to it."""

from __future__ import annotations

from dataclasses import dataclass, replace

from experiments.arrays import Floats
from experiments.formats.scene.schema import MarkTable
from experiments.formats.toml_file import key_lines
from vision import MarkHue, PlaneCamera


@dataclass(frozen=True, slots=True)
class Mark:
    """A coloured spot on a node: its hue [degrees], its diameter [m]; measured: False if it only scores estimates.

    half_width_deg, min_saturation, min_value: its colour range, as in `MarkHue`
    even: whether its colour is uniform, unlike that of a shaded ball
    ball: whether it is a ball, whose image is a circle; else a disc on the plane, whose image is an ellipse
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
        return MarkHue(self.hue_deg, self.half_width_deg, self.min_saturation, self.min_value)

    def shape_px(self, camera: PlaneCamera, place_m: Floats) -> Floats:
        """Image of the mark at a position on the plane [m], (2,), as in `Outline.shape_px`, (2, 2) [px]."""
        seen = camera.ball_shape if self.ball else camera.disc_shape
        return seen(place_m, self.diameter_m / 2.0)

    def coloured(self, hue: MarkHue) -> Mark:
        """A copy of the mark in another colour."""
        return replace(
            self,
            hue_deg=hue.hue_deg,
            half_width_deg=hue.half_width_deg,
            min_saturation=hue.min_saturation,
            min_value=hue.min_value,
        )


def mark_of(table: MarkTable) -> Mark:
    """The mark of a table, in metres."""
    keys = table.model_dump()
    return Mark(diameter_m=1e-3 * keys.pop("diameter_mm"), **keys)


def mark_lines(mark: Mark) -> list[str]:
    """`[[mark]]` of a scene file, line by line."""
    look = look_keys(mark)
    head = {"node": mark.node, "hue_deg": look["hue_deg"], "diameter_mm": look["diameter_mm"]}
    return ["", "[[mark]]", *key_lines({**head, "measured": mark.measured, **look})]


def look_keys(mark: Mark) -> dict[str, float | bool | None]:
    """Keys for a mark's look in a film, hue and diameter first."""
    return {
        "hue_deg": mark.hue_deg,
        "diameter_mm": 1e3 * mark.diameter_m,
        "half_width_deg": mark.half_width_deg,
        "min_saturation": mark.min_saturation,
        "min_value": mark.min_value,
        "even": mark.even,
        "ball": mark.ball or None,
    }
