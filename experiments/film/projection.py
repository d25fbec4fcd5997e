"""Projection of positions, covariances and shapes into the picture of a camera, in the plane or in space.

Image axes: u right, v down, in pixels; world in metres. Results are NaN or zero for points behind the camera.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from experiments.arrays import Floats
from experiments.formats.scene.marks import Mark
from experiments.formats.scene.scene import Scene
from experiments.formats.scene.space_marks import across, facing, mark_shapes_px, outward
from experiments.pipeline.sight.camera import LEAST_COSINE
from vision import PlaneCamera, SpaceCamera

ON_LINE = 500
"""Number of points on a line whose visibility is tested; numerical: the visible part's ends are some pixels off."""


def view_of(scene: Scene, camera: PlaneCamera | SpaceCamera) -> View:
    """The projection into the picture of one of the scene's cameras."""
    return SpaceView(camera, _normals(scene)) if isinstance(camera, SpaceCamera) else PlaneView(camera)


@lru_cache(maxsize=2)
def _normals(scene: Scene) -> Mapping[str, Floats]:
    """Outward unit normal of the body's surface at each mark, (3,), by the mark's node, for the scene's own shape."""
    nodes = [mark.node for mark in scene.marks]
    return dict(zip(nodes, outward(scene, nodes), strict=True))


@dataclass(frozen=True, slots=True)
class PlaneView:
    """Projection of the tissue's plane into the picture of a camera."""

    camera: PlaneCamera

    def places(self, points_m: Floats) -> Floats:
        """Projection of points [m], (n, dim), to the picture [px], (n, 2)."""
        with suppress(ValueError):
            if np.isfinite(points_m).all():
                return self.camera.project(points_m)
        return np.array([self._place(point) for point in points_m]).reshape(-1, 2)

    def _place(self, point_m: Floats) -> Floats:
        with suppress(ValueError):
            if np.isfinite(point_m).all():
                return self.camera.project(point_m[None])[0]
        return np.full(2, np.nan)

    def line(self, ends_m: Floats) -> Floats:
        """Projection of the visible part of a line between two points [m], (2, dim): its ends [px], (2, 2).

        On a plane the whole line counts as visible.
        """
        return self.places(ends_m)

    def seen(self, mean_m: Floats, cov_m2: Floats | None) -> tuple[Floats, Floats | None]:
        """Project a mean [m], (dim,), and its covariance [m²], (dim, dim), to [px], (2,), and to [px²], (2, 2)."""
        place_px = self._place(mean_m)
        if cov_m2 is None or not np.isfinite(place_px).all():
            return place_px, None
        return place_px, np.asarray(self.camera.cov_to_px(mean_m[None], cov_m2[None])[0], dtype=np.float64)

    def mark_shape(self, mark: Mark, place_m: Floats) -> Floats:
        """Matrix [px], (2, 2), that maps the unit disc to the image of a mark at a position [m], (dim,)."""
        return mark.shape_px(self.camera, place_m) if np.isfinite(self._place(place_m)).all() else np.zeros((2, 2))

    def ball_shape(self, place_m: Floats, radius_m: float) -> Floats:
        """Matrix [px], (2, 2), from the unit disc to a ball's image; place_m: centre [m], (dim,); radius_m: [m]."""
        is_seen = np.isfinite(self._place(place_m)).all()
        return self.camera.disc_shape(place_m, radius_m) if is_seen else np.zeros((2, 2))

    def faces(self, node: str, place_m: Floats | None) -> bool:
        """Whether a mark at a position [m], (dim,), may be visible. In space, no mark is visible without a position."""
        return True


@dataclass(frozen=True, slots=True)
class SpaceView:
    """Projection of a body in space into the picture of a camera; normals: outward unit normal at each mark, (3,)."""

    camera: SpaceCamera
    normals: Mapping[str, Floats]

    def places(self, points_m: Floats) -> Floats:
        """See `PlaneView`."""
        inside, places_px, _ = self.camera.viewed(points_m)
        return np.where(inside[:, None], places_px, np.nan)

    def line(self, ends_m: Floats) -> Floats:
        """See `PlaneView`."""
        places_px = self.places(np.linspace(ends_m[0], ends_m[1], ON_LINE))
        inside = np.flatnonzero(np.isfinite(places_px).all(axis=1))
        return places_px[inside[[0, -1]]] if len(inside) else places_px[[0, -1]]

    def seen(self, mean_m: Floats, cov_m2: Floats | None) -> tuple[Floats, Floats | None]:
        """See `PlaneView`."""
        [inside], [place_px], [J] = self.camera.viewed(mean_m[None])
        if not inside:
            return np.full(2, np.nan), None
        return place_px, None if cov_m2 is None else J @ cov_m2 @ J.T

    def mark_shape(self, mark: Mark, place_m: Floats) -> Floats:
        """See `PlaneView`."""
        [inside], _, J = self.camera.viewed(place_m[None])
        discs = across(self.normals[mark.node][None])
        return mark_shapes_px([mark], self.camera, place_m[None], discs, J)[0] if inside else np.zeros((2, 2))

    def ball_shape(self, place_m: Floats, radius_m: float) -> Floats:
        """See `PlaneView`."""
        is_seen = self.camera.in_view(place_m[None])[0]
        return self.camera.ball_shape(place_m, radius_m) if is_seen else np.zeros((2, 2))

    def faces(self, node: str, place_m: Floats | None) -> bool:
        """See `PlaneView`."""
        if place_m is None:
            return False
        places = place_m[None]
        is_facing = facing(self.camera, places, self.normals[node][None], LEAST_COSINE)[0]
        return bool(is_facing and self.camera.in_view(places)[0])


View = PlaneView | SpaceView
