"""Occluders and clutter in synthetic frames: needles and hands that cover marks, and blood on the surface.

Image axes: u right, v down [px]. A colour is the share of light that the object reflects, linear, in BGR order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from vision.arrays import Picture
from vision.synthetic.layers import Layer
from vision.synthetic.sensor import light_of

Size = tuple[int, int]

ROWS_PER_BAND = 32
"""Number of rows in each band of a needle. Boxes around all bands have fewer pixels than one box around the needle."""


@dataclass(frozen=True, slots=True)
class OccludingNeedle:
    """A straight metal needle in front of marks.

    tip_px, tail_px: ends of the needle [px]
    width_px: width of the needle [px]
    gloss: brightness of the lamp's reflection along the needle, 0 to 1
    """

    tip_px: tuple[float, float]
    tail_px: tuple[float, float]
    width_px: float
    gloss: float = 0.8


@dataclass(frozen=True, slots=True)
class OccludingHand:
    """A hand, out of focus, that covers marks with its fingers.

    tip_px: end of the longest finger [px]
    towards_deg: direction in which the fingers point, 0 right, 90 down [degrees]
    finger_px: half the width of a finger [px]
    n_fingers: number of fingers, 1 to 4
    skin_srgb: colour of the skin in sRGB: red, green, blue, 0 to 1
    softness_px: standard deviation of the blur of the hand's outline [px]
    """

    tip_px: tuple[float, float]
    towards_deg: float
    finger_px: float
    n_fingers: int = 2
    skin_srgb: tuple[float, float, float] = (0.80, 0.58, 0.47)
    softness_px: float = 2.0


def needle_layers(needle: OccludingNeedle, size_px: Size) -> list[Layer]:
    """Layers of a needle, one for each band of rows. At the needle's edges, coverage of pixels is accurate to 1e-2."""
    tip, tail = np.array(needle.tip_px), np.array(needle.tail_px)
    length = float(np.hypot(*(tail - tip)))
    along = (tail - tip) / length
    half = needle.width_px / 2.0
    reach = half + 1.0
    layers = []
    top = max(0, int(np.floor(min(tip[1], tail[1]) - reach)))
    bottom = min(size_px[1], int(np.ceil(max(tip[1], tail[1]) + reach)) + 1)
    for row in range(top, bottom, ROWS_PER_BAND):
        end = min(row + ROWS_PER_BAND, bottom)
        # The box is as wide as the part of the needle's axis in this band, with the needle's width on both sides.
        if abs(along[1]) > 1e-3:
            crossings = tip[0] + (np.array([row - reach, end + reach]) - tip[1]) * along[0] / along[1]
            ends = np.clip(crossings, min(tip[0], tail[0]), max(tip[0], tail[0]))
        else:
            ends = np.array([tip[0], tail[0]])
        left = max(0, int(np.floor(ends.min() - 2.0 * reach)))
        right = min(size_px[0], int(np.ceil(ends.max() + 2.0 * reach)) + 1)
        if right <= left:
            continue
        u, v = np.arange(left, right) - tip[0], np.arange(row, end)[:, None] - tip[1]
        far, across = u * along[0] + v * along[1], u * along[1] - v * along[0]
        # The tip is ground to a slant over three widths.
        width_there = half * np.clip(far / (6.0 * half), 0.0, 1.0)
        alpha = np.clip(width_there - np.abs(across) + 0.5, 0.0, 1.0) * np.clip(length - far + 0.5, 0.0, 1.0)
        alpha *= np.clip(2.0 * width_there, 0.0, 1.0)
        round_shade = 0.10 + 0.30 * np.sqrt(np.clip(1.0 - (across / (half + 0.5)) ** 2, 0.0, 1.0))
        streak = needle.gloss * np.exp(-(((across - 0.35 * half) / (0.25 * half + 0.3)) ** 2))
        glint = 0.75 + 0.25 * np.sin(far / 37.0)
        grey = (round_shade + streak * glint).astype(np.float32)
        layers.append(Layer(left, row, alpha, np.stack([1.02 * grey, grey, 0.98 * grey], axis=-1)))
    return layers


def hand_layer(hand: OccludingHand, size_px: Size) -> Layer:
    """Layer of a hand that enters from outside the picture."""
    scale = 2  # half the picture's resolution suffices for a soft outline
    width, height = (size_px[0] + 1) // scale, (size_px[1] + 1) // scale
    angle = np.deg2rad(hand.towards_deg)
    ahead, side = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    finger, tip = hand.finger_px / scale, np.array(hand.tip_px) / scale
    middle = side * 1.05 * finger * (hand.n_fingers - 1) / 2.0
    palm = tip - ahead * 10.5 * finger + middle
    parts = [(palm, palm - ahead * 60.0 * finger, 2.9 * finger)]
    for k in range(hand.n_fingers):
        end = tip - ahead * finger * (0.0, 0.9, 0.7, 2.9)[k] + side * (0.0, 2.05, -2.0, 4.0)[k] * finger
        parts.append((end - ahead * finger, palm + 0.75 * (end - tip - middle) + ahead * finger, finger))
    alpha: Picture = np.zeros((height, width), dtype=np.float32)
    depth: Picture = np.zeros_like(alpha)
    for a, b, half in parts:
        distances = _distances_to_segment((width, height), a, b)
        alpha = np.maximum(alpha, np.clip(0.5 + half - distances, 0.0, 1.0))
        # Fingers and palm are round: they are darker towards their sides.
        depth = np.maximum(depth, np.sqrt(np.clip(1.0 - (distances / half) ** 2, 0.0, 1.0)))
    if hand.softness_px:
        alpha, depth = (cv2.GaussianBlur(part, (0, 0), hand.softness_px / scale) for part in (alpha, depth))
    skin = light_of(hand.skin_srgb)[::-1]
    shade = (0.25 + 0.75 * depth)[:, :, None]
    red_in_shade = np.array([1.2, 1.1, 0.8])  # light through skin is red
    colors = (skin * shade**red_in_shade).astype(np.float32)
    doubled = (scale * width, scale * height)
    full = [cv2.resize(part, doubled, interpolation=cv2.INTER_LINEAR) for part in (alpha, colors)]
    rows, columns = (np.flatnonzero(full[0].any(axis=axis)) for axis in (1, 0))
    if rows.size == 0:
        return Layer(0, 0, np.zeros((1, 1), dtype=np.float32), np.zeros(3, dtype=np.float32))
    box = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    return Layer(int(columns[0]), int(rows[0]), full[0][box], full[1][box])


def blood_layer(
    size_px: Size, mark_radius_px: float, rng: np.random.Generator, *, n_smears: int, n_streaks: int, n_drops: int
) -> Layer:
    """Layer of blood on the surface: irregular smears, thin streaks, and drops smaller than a mark."""
    width, height = size_px
    alpha = np.zeros((height, width), dtype=np.float32)
    for _ in range(n_smears):
        alpha = np.maximum(alpha, _smear(size_px, rng.uniform(1.5, 5.0) * mark_radius_px, rng))
    fine = np.zeros((2 * height, 2 * width), dtype=np.uint8)
    for _ in range(n_streaks):
        n = int(rng.integers(4, 9))
        heading = rng.uniform(0.0, 2.0 * np.pi) + np.cumsum(rng.normal(0.0, 0.35, n))
        steps = rng.uniform(0.6, 2.0, n)[:, None] * mark_radius_px * np.column_stack([np.cos(heading), np.sin(heading)])
        way = 2.0 * (rng.uniform((0, 0), (width, height)) + np.cumsum(steps, axis=0))
        thickness = int(rng.integers(2, max(3, int(0.5 * mark_radius_px)) + 1))
        cv2.polylines(fine, [np.rint(16 * way).astype(np.int32)], False, 255, thickness, cv2.LINE_AA, 4)
    for _ in range(n_drops):
        place, radius = 2.0 * rng.uniform((0, 0), (width, height)), rng.uniform(0.15, 0.6) * mark_radius_px
        tall, turn = rng.uniform(0.7, 1.0), float(rng.uniform(0.0, 180.0))
        axes = (int(32 * radius), int(32 * radius * tall))
        cv2.ellipse(fine, _fine(place), axes, turn, 0, 360, 255, -1, cv2.LINE_AA, 4)
    alpha = np.maximum(alpha, 0.92 * cv2.resize(fine, size_px, interpolation=cv2.INTER_AREA) / np.float32(255.0))
    dark, bright = light_of((0.30, 0.03, 0.04))[::-1], light_of((0.66, 0.08, 0.09))[::-1]
    share = np.clip(0.5 + 0.3 * _clouds(size_px, 0.9 * mark_radius_px, rng), 0.0, 1.0)[:, :, None]
    return Layer(0, 0, alpha.astype(np.float32), (dark + share * (bright - dark)).astype(np.float32))


def plain_surface(size_px: Size, srgb: Sequence[float], rng: np.random.Generator, *, texture: float = 0.0) -> Picture:
    """Linear BGR light from a plane of one colour, (height, width, 3); texture: relative variation of the light."""
    surface = np.ones((size_px[1], size_px[0], 3)) * light_of(srgb)[::-1]
    if texture:
        uneven = 0.7 * _clouds(size_px, 40.0, rng) + 0.5 * _clouds(size_px, 5.0, rng) + 0.5 * _clouds(size_px, 1.0, rng)
        surface *= np.clip(1.0 + texture * uneven, 0.0, None)[:, :, None]
    return surface.astype(np.float32)


def _smear(size_px: Size, radius_px: float, rng: np.random.Generator) -> Picture:
    """The coverage of one smear, which is elongated and has a rough edge, (height, width)."""
    center, turn, tall = rng.uniform((0, 0), size_px), rng.uniform(0.0, np.pi), rng.uniform(0.25, 0.8)
    u, v = np.arange(size_px[0]) - center[0], (np.arange(size_px[1]) - center[1])[:, None]
    along, across = np.cos(turn) * u + np.sin(turn) * v, np.cos(turn) * v - np.sin(turn) * u
    distances = np.hypot(along / radius_px, across / (tall * radius_px))
    rough = 0.30 * _clouds(size_px, 0.35 * radius_px, rng) + 0.10 * _clouds(size_px, 2.0, rng)
    thick = np.clip((1.0 - distances + rough) / 0.35, 0.0, 1.0)
    return np.asarray(0.95 * thick, dtype=np.float32)


def _clouds(size_px: Size, grain_px: float, rng: np.random.Generator) -> Picture:
    """Random numbers with mean 0 and standard deviation 1, smoothed over grain_px [px], (height, width)."""
    width, height = size_px
    step = max(1.0, grain_px / 2.0)
    coarse = (max(8, int(np.ceil(width / step))), max(8, int(np.ceil(height / step))))
    noise = cv2.GaussianBlur(rng.standard_normal((coarse[1], coarse[0]), dtype=np.float32), (0, 0), grain_px / step)
    clouds: Picture = cv2.resize(noise / noise.std(), size_px, interpolation=cv2.INTER_CUBIC)
    return clouds


def _distances_to_segment(size_px: Size, a: Picture, b: Picture) -> Picture:
    """Distance between each pixel and the line segment from a to b [px], (height, width)."""
    u, v = np.arange(size_px[0], dtype=np.float32) - a[0], (np.arange(size_px[1], dtype=np.float32) - a[1])[:, None]
    d = b - a
    along = np.clip((u * d[0] + v * d[1]) / (d @ d), 0.0, 1.0)
    return np.asarray(np.sqrt((u - along * d[0]) ** 2 + (v - along * d[1]) ** 2), dtype=np.float32)


def _fine(point: Picture) -> tuple[int, int]:
    """Convert a point [px] to sixteenths of a pixel, for OpenCV's drawing functions."""
    return int(np.rint(16 * point[0])), int(np.rint(16 * point[1]))
