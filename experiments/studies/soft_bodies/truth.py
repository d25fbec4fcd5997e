"""Motion of a body of finite elements under large strains: the truth of the study's breasts.

The body has neo-Hookean tetrahedra, and its state has all nodes. The implicit midpoint rule integrates the motion.
Newton's method solves each step, and factors its matrix again only if convergence is slow. Law, mesh and integrator
differ from the filter's.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import diags_array
from scipy.sparse.linalg import SuperLU

from dynamics.elements import Assembly, Tetrahedra, TissueConstants
from dynamics.mesh import TetMesh, Tissue, factored, lumped_masses
from experiments.arrays import Floats

STEPS = 2
"""Number of steps per frame; numerical."""

CONVERGED = 1e-6
"""Change of the velocity that ends an iteration [m/s]; numerical."""

SLOW, MOST = 6, 40
"""Numbers of iterations after which the matrix is factored again, and after which the step fails; numerical."""

Load = Callable[[float], Floats]
"""Forces on all nodes at a time [s], (n_nodes, 3) [N]."""


def motion(mesh: TetMesh, tissues: list[Tissue], fixed: NDArray[np.int64], times_s: Floats, load: Load) -> Floats:
    """Positions of all nodes [m], (n_frames, n_nodes, 3), for a body that is at rest at the first time.

    times_s: equally spaced times of the frames [s]; load: forces on all nodes at a time.

    Raises RuntimeError if a step has no solution.
    """
    E, nu, density, damping = (
        np.array([getattr(tissue, key) for tissue in tissues])[mesh.regions]
        for key in ("young_pa", "poisson", "density_kg_m3", "damping_s")
    )
    free = np.setdiff1d(np.arange(len(mesh.nodes)), fixed)
    elements = Tetrahedra(mesh, "neo-hookean", TissueConstants(E, nu, damping))
    body = Assembly(mesh.nodes, free, [elements])
    mass = np.repeat(lumped_masses(mesh, density)[free], 3)
    h = float(times_s[1] - times_s[0]) / STEPS
    q, v, factor = mesh.nodes[free].ravel(), np.zeros(len(mass)), None
    found = [mesh.nodes.copy()]
    for start in times_s[:-1]:
        for step in range(STEPS):
            force = load(start + (step + 0.5) * h)[free].ravel()
            middle, factor = _step(body, mass, h, (q, v), force, factor)
            q, v = q + h * middle, 2.0 * middle - v
        now = mesh.nodes.copy()
        now[free] = q.reshape(-1, 3)
        found.append(now)
    return np.array(found)


def _step(
    body: Assembly, mass: Floats, h: float, state: tuple[Floats, Floats], force: Floats, factor: SuperLU | None
) -> tuple[Floats, SuperLU]:
    """Velocity at the midpoint of a step [m/s], and the factors of Newton's matrix for the next step."""
    q, v = state
    for most in (SLOW, MOST) if factor is not None else (MOST,):
        middle = v.copy()
        for _ in range(most):
            if factor is None:
                K, C = body.tangents(q + 0.5 * h * middle, middle)
                factor = factored(diags_array(2.0 / h * mass) + 0.5 * h * K + C)
            change = factor.solve(body.force(q + 0.5 * h * middle, middle) + force - 2.0 / h * mass * (middle - v))
            if not np.isfinite(change).all():
                break
            middle = middle + change
            if np.abs(change).max() < CONVERGED:
                return middle, factor
        factor = None
    raise RuntimeError(f"truth: expected a solution of a step within {MOST} iterations, found none")
