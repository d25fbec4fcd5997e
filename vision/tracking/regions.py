"""Regions of a picture in which marks are searched: around where each is expected."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from math import ceil, floor, hypot

from vision.arrays import Floats
from vision.detection.expected import Expected
from vision.tracking.settings import REACH_SDS, FinderSettings

Box = tuple[int, int, int, int]


def inside(place_px: Floats, region: Box) -> bool:
    """Whether a place (2,) lies in a region: left, top, width, height [px]."""
    left, top, width, height = region
    return left <= place_px[0] < left + width and top <= place_px[1] < top + height


def search_regions(expected: Sequence[Expected], shape: tuple[int, ...], settings: FinderSettings) -> list[Box]:
    """Left, top, width, height [px] of the parts of a picture, (height, width), to search; none overlap."""
    boxes = []
    pad_px = settings.detection.coverage.pad_px + 4
    for one in expected:
        (u, v), ((uu, _), (_, vv)) = one.center_px.tolist(), one.cov_px2.tolist()
        (a, b), (c, d) = ((0.0, 0.0), (0.0, 0.0)) if one.outline is None else one.outline.shape_px.tolist()
        across = REACH_SDS * uu**0.5 + 1.3 * hypot(a, b) + pad_px
        down = REACH_SDS * vv**0.5 + 1.3 * hypot(c, d) + pad_px
        low = max(floor(u - across), 0), max(floor(v - down), 0)
        high = min(ceil(u + across) + 1, shape[1]), min(ceil(v + down) + 1, shape[0])
        if high[0] > low[0] and high[1] > low[1]:
            boxes.append((*low, *high))
    overlapping = any(_overlap(a, b) for a, b in combinations(boxes, 2))
    apart: list[Box] = [] if overlapping else boxes
    for box in boxes if overlapping else ():
        merged = box
        while (other := next((one for one in apart if _overlap(one, merged)), None)) is not None:
            apart.remove(other)
            merged = (*map(min, other[:2], merged[:2]), *map(max, other[2:], merged[2:]))
        apart.append(merged)
    return [(u0, v0, u1 - u0, v1 - v0) for u0, v0, u1, v1 in apart]


def _overlap(a: Box, b: Box) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]
