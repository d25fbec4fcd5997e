"""Drawings of a body in space from two sides: its shaded surface or its springs, with marks, target and needle.

Views are orthographic. Objects nearer to the viewer are drawn later, larger or darker.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import hsv_to_rgb, to_rgb
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch
from numpy.typing import NDArray

from estimators import Insertion
from experiments.arrays import Floats
from experiments.formats.estimate_rows import AXES
from experiments.formats.scene.outside import Outside, wall_faces
from experiments.formats.scene.scene import Scene
from experiments.formats.scene.space_marks import outward
from experiments.plots.style import HALO, OURS, PURPLE, SMALL_PT, ellipse

TURNS_DEG, RAISED_DEG = (35.0, -55.0, 125.0, -145.0), 25.0
"""Directions to the viewer [degrees]: azimuths in the plane of x and z, from z toward x; elevation above this plane.
Plots show the first view, and a second one: the view that shows most of the marks that the first view hides."""

N_FACES = 4000
"""Largest number of faces that are drawn."""

N_SPRINGS = 600
"""If there are more springs than this, no springs are drawn: they would hide each other."""

SKIN, WALL, NEAR, FAR = to_rgb("#ece7e1"), to_rgb("#9fb4c7"), np.array([0.25] * 3), np.array([0.8] * 3)
"""Colours of faces in full light: free surface, and fixed wall. Colours of springs: near, and far from the viewer."""

VISIBLE = 0.01
"""If the wall fills more than this share of a body's visible area in one of the views, the legend names the wall."""

DIM, LIGHT = 0.6, np.array([-0.35, 0.45, 0.82])
"""Brightness of a face that gets no light of the lamp [1]. Direction to the lamp: right, up and toward the viewer."""

MARGIN = 0.06
"""Margin around a body, relative to its size."""

NEEDLE = "#7a4b1e"
"""Colour of a needle: not black, because curves over time beside the body are black."""

SHAFT_M = 1.0
"""Length of the drawn shaft behind the needle's tip [m]: the shaft ends outside of every plot."""

WAYS = [(1, 1), (1, -1), (-1, 1), (-1, -1), (1, 0), (-1, 0), (0, 1), (0, -1)]
"""Directions in which a name may be placed from its mark."""


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A view: unit vectors right and up in the plot, (2, dim), and the unit vector to the viewer, (dim,)."""

    across: Floats
    toward: Floats

    def seen_mm(self, places_m: Floats) -> Floats:
        """Projection of positions [m], (..., dim), into the plot [mm], (..., 2)."""
        return np.asarray(1e3 * places_m @ self.across.T)

    def seen_cov_mm2(self, cov: Floats) -> Floats:
        """Projection of a covariance [m²], (dim, dim), into the plot [mm²], (2, 2)."""
        return np.asarray(1e6 * self.across @ cov @ self.across.T)


FLAT = View(np.eye(2), np.zeros(2))
"""The view of a flat body, perpendicular to its plane."""


def view_from(turn_deg: float) -> View:
    """The view from this azimuth, one of `TURNS_DEG`, and from the elevation `RAISED_DEG`."""
    turn, up = np.radians([turn_deg, RAISED_DEG])
    right = np.array([np.cos(turn), 0.0, -np.sin(turn)])
    toward = np.array([np.sin(turn) * np.cos(up), np.sin(up), np.cos(turn) * np.cos(up)])
    return View(np.stack([right, np.cross(toward, right)]), toward)


def two_views(scene: Scene) -> tuple[View, View]:
    """Two views of a body that together show most marks."""
    first, *others = map(view_from, TURNS_DEG)
    measured = np.array([mark.measured for mark in scene.marks])
    hidden = ~facing(first, scene) & measured
    shown = [facing(view, scene) for view in others]
    counts = [(int((near & hidden).sum()), int((near & measured).sum())) for near in shown]
    return first, others[counts.index(max(counts))]


def facing(view: View, scene: Scene) -> NDArray[np.bool_]:
    """Whether each mark of a scene is on the side towards the viewer, (n_marks,)."""
    return np.asarray(outward(scene, [mark.node for mark in scene.marks]) @ view.toward > 0.0)


def draw_body(ax: Axes, view: View, scene: Scene, outside: Outside, room_mm: float, *within_m: Floats) -> None:
    """Draw the body in the shape that the scene states, with names of the marks on the visible side.

    room_mm: side in print of the square that the axes fill [mm]; within_m: further positions to show [m], (n, 3)
    """
    network = scene.network
    draw_surface(ax, view, outside, wall_faces(scene, outside))
    frame(ax, view, np.vstack([outside.corners, network.positions, *within_m]))
    draw_springs(ax, view, network.positions, network.springs)
    held = view.seen_mm(network.positions[network.fixed])
    if len(held) and scene.mesh is None:
        ax.plot(*held.T, "s", color="0.3", ms=2.5, ls="", zorder=3)
    draw_marks(ax, view, scene, room_mm)


def draw_surface(ax: Axes, view: View, outside: Outside, wall: NDArray[np.bool_] | None = None) -> None:
    """Draw the faces towards the viewer, shaded, from far to near; wall: whether each face is fixed, (n_faces,)."""
    corners_m, faces, normals = outside.corners, outside.faces, outside.normals
    at_corners = np.stack([np.bincount(faces.ravel(), np.repeat(n, 3), len(corners_m)) for n in normals.T], axis=1)
    smooth = at_corners[faces].mean(axis=1)
    near = np.flatnonzero(normals @ view.toward > 0.0)
    near = near[np.argsort(corners_m[faces[near]].mean(axis=1) @ view.toward)]
    lamp = LIGHT @ np.vstack([view.across, view.toward]) / np.linalg.norm(LIGHT)
    lit = smooth[near] @ lamp / np.maximum(np.linalg.norm(smooth[near], axis=1), 1e-30)
    tints = np.where(wall[near, None], WALL, SKIN) if wall is not None else np.array(SKIN)
    colours = (DIM + (1.0 - DIM) * lit.clip(0.0))[:, None] * tints
    ax.add_collection(
        PolyCollection(
            list(view.seen_mm(corners_m[faces[near]])), facecolors=colours, edgecolors=colours, lw=0.2, zorder=1
        ),
        autolim=False,
    )


def draw_springs(ax: Axes, view: View, places_m: Floats, springs: NDArray[np.int64], tint: str | None = None) -> None:
    """Draw springs between positions [m], (n, 3): far springs first, pale and thin; tint: a colour instead of grey."""
    if not 0 < len(springs) <= N_SPRINGS:
        return
    away = places_m[springs].mean(axis=1) @ view.toward
    depth = (away - away.min()) / max(float(np.ptp(away)), 1e-12)  # 0 for the farthest, 1 for the nearest
    order, near = np.argsort(depth), NEAR if tint is None else np.array(to_rgb(tint))
    colours = FAR + depth[order, None] * (near - FAR)
    segments = list(view.seen_mm(places_m[springs[order]]))
    ax.add_collection(LineCollection(segments, colors=colours, lw=0.3 + 0.5 * depth[order], zorder=2), autolim=False)


def draw_marks(ax: Axes, view: View, scene: Scene, room_mm: float) -> None:
    """Draw marks: named on the visible side, small and pale on the far side, rings if the filter does not use them."""
    network, near = scene.network, facing(view, scene)
    places = view.seen_mm(network.positions[[network.index(mark.node) for mark in scene.marks]])
    named = [k for k, mark in enumerate(scene.marks) if near[k] and mark.measured]
    for k, mark in enumerate(scene.marks):
        if mark.node == scene.target.node and not mark.measured:  # the target is drawn at this position
            continue
        style: dict[str, Any] = (
            {"mec": "0.2", "mew": 0.4, "ms": 3.6, "zorder": 5} if k in named else {"mew": 0.0, "ms": 2.2, "zorder": 4}
        )
        colour = hsv_to_rgb((mark.hue_deg / 360.0, 0.9, 0.85) if near[k] else (mark.hue_deg / 360.0, 0.4, 0.95))
        style |= {"mfc": colour} if mark.measured else {"mfc": "none", "mec": colour, "mew": 0.8, "ms": 3.6}
        ax.plot(*places[k], "o", ls="", **style)
    names = [scene.marks[k].node for k in named]
    side = max(np.ptp(ax.get_xlim()), np.ptp(ax.get_ylim()))
    target = view.seen_mm(network.positions[network.index(scene.target.node)])
    lesion = np.array([target - 1e3 * scene.target.radius_m, target + 1e3 * scene.target.radius_m])
    corners = name_places(places[named], names, float(side) / room_mm, lesion)
    for name, (x, y) in zip(names, corners, strict=True):
        ax.text(x, y, name, fontsize=SMALL_PT, path_effects=HALO, zorder=8, ha="left", va="bottom")


def name_places(places: Floats, names: Sequence[str], scale: float, *kept_free: Floats) -> Floats:
    """Place each name beside its mark, where the overlap with marks, earlier names and `kept_free` is least.

    Returns the lower left corners of the names, (n, 2).
    scale: units of the plot per millimetre in print; kept_free: boxes, each (2, 2), that names should not cover
    """
    disc, gap = 1.3 * scale * np.ones(2), 0.9 * scale
    taken = [*kept_free, *(np.array([place - 0.5 * disc, place + 0.5 * disc]) for place in places)]
    found: list[Floats] = []
    for place, name in zip(places, names, strict=True):
        size = scale * np.array([0.6 + 1.3 * len(name), 2.1])
        tries = [place + gap * np.array(way) + 0.5 * size * (np.array(way) - 1.0) for way in WAYS]
        covered = [sum(_overlap(np.array([corner, corner + size]), one) for one in taken) for corner in tries]
        found.append(tries[int(np.argmin(covered))])
        taken.append(np.array([found[-1], found[-1] + size]))
    return np.array(found).reshape(-1, 2)


def _overlap(one: Floats, other: Floats) -> float:
    """Common area of two boxes, (2, 2) each: lower left and upper right corner."""
    sides = np.minimum(one[1], other[1]) - np.maximum(one[0], other[0])
    return float(np.prod(sides.clip(0.0)))


def frame(ax: Axes, view: View, places_m: Floats) -> None:
    """Set limits with equal scales around positions [m], (n, 3), and draw the axes' directions and a scale bar."""
    at = view.seen_mm(places_m)
    low, high = at.min(axis=0), at.max(axis=0)
    reach = float((high - low).max())
    (left, bottom), (right, top) = low - MARGIN * reach, high + MARGIN * reach
    bottom -= 0.2 * reach  # room for the scale bar and the axes' directions
    ax.set(xlim=(left, right), ylim=(bottom, top), aspect="equal", xticks=[], yticks=[])
    ax.spines[:].set_visible(False)
    scale_bar(ax, reach)
    origin, length = np.array([right - 0.14 * reach, bottom + 0.11 * reach]), 0.09 * reach
    for axis, way in zip(AXES, view.across.T, strict=True):
        ends = np.array([origin, origin + length * way])
        ax.plot(*ends.T, color="0.4", lw=0.7, zorder=6)
        x, y = origin + 1.35 * length * way
        ax.text(x, y, axis, color="0.4", fontsize=SMALL_PT, ha="center", va="center")


def scale_bar(ax: Axes, reach: float) -> None:
    """Draw a bar of about a quarter of `reach` [mm] in the lower left corner, with its length."""
    decade = 10.0 ** np.floor(np.log10(0.3 * reach))
    length = decade * max(k for k in (0.5, 1, 2, 5) if k * decade <= 0.3 * reach)  # 0.5: the logarithm is rounded up
    (left, right), (bottom, top) = ax.get_xlim(), ax.get_ylim()
    x, y = left + 0.04 * (right - left), bottom + 0.04 * (top - bottom)
    ax.plot([x, x + length], [y, y], color="0.2", lw=1.4, solid_capstyle="butt", zorder=6)
    ax.annotate(f"{length:g} mm", (x, y), (0, 2), textcoords="offset points", fontsize=SMALL_PT, color="0.2", zorder=6)


def draw_target(ax: Axes, view: View, place_m: Floats, radius_m: float, cov: Floats | None) -> None:
    """Draw the lesion as a disc, and for a covariance [m²], (3, 3), the outline of the 2-sigma ellipsoid."""
    middle = view.seen_mm(place_m)
    ax.add_patch(Circle((middle[0], middle[1]), 1e3 * radius_m, fc=PURPLE, ec=PURPLE, lw=0.6, alpha=0.5, zorder=6))
    ax.plot(*middle, "+", color=PURPLE, ms=4, mew=0.8, zorder=6)
    if cov is not None:
        ax.add_patch(ellipse(middle, view.seen_cov_mm2(cov), 2.0, fc="none", ec=OURS, lw=0.8, zorder=7))


def draw_needle(ax: Axes, view: View, insertion: Insertion, ahead_m: float) -> None:
    """Draw the needle from the plot's edge to its tip, and a dashed line of length `ahead_m` [m] beyond the tip."""
    tip = insertion.entry + insertion.depth_m * insertion.axis
    shaft, ahead = (view.seen_mm(np.stack([tip, tip + by * insertion.axis])) for by in (-SHAFT_M, ahead_m))
    ax.plot(*shaft.T, color=NEEDLE, lw=1.8, zorder=7, scalex=False, scaley=False)
    ax.plot(*ahead.T, color=NEEDLE, lw=0.9, ls=(0, (3, 2)), zorder=7, scalex=False, scaley=False)


def close_up(ax: Axes, middle: Floats, reach: float) -> None:
    """Show the part of the plot within `reach` [mm] of a position [mm], (2,), on each axis, and draw a scale bar."""
    ax.set(xlim=(middle[0] - reach, middle[0] + reach), ylim=(middle[1] - reach, middle[1] + reach), aspect="equal")
    ax.set(xticks=[], yticks=[])
    ax.spines[:].set(visible=True, color="0.6")
    scale_bar(ax, 1.6 * reach)


def keys(scene: Scene, outside: Outside, views: Sequence[View]) -> dict[str, Line2D | Patch]:
    """Legend entries, by label, for what `draw_body` shows in these views."""
    near = np.array([facing(view, scene) for view in views])
    measured = np.array([mark.measured for mark in scene.marks])
    scored = any(not mark.measured and mark.node != scene.target.node for mark in scene.marks)
    springs = 0 < len(scene.network.springs) <= N_SPRINGS
    name = "convex hull" if scene.mesh is None else "surface at rest"
    shown: dict[str, tuple[bool, Line2D | Patch]] = {
        name: (len(outside.faces) > 0, Patch(fc=SKIN, ec="0.6", lw=0.4)),
        "wall": (_is_seen(wall_faces(scene, outside), outside, views), Patch(fc=WALL, ec="0.6", lw=0.4)),
        "springs as drawn": (springs, Line2D([], [], color=tuple(NEAR), lw=0.8)),
        "anchors": (scene.mesh is None and bool(scene.network.fixed.any()), _dot("s", mfc="0.3", mec="0.3", ms=2.5)),
        "marks": (bool((near & measured).any()), _dot(mfc="0.6", mec="0.2", mew=0.4, ms=3.6)),
        "on the far side": (bool((~near & measured).any()), _dot(mfc="0.75", mec="none", ms=2.2)),
        "marks for scoring only": (scored, _dot(mfc="none", mec="0.4", mew=0.8, ms=3.6)),
    }
    return {label: handle for label, (is_shown, handle) in shown.items() if is_shown}


def _is_seen(faces: NDArray[np.bool_], outside: Outside, views: Sequence[View]) -> bool:
    """Whether these faces fill more than the share `VISIBLE` of the visible area in at least one of the views."""
    areas = [(outside.normals @ view.toward).clip(0.0) for view in views]
    return any(bool(area[faces].sum() > VISIBLE * area.sum()) for area in areas)


def _dot(marker: str = "o", **style: Any) -> Line2D:
    return Line2D([], [], marker=marker, ls="", **style)


TARGET_KEYS: dict[str, Line2D | Patch] = {
    "lesion": _dot(mfc=PURPLE, mec=PURPLE, alpha=0.5, mew=0.6, ms=6),
    "2-sigma ellipsoid": _dot(mfc="none", mec=OURS, mew=0.8, ms=5),
}
NEEDLE_KEYS: dict[str, Line2D | Patch] = {
    "needle": Line2D([], [], color=NEEDLE, lw=1.8),
    "its line ahead": Line2D([], [], color=NEEDLE, lw=0.9, ls=(0, (3, 2))),
}
