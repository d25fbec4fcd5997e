"""Search regions of a picture: around the expected position of each mark."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, floor, hypot

from vision.detection.expected import Expected
from vision.tracking.settings import REACH_SDS, FinderSettings

Box = tuple[int, int, int, int]


def search_regions(
    expected: Sequence[Expected], shape: tuple[int, ...], settings: FinderSettings
) -> list[tuple[Box, list[Expected]]]:
    """Regions of a picture in which marks are expected, and the marks of each region.

    A region is left, top, width, height [px]. All marks of a region have the same hue. Regions of one hue do not
    overlap.
    """
    pad_px = settings.detection.coverage.pad_px + 4
    height, width = shape[:2]
    apart: dict[float, list[tuple[Box, list[Expected]]]] = {one.hue_deg: [] for one in expected}
    for one in expected:
        (u, v), ((uu, _), (_, vv)) = one.center_px.tolist(), one.cov_px2.tolist()
        (a, b), (c, d) = ((0.0, 0.0), (0.0, 0.0)) if one.outline is None else one.outline.shape_px.tolist()
        across = REACH_SDS * uu**0.5 + 1.3 * hypot(a, b) + pad_px
        down = REACH_SDS * vv**0.5 + 1.3 * hypot(c, d) + pad_px
        u0, v0 = max(floor(u - across), 0), max(floor(v - down), 0)
        u1, v1 = min(ceil(u + across) + 1, width), min(ceil(v + down) + 1, height)
        if u1 <= u0 or v1 <= v0:
            continue
        marks, others = [one] if 0 <= u < width and 0 <= v < height else [], apart[one.hue_deg]
        k = 0
        while k < len(others):
            (x0, y0, x1, y1), more = others[k]
            k += 1
            if x0 < u1 and u0 < x1 and y0 < v1 and v0 < y1:
                u0, v0, u1, v1, marks = min(u0, x0), min(v0, y0), max(u1, x1), max(v1, y1), more + marks
                del others[k - 1]
                k = 0  # the merged part may overlap other parts
        others.append(((u0, v0, u1, v1), marks))
    boxes = [each for of_hue in apart.values() for each in of_hue]
    return [((u0, v0, u1 - u0, v1 - v0), marks) for (u0, v0, u1, v1), marks in boxes]
