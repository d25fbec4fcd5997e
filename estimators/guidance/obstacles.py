"""Obstacles such as ribs and vessels: balls and capsules with a safety margin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimators.arrays import Floats


@dataclass(frozen=True, slots=True, eq=False)
class Obstacle:
    """An obstacle such as a rib or a vessel: all points within radius_m of a segment.

    start, end: ends of the segment [m], (dim,), equal for a ball
    margin_m: least distance between a needle and the obstacle's surface [m]
    """

    name: str
    start: Floats
    end: Floats
    radius_m: float
    margin_m: float = 0.0

    def __post_init__(self) -> None:
        for key in ("start", "end"):
            object.__setattr__(self, key, np.array(getattr(self, key), dtype=float))
        if self.start.shape != self.end.shape or self.start.ndim != 1:
            raise ValueError(f"{self.name}: expected ends of one shape, found {self.start.shape} and {self.end.shape}")
        if not (self.radius_m >= 0.0 and self.margin_m >= 0.0):
            raise ValueError(
                f"{self.name}: expected a radius and a margin of 0 m or more, found {self.radius_m}, {self.margin_m}"
            )


def ball(name: str, centre: Floats, radius_m: float, margin_m: float = 0.0) -> Obstacle:
    """An obstacle in the form of a ball with a given centre [m], (dim,)."""
    return Obstacle(name, centre, centre, radius_m, margin_m)


def clearances(starts: Floats, ends: Floats, obstacles: Sequence[Obstacle], radius_m: float = 0.0) -> Floats:
    """Distance of each needle from the margin of each obstacle [m], (n, n_obstacles); negative inside the margin.

    starts, ends: ends of the needles [m], (n, dim); radius_m: radius of every needle [m]
    """
    rows = [
        segment_distances(starts, ends, one.start, one.end) - one.radius_m - one.margin_m - radius_m
        for one in obstacles
    ]
    return np.array(rows).T.reshape(len(starts), len(obstacles))


def segment_distances(starts: Floats, ends: Floats, start: Floats, end: Floats) -> Floats:
    """Distance of each of n segments from one other segment [m], (n,).

    starts, ends: ends of the n segments [m], (n, dim); start, end: ends of the other segment [m], (dim,)
    """
    u, v, w = ends - starts, end - start, starts - start
    a, b, c = np.einsum("nd,nd->n", u, u), u @ v, v @ v
    d, e = np.einsum("nd,nd->n", u, w), w @ v
    least = np.minimum.reduce(
        [
            point_distances(start[None], starts, ends),
            point_distances(end[None], starts, ends),
            point_distances(starts, start[None], end[None]),
            point_distances(ends, start[None], end[None]),
        ]
    )
    det = a * c - b * b
    crossing = det > 1e-12 * a * c
    safe = np.where(crossing, det, 1.0)
    s, t = (b * e - c * d) / safe, (a * e - b * d) / safe
    between = crossing & (s >= 0) & (s <= 1) & (t >= 0) & (t <= 1)
    apart = np.linalg.norm(w + s[:, None] * u - t[:, None] * v, axis=1)
    return np.asarray(np.where(between, np.minimum(least, apart), least))


def point_distances(points: Floats, starts: Floats, ends: Floats) -> Floats:
    """Distance of point i from segment i [m], (n,); points, starts, ends: (n, dim), or (1, dim) if equal for all i."""
    along = ends - starts
    square = np.einsum("nd,nd->n", along, along)
    part = np.einsum("nd,nd->n", points - starts, along) / np.where(square > 0.0, square, 1.0)
    return np.asarray(np.linalg.norm(points - starts - np.clip(part, 0.0, 1.0)[:, None] * along, axis=1))
