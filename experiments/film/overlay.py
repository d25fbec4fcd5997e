"""One annotated frame: marks, network, target, needle, status and reasons, in pixels.

This module does not use scenes or filters: `views` makes the `Overlay`. All ellipses contain 95 % probability.
"""

from __future__ import annotations

import colorsys
from dataclasses import dataclass
from enum import StrEnum

import cv2
import numpy as np
from numpy.typing import NDArray

from experiments.arrays import Floats
from experiments.film.strokes import (
    DARK,
    Colour,
    darken,
    draw_dashes,
    draw_line,
    draw_segments,
    draw_text,
    draw_word,
    ellipse_points,
    text_height,
    text_width,
)
from vision.arrays import Image

WITHIN_95 = 2.447746830680816
"""Semi-axes of a 95 % ellipse in standard deviations: `sqrt(chi2.ppf(0.95, 2))`."""
LIGHT: Colour = (255, 255, 255)
SPRING: Colour = (215, 215, 215)
TARGET: Colour = (66, 228, 240)
FAINT = 0.4
"""Opacity of an ellipse of an unreliable estimate."""
CROSS = np.array([[[-1.0, -1.0], [1.0, 1.0]], [[-1.0, 1.0], [1.0, -1.0]]])
"""The two strokes of a diagonal cross from -1 to 1, (2, 2, 2)."""
MOST_LINES = 6
"""Largest number of lines with reasons: more would hide the picture."""


class Fate(StrEnum):
    """Result for a mark in a frame: found and used, found but rejected by the filter, or not found."""

    FOUND = "found"
    REFUSED = "refused"
    LOST = "lost"


@dataclass(frozen=True, slots=True, eq=False)
class MarkDrawn:
    """A mark as drawn: name, hue [degrees] and `fate`, which is the mark's result in the frame.

    center_px, cov_px2: position, (2,), and covariance, (2, 2), of the detection; None for a lost mark
    expected_px, expected_cov_px2: position, (2,), and covariance, (2, 2), of the prediction; None if it is not known
    shape_px: matrix that maps the unit disc to the mark's image about its center, (2, 2)
    candidate_px: a detection that was rejected, (2,); why: the reason for `fate` in words
    measured: whether the filter uses the mark
    """

    name: str
    hue_deg: float
    fate: Fate
    shape_px: Floats
    center_px: Floats | None = None
    cov_px2: Floats | None = None
    expected_px: Floats | None = None
    expected_cov_px2: Floats | None = None
    candidate_px: Floats | None = None
    why: str = ""
    measured: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class NeedleDrawn:
    """A needle.

    shaft_px: ends of the drawn shaft, (2, 2); ahead_px: ends of the line ahead of the tip, (2, 2)
    aim_px, aim_cov_px2: target's predicted position, (2,), and covariance, (2, 2), when the needle arrives, or None
    """

    shaft_px: Floats
    ahead_px: Floats
    aim_px: Floats | None = None
    aim_cov_px2: Floats | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Overlay:
    """Annotation of one frame.

    status, status_colour: the estimate's status, and its colour; facts: text beside the status, such as the time
    nodes_px: positions of the nodes, (n, 2), NaN outside the view; names: names of the nodes, "" for those not labelled
    fixed: whether each node is fixed, (n,); springs: pairs of nodes, (m, 2)
    target_px: the target's estimate, (2,), NaN outside the view; target_cov_px2: its covariance, (2, 2), or None
    target_shape_px: matrix that maps the unit disc to the target's image about its center, (2, 2)
    trusted: whether the target's ellipse is reliable; otherwise it is faint
    advice, advice_colour: text of the advice, and its colour; without a needle the text is empty
    """

    status: str
    status_colour: Colour
    facts: str
    nodes_px: Floats
    names: tuple[str, ...]
    fixed: NDArray[np.bool_]
    springs: NDArray[np.int64]
    marks: tuple[MarkDrawn, ...]
    target_px: Floats
    target_cov_px2: Floats | None
    target_shape_px: Floats
    trusted: bool
    needle: NeedleDrawn | None = None
    advice: str = ""
    advice_colour: Colour = LIGHT
    notes: tuple[str, ...] = ()


def drawn(image: Image, overlay: Overlay) -> Image:
    """A copy of a frame, (height, width, 3) BGR uint8, with the overlay."""
    canvas = sketched(image, overlay)
    scale = scale_of(canvas)
    _names(canvas, overlay, scale, _words(canvas, overlay, scale))
    return canvas


def sketched(image: Image, overlay: Overlay) -> Image:
    """A copy of a frame, (height, width, 3) BGR uint8, with the overlay but without its text."""
    canvas = np.ascontiguousarray(image).copy()
    scale = scale_of(canvas)
    _network(canvas, overlay, scale)
    for mark in overlay.marks:
        _mark(canvas, mark, scale)
    if overlay.needle is not None:
        _needle(canvas, overlay.needle, scale)
    _target(canvas, overlay, scale)
    return canvas


def scale_of(image: Image) -> float:
    """Factor on the size of lines and letters, relative to a picture of 640x480; at least 1."""
    return max(1.0, min(image.shape[:2]) / 480.0)


def hue_colour(hue_deg: float) -> Colour:
    """A light colour of this hue, BGR."""
    red, green, blue = colorsys.hsv_to_rgb(hue_deg % 360.0 / 360.0, 0.75, 1.0)
    return round(255 * blue), round(255 * green), round(255 * red)


def within_95(cov_px2: Floats | None) -> Floats | None:
    """Matrix from the unit circle to the 95 % ellipse of a covariance [px²]; None if there is no covariance."""
    if cov_px2 is None or not np.isfinite(cov_px2).all():
        return None
    values, vectors = np.linalg.eigh(cov_px2)
    return np.asarray(vectors * (WITHIN_95 * np.sqrt(values.clip(0.0))), dtype=np.float64)


def _network(canvas: Image, overlay: Overlay, scale: float) -> None:
    nodes = overlay.nodes_px
    draw_segments(canvas, nodes[overlay.springs], DARK, round(scale) + 1, edge=0)
    draw_segments(canvas, nodes[overlay.springs], SPRING, round(scale), edge=0)
    size = 2.5 * scale
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0]])
    for place, fixed in zip(nodes, overlay.fixed, strict=True):
        outline = place + size * corners if fixed else ellipse_points(place, size * np.eye(2))
        draw_line(canvas, outline, SPRING, round(scale))


def _mark(canvas: Image, mark: MarkDrawn, scale: float) -> None:
    colour, thin = hue_colour(mark.hue_deg), round(scale)
    if mark.expected_px is not None:
        reach = within_95(mark.expected_cov_px2)
        if reach is not None:
            draw_dashes(canvas, ellipse_points(mark.expected_px, reach), 4.0 * scale, colour, thin)
        if mark.fate is Fate.LOST:
            draw_dashes(canvas, ellipse_points(mark.expected_px, mark.shape_px), 6.0 * scale, colour, 2 * thin)
            if mark.candidate_px is not None:
                draw_segments(canvas, mark.candidate_px + 5.0 * scale * CROSS, colour, thin)
                draw_dashes(canvas, np.stack([mark.expected_px, mark.candidate_px]), 3.0 * scale, colour, thin)
    if mark.center_px is None:
        return
    draw_line(canvas, ellipse_points(mark.center_px, mark.shape_px), colour, 2 * thin)
    reach = within_95(mark.cov_px2)
    if reach is not None:
        draw_line(canvas, ellipse_points(mark.center_px, reach), colour, thin)
    if mark.fate is Fate.REFUSED:
        draw_segments(canvas, mark.center_px + 1.2 * CROSS @ mark.shape_px.T, LIGHT, 2 * thin)


def _target(canvas: Image, overlay: Overlay, scale: float) -> None:
    place, thin = overlay.target_px, round(scale)
    layer = canvas if overlay.trusted else canvas.copy()
    draw_dashes(layer, ellipse_points(place, overlay.target_shape_px), 3.0 * scale, TARGET, thin)
    reach = within_95(overlay.target_cov_px2)
    if reach is not None:
        draw_line(layer, ellipse_points(place, reach), TARGET, 2 * thin)
    plus = 5.0 * scale * np.array([[[-1.0, 0.0], [1.0, 0.0]], [[0.0, -1.0], [0.0, 1.0]]])
    draw_segments(layer, place + plus, TARGET, thin)
    if layer is not canvas:
        cv2.addWeighted(layer, FAINT, canvas, 1.0 - FAINT, 0.0, dst=canvas)


def _needle(canvas: Image, needle: NeedleDrawn, scale: float) -> None:
    thin = round(scale)
    draw_dashes(canvas, needle.ahead_px, 5.0 * scale, LIGHT, thin)
    draw_line(canvas, needle.shaft_px, LIGHT, 3 * thin)
    if needle.aim_px is None:
        return
    reach = within_95(needle.aim_cov_px2)
    if reach is not None:
        draw_dashes(canvas, ellipse_points(needle.aim_px, reach), 4.0 * scale, LIGHT, thin)
    draw_segments(canvas, needle.aim_px + 6.0 * scale * CROSS, LIGHT, thin)


def _names(canvas: Image, overlay: Overlay, scale: float, rows: tuple[float, float]) -> None:
    """Write names to the upper right of nodes and marks, between the two `rows` of the picture [px]."""
    up = text_height(scale)

    def draw(name: str, right: float, above: float, colour: Colour) -> None:
        draw_text(canvas, name, (right, min(max(above - up, rows[0]), rows[1] - up)), colour, scale)

    marked = {mark.name for mark in overlay.marks}
    for name, place in zip(overlay.names, overlay.nodes_px, strict=True):
        if name and name not in marked and _is_inside(canvas, place):
            draw(name, place[0] + 5.0 * scale, place[1], LIGHT)
    for mark in overlay.marks:
        place = mark.expected_px if mark.center_px is None else mark.center_px
        if place is None or not _is_inside(canvas, place):
            continue
        half = 0.75 * float(np.abs(mark.shape_px).sum(axis=1).max())
        text = mark.name if mark.fate is Fate.FOUND else f"{mark.name} {mark.fate}"
        draw(text, place[0] + half, place[1] - half, hue_colour(mark.hue_deg))


def _is_inside(canvas: Image, place_px: Floats) -> bool:
    height, width = canvas.shape[:2]
    return bool(np.isfinite(place_px).all() and 0 <= place_px[0] < width and 0 <= place_px[1] < height)


def _words(canvas: Image, overlay: Overlay, scale: float) -> tuple[float, float]:
    """Write status, facts and advice at the top, reasons at the bottom; returns the first and last row without text."""
    height, width = canvas.shape[:2]
    pad, line, large = 5.0 * scale, text_height(scale), 1.3 * scale
    room = width - 2.0 * pad
    beside = text_width(overlay.status, large) + pad + text_width(overlay.facts, scale) <= room
    above = [(text, LIGHT) for text in ([] if beside else wrapped(overlay.facts, room, scale))]
    above += [(text, overlay.advice_colour) for text in wrapped(overlay.advice, room, scale)]
    down = pad + text_height(large)
    darken(canvas, 0.0, down + len(above) * line)
    at = 2.0 * pad + draw_word(canvas, overlay.status, (pad, pad), overlay.status_colour, large)
    if beside:
        draw_text(canvas, overlay.facts, (at, down - line), LIGHT, scale)
    for k, (text, colour) in enumerate(above):
        draw_text(canvas, text, (pad, down + k * line), colour, scale)
    reasons = [f"{mark.name} {mark.fate}: {mark.why}" for mark in overlay.marks if mark.why]
    more = len(reasons) - MOST_LINES
    shown = [*reasons[:MOST_LINES], *([f"and {more} more"] if more > 0 else []), *overlay.notes]
    below = [text for reason in shown for text in wrapped(reason, room, scale)]
    top = height - pad - len(below) * line
    if below:
        darken(canvas, top, height)
    for k, text in enumerate(below):
        draw_text(canvas, text, (pad, top + k * line), LIGHT, scale)
    return down + len(above) * line, top if below else float(height)


def wrapped(text: str, room_px: float, scale: float) -> list[str]:
    """The lines of a text that is broken between words, so that lines are at most `room_px` [px] wide."""
    if not text or text_width(text, scale) <= room_px:
        return [text] if text else []
    lines: list[str] = []
    for word in text.split():
        longer = f"{lines[-1]} {word}" if lines else word
        if lines and text_width(longer, scale) <= room_px:
            lines[-1] = longer
        else:
            lines.append(word)
    return lines
