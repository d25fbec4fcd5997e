"""Structures of tissues in a cube: layers, cell walls, lobules with ducts, fibres.

A structure is a function from points of the unit cube, (n, 3), to their distances from the surface of each tissue of
the structure, (n_tissues, n). A distance is negative inside the tissue. The constants below define these structures;
they are not settings.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from scipy.spatial import cKDTree

from dynamics.arrays import Floats

Structure = Callable[[Floats], Floats]
"""Function from points, (n, 3), to their distances from the surface of each tissue except the surrounding tissue,
(n_tissues, n). Points and distances are relative to the side of the cube."""

THICK, WALL = 0.12, 0.08
"""THICK is the thickness of layers, ducts and fibres, and WALL that of a foam's walls, relative to the side of the
cube.

A lattice of ten cells per side does not resolve the walls. In six foams, 4.8 % of the springs cross a surface. The
walls fill 55.9 % of the mesh, but only 53.4 % of the exact foams."""

LAYERS, WAVE = 3, 0.04
"""Number of layers; amplitude of the waves of each layer, relative to the side of the cube."""

CELLS = 3
"""Number of foam cells along a side; the number of lobules along a side is one less."""

RADIUS = 0.16
"""Radius of lobules, relative to the side of the cube."""

FIBRES = 4
"""Number of fibres in a row along y and in a row along z, 16 fibres in all. All fibres run along x."""

SHIFT = 0.06
"""Largest random shift of the centres of foam cells and lobules, relative to the side of the cube. For fibres, half
this value is the largest shift and the amplitude of the waves."""


def plain(rng: np.random.Generator) -> Structure:
    """No structure: the cube contains only the surrounding tissue."""
    del rng
    return lambda x: np.ones((1, len(x)))


def sheet(rng: np.random.Generator) -> Structure:
    """Wavy layers perpendicular to z."""
    phases, heights = rng.uniform(0.0, 2.0 * np.pi, 2), (np.arange(LAYERS) + 0.5) / LAYERS

    def distances(x: Floats) -> Floats:
        wave = WAVE * np.sin(2.0 * np.pi * x[:, 0] + phases[0]) * np.cos(2.0 * np.pi * x[:, 1] + phases[1])
        return np.asarray(np.abs((x[:, 2] + wave)[:, None] - heights).min(axis=1) - 0.5 * THICK)[None]

    return distances


def foam(rng: np.random.Generator) -> Structure:
    """Walls between Voronoi cells, whose centres are randomly shifted points of a grid."""
    centres = (_grid(np.arange(-1.0, CELLS + 1.0)) + 0.5) / CELLS
    centres = centres + SHIFT * rng.uniform(-1.0, 1.0, centres.shape)
    nearest = cKDTree(centres)

    def distances(x: Floats) -> Floats:
        a, b = (centres[which] for which in nearest.query(x, 2)[1].T)
        further = ((x - b) ** 2).sum(axis=1) - ((x - a) ** 2).sum(axis=1)
        return np.asarray(0.5 * further / np.linalg.norm(b - a, axis=1) - 0.5 * WALL)[None]

    return distances


def lobules(rng: np.random.Generator) -> Structure:
    """Balls, and a duct from each ball to a common stem along z."""
    centres = (_grid(np.arange(CELLS - 1.0)) + 0.5) / (CELLS - 1)
    centres = centres + SHIFT * rng.uniform(-1.0, 1.0, centres.shape)
    fork = np.array([0.5, 0.5, 0.5])
    ducts = [(fork, np.array([0.5, 0.5, -0.1])), *((fork, centre) for centre in centres)]

    def distances(x: Floats) -> Floats:
        balls = cKDTree(centres).query(x)[0] - RADIUS
        return np.stack([balls, np.min([_to_segment(x, a, b) for a, b in ducts], axis=0) - 0.5 * THICK])

    return distances


def fibres(rng: np.random.Generator) -> Structure:
    """Wavy fibres along x."""
    middles = _grid((np.arange(FIBRES) + 0.5) / FIBRES)[::FIBRES, :2]
    middles = middles + 0.5 * SHIFT * rng.uniform(-1.0, 1.0, middles.shape)
    phases = rng.uniform(0.0, 2.0 * np.pi, middles.shape)

    def distances(x: Floats) -> Floats:
        wave = 0.5 * SHIFT * np.sin(2.0 * np.pi * x[:, 0, None, None] + phases)
        return np.asarray(np.linalg.norm(x[:, None, 1:] - middles - wave, axis=2).min(axis=1) - 0.5 * THICK)[None]

    return distances


def _grid(along: Floats) -> Floats:
    return np.stack(np.meshgrid(along, along, along, indexing="ij"), axis=-1).reshape(-1, 3).astype(float)


def _to_segment(x: Floats, a: Floats, b: Floats) -> Floats:
    share = np.clip((x - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
    return np.asarray(np.linalg.norm(x - a - share[:, None] * (b - a), axis=1))


STRUCTURES: Mapping[str, tuple[Callable[[np.random.Generator], Structure], tuple[str, ...]]] = {
    "plain": (plain, ("fat", "fat")),
    "sheet": (sheet, ("fat", "fascia")),
    "foam": (foam, ("fat", "fibrous")),
    "lobules": (lobules, ("fat", "gland", "fibrous")),
    "fibres": (fibres, ("fat", "fibrous")),
}
"""Structures by name, each with its tissues from `dynamics.mesh.tissues.TISSUES`, the surrounding tissue first."""
