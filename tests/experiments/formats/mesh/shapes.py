"""Small meshes with known faults: a box of tetrahedra, and its surface."""

from itertools import permutations

import numpy as np


def box(cells: tuple[int, int, int], size: float) -> tuple[np.ndarray, np.ndarray]:
    """Nodes, (n, 3), and tetrahedra, (m, 4), of cubes with edges of this size, six tetrahedra each."""
    nx, ny, nz = cells
    nodes = np.array([[x, y, z] for x in range(nx + 1) for y in range(ny + 1) for z in range(nz + 1)], dtype=float)
    of = {tuple(node): i for i, node in enumerate(nodes.astype(int).tolist())}
    elements = []
    for cell in np.ndindex(*cells):
        for order in permutations(range(3)):  # from one corner to the opposite one, axis by axis
            path = [np.array(cell)]
            for axis in order:
                path.append(path[-1] + np.eye(3, dtype=int)[axis])
            corners = [of[tuple(place.tolist())] for place in path]
            even = np.linalg.det(np.eye(3)[list(order)]) > 0.0
            elements.append(corners if even else [corners[0], corners[2], corners[1], corners[3]])
    return size * nodes, np.array(elements)


def sphere(radius: float, times: int = 2) -> tuple[np.ndarray, np.ndarray]:
    """Nodes, (n, 3), and triangles, (m, 3), of an octahedron whose faces were divided, outward."""
    nodes = [np.array(v, dtype=float) for v in ((1, 0, 0), (0, 1, 0), (0, 0, 1), (-1, 0, 0), (0, -1, 0), (0, 0, -1))]
    faces = [(0, 1, 2), (1, 3, 2), (3, 4, 2), (4, 0, 2), (1, 0, 5), (3, 1, 5), (4, 3, 5), (0, 4, 5)]
    for _ in range(times):
        middles: dict[tuple[int, int], int] = {}
        finer = []
        for a, b, c in faces:
            ends = [tuple(sorted(pair)) for pair in ((a, b), (b, c), (c, a))]
            for i, j in ends:
                if (i, j) not in middles:
                    middles[i, j] = len(nodes)
                    nodes.append((nodes[i] + nodes[j]) / np.linalg.norm(nodes[i] + nodes[j]))
            ab, bc, ca = (middles[pair] for pair in ends)
            finer += [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        faces = finer
    return radius * np.array(nodes), np.array(faces)
