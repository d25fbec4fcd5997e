"""Lungs whose displacement is a known function, in the tables of real ones."""

from pathlib import Path

import numpy as np

HEAD = "landmark,x0_mm,y0_mm,z0_mm,x1_mm,y1_mm,z1_mm"


def landmarks(seed: int, n: int = 150) -> np.ndarray:
    """Two ellipsoids of landmarks 150 mm apart along x [mm], (2 n, 3)."""
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(2 * n, 3))
    radii = rng.uniform(0.0, 1.0, (2 * n, 1)) ** (1.0 / 3.0)
    points = directions / np.linalg.norm(directions, axis=1, keepdims=True) * radii * [50.0, 60.0, 90.0]
    points[n:, 0] += 200.0
    return np.round(points + np.full(3, 100.0), 3)


def exhaled(points: np.ndarray) -> np.ndarray:
    """Where they move [mm], (n, 3): upwards, more towards the bottom, less towards the back; the waist narrows."""
    x, y, z = points.T
    depth = z / 190.0
    return np.column_stack([x, y + 2.0 * np.sin(np.pi * depth), z - 10.0 * depth**2 * (1.0 - y / 400.0)])


def write_case(path: Path, before: np.ndarray, after: np.ndarray) -> None:
    """A table of landmarks [mm], (n, 3) each, as the study reads it."""
    rows = [HEAD]
    for k, places in enumerate(np.hstack([before, after])):
        rows.append(",".join([str(k), *(f"{value:.3f}" for value in places)]))
    path.write_text("\n".join(rows) + "\n")
