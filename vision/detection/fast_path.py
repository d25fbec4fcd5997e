"""Fast detection of single, completely visible marks of one colour near their expected positions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vision.arrays import Image
from vision.detection import kernels
from vision.detection.centers import trust
from vision.detection.coverage import FIT_PIXELS
from vision.detection.expected import Expected
from vision.detection.hue import MarkHue
from vision.detection.palette import palette_of
from vision.detection.records import Detection
from vision.detection.settings import DETECTION, DetectionSettings


def detect_isolated(
    frame_bgr: Image,
    hues: Sequence[MarkHue],
    regions: Sequence[tuple[int, int, int, int]],
    expected: Sequence[Expected],
    settings: DetectionSettings = DETECTION,
) -> list[Detection | None]:
    """Detect the only mark in each region. The mark must be completely visible and have the expected hue.

    If a region does not certainly have exactly one such mark, the result for this region is None. The slower
    `detect_marks` may still find marks in the region.
    regions: left, top, width, height [px]; expected: the mark of each region
    """
    looked_for = [(k, one, one.outline) for k, one in enumerate(expected) if one.outline and one.outline.even]
    found: list[Detection | None] = [None] * len(expected)
    if not looked_for:
        return found
    palette, numbers = palette_of(tuple(hues)), {hue.hue_deg: number for number, hue in enumerate(hues, start=1)}
    boxes = np.array([regions[k] for k, _, _ in looked_for])
    boxes[:, 2:] += boxes[:, :2]
    shapes = np.array([outline.shape_px for _, _, outline in looked_for])
    sizes = np.array([(outline.size_sd, outline.area_px) for _, _, outline in looked_for])
    fewest = np.maximum(settings.centers.min_area * sizes[:, 1], 1.0).astype(np.int64)
    valid, marks = kernels.isolated(
        frame_bgr,
        boxes,
        np.column_stack([[numbers[one.hue_deg] for _, one, _ in looked_for], fewest]),
        (shapes, sizes),
        (palette.table, palette.least_value, palette.least_saturation),
        (settings.coverage.pad_px, settings.coverage.for_kernel(), FIT_PIXELS // 2),
        settings.outline.for_kernel(),
        settings.centers.for_kernel(),
    )
    noise_sds = marks[:, 7]
    covs = (trust(noise_sds, settings.centers)[:, None] * marks[:, [2, 3, 3, 4]]).reshape(-1, 2, 2)
    rows = marks[:, 5:].tolist()
    for i in np.flatnonzero(valid & (noise_sds <= settings.components.max_noise)).tolist():
        (k, one, _), (size, area, _, *color) = looked_for[i], rows[i]
        found[k] = Detection(marks[i, :2], covs[i], area, one.hue_deg, False, False, tuple(color), size)
    return found
