"""The fast path for the usual case: a single whole, even mark where it is expected."""

from __future__ import annotations

from collections.abc import Sequence

from vision.arrays import Image
from vision.detection.centers import centers_agreed
from vision.detection.coverage import measure_isolated
from vision.detection.expected import Expected
from vision.detection.hue import MarkHue
from vision.detection.palette import palette_of
from vision.detection.records import Detection
from vision.detection.settings import DETECTION, DetectionSettings


def detect_isolated(
    frame_bgr: Image,
    hues: Sequence[MarkHue],
    region: tuple[int, int, int, int],
    expected: Expected,
    settings: DetectionSettings = DETECTION,
) -> Detection | None:
    """The expected mark in this region, if it is the only one of its hue there and nothing is unusual.

    region: left, top, width, height [px]. None otherwise: then `detect_marks` finds more.
    """
    outline = expected.outline
    if outline is None or not outline.even:
        return None
    palette = palette_of(tuple(hues))
    number = 1 + [hue.hue_deg for hue in hues].index(expected.hue_deg)
    left, top, width, height = region
    measured = measure_isolated(
        frame_bgr,
        (left, top, left + width, top + height),
        (number, (palette.table, palette.least_value, palette.least_saturation)),
        max(1, int(settings.centers.min_area * outline.area_px)),
        settings.coverage,
    )
    if measured is None:
        return None
    corner, seen = measured
    center = centers_agreed(seen, outline, settings)
    if center is None:
        return None
    return Detection(
        center.center_px + corner,
        center.cov_px2,
        seen.area_px,
        expected.hue_deg,
        False,
        False,
        seen.color_bgr,
        center.size,
    )
