"""Networks that tests make by few words."""

import numpy as np

from dynamics import MassSpringNetwork


def build_network(positions, springs, anchors=(), names=None, **changes) -> MassSpringNetwork:
    """Nodes N0, N1, ... of 0.2 kg and springs of 80 N/m at ease where drawn, no losses, no gravity, but for changes."""
    x = np.asarray(positions, dtype=float)
    pairs = np.asarray(springs)
    n, dim = x.shape
    fixed = np.zeros(n, dtype=bool)
    fixed[list(anchors)] = True
    fields = {
        "masses": 0.2,
        "drag": 0.0,
        "friction": 0.0,
        "stiffness": 80.0,
        "rest_lengths": np.linalg.norm(x[pairs[:, 1]] - x[pairs[:, 0]], axis=1),
        "damping": 0.0,
        "gravity": 0.0,
    } | changes
    sizes = dict.fromkeys(("masses", "drag", "friction"), n) | {"gravity": dim}
    spread = {key: np.broadcast_to(value, sizes.get(key, len(pairs))) for key, value in fields.items()}
    named = tuple(names or (f"N{i}" for i in range(n)))
    return MassSpringNetwork(names=named, positions=x, fixed=fixed, springs=pairs, **spread)


def held_masses(n=1, **changes) -> MassSpringNetwork:
    """Masses of 0.5 kg, each between four anchors on springs of 20 N/m without tension: 80 rad²/s² along either axis.

    Near rest each moves as a line says. Names: mass, E, W, N, S; mass1, E1, ...
    """
    ends = np.array([[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    positions = np.concatenate([ends + np.array([5.0 * k, 0.0]) for k in range(n)])
    names = [f"{name}{k or ''}" for k in range(n) for name in ("mass", "E", "W", "N", "S")]
    anchors = [k for k in range(5 * n) if k % 5]
    constants = {"masses": 0.5, "stiffness": 20.0} | changes
    return build_network(positions, [(k - k % 5, k) for k in anchors], anchors, names, **constants)


def slab(shape=(5, 4, 4)) -> MassSpringNetwork:
    """Nodes of unequal masses on a grid, 30 mm apart, the first layer held; springs to all neighbours."""
    grid = 0.03 * np.stack(np.meshgrid(*map(range, shape), indexing="ij"), axis=-1).reshape(-1, 3)
    apart = np.linalg.norm(grid[:, None] - grid, axis=2)
    springs = np.argwhere(np.triu((apart > 0.0) & (apart < 0.053)))
    held, masses = np.flatnonzero(grid[:, 0] == 0.0), np.random.default_rng(0).uniform(0.005, 0.015, len(grid))
    return build_network(grid, springs, held, masses=masses, stiffness=30.0, damping=0.2)
