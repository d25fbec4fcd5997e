"""Lines, ellipses and text that are legible on any picture: light with a dark edge.

Image axes: u right, v down, the centre of the first pixel is (0, 0). Colours are BGR.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import cv2
import numpy as np

from experiments.arrays import Floats
from vision.arrays import Image, Picture

Colour = tuple[int, int, int]

DARK: Colour = (0, 0, 0)
SHIFT = 4
"""Number of bits of a position's fraction: positions are drawn to a sixteenth of a pixel."""
MARGIN_PX = 8.0
"""Lines are clipped this far outside the picture [px], so that their cut ends are invisible."""
NEAR_PX = 1e4
"""Largest coordinate [px] of lines that need no clipping; OpenCV draws with integers, which have room for it."""
TEXT_PX = 16.0
"""Height of a line of text in a picture of 480 px [px]."""
FONT = cv2.FONT_HERSHEY_SIMPLEX
FONT_PX = 30.0
"""Height of a line of OpenCV's font at scale 1 [px]."""


def draw_segments(image: Image, segments: Floats, colour: Colour, width: int, *, edge: int = 1) -> None:
    """Draw the visible parts of line segments [px], (n, 2, 2); edge: width of their dark edge [px]."""
    inside = segments if _is_near(segments) else clipped(segments, image.shape[1::-1])
    if len(inside):
        _draw(image, list(_fixed(inside)), colour, width, edge)


def draw_line(image: Image, points_px: Floats, colour: Colour, width: int, *, edge: int = 1) -> None:
    """Draw a line through points, (n, 2) [px]; edge: width of its dark edge [px]."""
    if _is_near(points_px):
        _draw(image, [_fixed(points_px)], colour, width, edge)
    else:
        draw_segments(image, np.stack([points_px[:-1], points_px[1:]], axis=1), colour, width, edge=edge)


def _is_near(places: Floats) -> bool:
    """Whether all positions are finite and within NEAR_PX."""
    return places.size > 0 and bool(np.abs(places).max() < NEAR_PX)


def _fixed(places: Floats) -> Picture:
    """Positions as OpenCV's integers, in sixteenths of a pixel."""
    return np.round(places * 2**SHIFT).astype(np.int32)


def _draw(image: Image, lines: Sequence[Picture], colour: Colour, width: int, edge: int) -> None:
    if edge:
        cv2.polylines(image, lines, False, DARK, width + 2 * edge, cv2.LINE_AA, SHIFT)
    cv2.polylines(image, lines, False, colour, width, cv2.LINE_AA, SHIFT)


def draw_dashes(image: Image, points_px: Floats, dash_px: float, colour: Colour, width: int) -> None:
    """Draw a dashed line through points, (n, 2) [px], with dark gaps, so that it is visible on any background."""
    draw_line(image, points_px, DARK, width, edge=0)
    draw_segments(image, dashed(points_px, dash_px), colour, width, edge=0)


def clipped(segments: Floats, size_px: Sequence[int]) -> Floats:
    """The parts of segments, (n, 2, 2), inside the picture with a margin. Segments that are not finite are omitted."""
    finite = segments[np.isfinite(segments).all(axis=(1, 2))]
    start, along = finite[:, 0], finite[:, 1] - finite[:, 0]
    edges = np.array([[[-MARGIN_PX] * 2], [np.array(size_px) - 1.0 + MARGIN_PX]])
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.sort((edges - start) / along, axis=0)  # where each line crosses both edges of each axis
    low, high = t[0].max(axis=1).clip(min=0.0), t[1].min(axis=1).clip(max=1.0)
    seen = low <= high
    ends = [start[seen] + t[seen, None] * along[seen] for t in (low, high)]
    return np.stack(ends, axis=1)


def ellipse_points(center_px: Floats, shape_px: Floats) -> Floats:
    """Points, (n, 2), on the closed ellipse `center_px + shape_px @ unit_circle`; a line through them looks smooth."""
    reach = float(np.abs(shape_px).max())
    n = int(np.clip(8.0 * np.sqrt(reach), 24, 1440)) if np.isfinite(reach) else 24
    return np.asarray(center_px + _circle(n) @ shape_px.T, dtype=np.float64)


@lru_cache(maxsize=256)
def _circle(n: int) -> Floats:
    """Points around the unit circle, closed, (n + 1, 2)."""
    angles = np.linspace(0.0, 2.0 * np.pi, n + 1)
    return np.column_stack([np.cos(angles), np.sin(angles)])


def dashed(points_px: Floats, dash_px: float) -> Floats:
    """The dashes of a dashed line through points, (n, 2), as line segments, (k, 2, 2)."""
    lengths = np.linalg.norm(np.diff(points_px, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    if not np.isfinite(along[-1]) or along[-1] == 0.0:
        return np.zeros((0, 2, 2))
    # a line far outside the picture gets longer dashes, which limits their number
    starts = np.arange(0.0, along[-1], max(2.0 * dash_px, along[-1] / 500.0))
    half = 0.5 * (starts[1] - starts[0]) if len(starts) > 1 else dash_px
    ends = np.minimum(starts + half, along[-1])
    place = [np.stack([np.interp(t, along, points_px[:, a]) for a in (0, 1)], axis=1) for t in (starts, ends)]
    return np.stack(place, axis=1)


def draw_text(image: Image, text: str, at_px: tuple[float, float], colour: Colour, scale: float) -> int:
    """Draw text with dark edges; at_px: upper left corner, moved if text leaves the picture; returns the width [px]."""
    ink, edge = _letters(text, round(scale * TEXT_PX / FONT_PX, 3))
    part = _room(image, at_px, ink)
    ink, edge = ink[: part.shape[0], : part.shape[1]], edge[: part.shape[0], : part.shape[1]]
    _mix(part, part * (1.0 - edge) + ink * np.array(colour, dtype=np.float32))
    return int(ink.shape[1])


def draw_word(image: Image, text: str, at_px: tuple[float, float], colour: Colour, scale: float) -> int:
    """Draw a dark word on a plate of this colour; at_px: as in `draw_text`; returns the word's width [px]."""
    ink, _ = _letters(text, round(scale * TEXT_PX / FONT_PX, 3))
    part = _room(image, at_px, ink)
    part[:] = colour
    _mix(part, part * (1.0 - ink[: part.shape[0], : part.shape[1]]))
    return int(ink.shape[1])


def _room(image: Image, at_px: tuple[float, float], ink: Picture) -> Image:
    """The part of a picture for letters at this position; it is shifted if it would cross the picture's edge."""
    (height, width), (rows, columns) = ink.shape[:2], image.shape[:2]
    left = int(np.clip(round(at_px[0]), 0, max(columns - width, 0)))
    top = int(np.clip(round(at_px[1]), 0, max(rows - height, 0)))
    return image[top : top + height, left : left + width]


def _mix(part: Image, mixed: Picture) -> None:
    part[:] = np.clip(mixed, 0.0, 255.0).astype(np.uint8)


def darken(image: Image, top: float, bottom: float) -> None:
    """Halve the brightness of a strip of the picture, between two rows, as background of text."""
    strip = image[max(round(top), 0) : max(round(bottom), 0)]
    strip >>= 1


def text_height(scale: float) -> int:
    """Height of a line of text [px]."""
    return round(1.25 * scale * TEXT_PX)


def text_width(text: str, scale: float) -> int:
    """Width of a line of text [px]."""
    return int(_letters(text, round(scale * TEXT_PX / FONT_PX, 3))[0].shape[1])


@lru_cache(maxsize=512)
def _letters(text: str, font_scale: float) -> tuple[Picture, Picture]:
    """Opacity [1] of each pixel of letters without and with their dark edge, (height, width, 1) float32 each."""
    (width, height), below = cv2.getTextSize(text, FONT, font_scale, 1)
    pad = 2
    canvas = np.zeros((height + below + 2 * pad, width + 2 * pad), dtype=np.uint8)
    cv2.putText(canvas, text, (pad, pad + height), FONT, font_scale, 255, 1, cv2.LINE_AA)
    edge = cv2.dilate(canvas, np.ones((3, 3), np.uint8))
    return (canvas / np.float32(255.0))[:, :, None], (edge / np.float32(255.0))[:, :, None]
