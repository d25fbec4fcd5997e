"""Rest shape of a network, and rest lengths from a measured shape."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize

from dynamics.arrays import Floats
from dynamics.forces.energy import node_forces, potential_energy
from dynamics.forces.parameters import parameter_forces, parameter_label, parameters
from dynamics.forces.tangent import STRETCHES, stiffness_matrix
from dynamics.network.mass_spring import MassSpringNetwork, NetworkError, all_positions
from dynamics.network.material import path_lengths

RESIDUAL = 1e-9
"""Largest remaining force on a node at rest, relative to the largest product of stiffness and rest length."""


RIGID = 1e-9
"""A stiffness below this share of the largest one is a rounding error, such as the stiffness against a rigid motion."""

MOST_CHANGE = 1.0 - float(STRETCHES[0])
"""Largest relative change of a rest length. After a larger change, the result of `stable_step` is not valid."""

RANK_TOLERANCE = 1e-12
"""Share of the largest singular value below which a singular value is only a rounding error."""

MOST_PASSES = 50
CONVERGED = 1e-11
"""The iteration ends if no rest length changes by more than this share, which is a hundred times the rounding error."""


def supported(network: MassSpringNetwork) -> MassSpringNetwork:
    """The network or, if it has no anchors, a copy without gravity, because an unknown support balances the weight."""
    return network if network.fixed.any() else replace(network, gravity=np.zeros(network.dim))


def rest_shape(network: MassSpringNetwork, force: ArrayLike = 0.0) -> Floats:
    """Positions of all nodes at rest [m], (n_nodes, dim): the minimum of the energy nearest to the drawn shape.

    force: a constant force on the free nodes [N], (n_free, dim); default: no force
    If the network has no anchors, gravity is omitted, and the rest shape is aligned with the drawn shape.
    Raises NetworkError if no stable minimum of the energy is found near the drawn shape.
    """
    network = supported(network)
    if network.continuum is not None:
        forces = np.broadcast_to(np.asarray(force, dtype=float), (len(network.free), network.dim))
        moved = _deflection(network.continuum.stiffness, forces)
        return all_positions(network, network.positions[network.free] + moved)
    shape, anchored = (len(network.free), network.dim), bool(network.fixed.any())
    constant = np.broadcast_to(np.asarray(force, dtype=float), shape).ravel()
    loose = not anchored or _turns_about_the_vertical(network)

    def everywhere(q: Floats) -> Floats:
        return all_positions(network, q.reshape(shape))

    def gradient(q: Floats) -> Floats:
        x = everywhere(q)
        return -node_forces(network, x, np.zeros_like(x))[network.free].ravel() - constant

    found = minimize(
        lambda q: potential_energy(network, everywhere(q)) - constant @ q,
        network.positions[network.free].ravel(),
        jac=gradient,
        hess=lambda q: stiffness_matrix(network, everywhere(q)),
        method="trust-exact",
        options={"gtol": 1e-12, "maxiter": 500, "initial_trust_radius": 0.01, "max_trust_radius": 0.1},
    )
    q = np.asarray(found.x)
    for _ in range(3):  # Newton steps for the last digits, which a trust region on the energy cannot resolve
        K = stiffness_matrix(network, everywhere(q))
        stiffnesses = np.linalg.eigvalsh(K)
        if stiffnesses[0] <= (-RIGID * stiffnesses[-1] if loose else 0.0):
            raise NetworkError("rest shape: expected a stable equilibrium near the drawn shape, found none")
        # the minimum-norm step leaves motions without resistance unchanged
        q = q - (np.linalg.lstsq(K, gradient(q), rcond=RIGID)[0] if loose else np.linalg.solve(K, gradient(q)))
    scale = np.abs(network.stiffness * network.rest_lengths).max()
    left = np.abs(gradient(q)).max()
    if not left <= RESIDUAL * scale:
        raise NetworkError(f"rest shape: expected forces to balance, found {left:.3g} N left over")
    return everywhere(q) if anchored else _aligned(everywhere(q), network.positions)


def _deflection(stiffness: Floats, forces: Floats) -> Floats:
    """Smallest displacement [m], (n_free, dim), that balances forces [N], (n_free, dim)."""
    if not forces.any():
        return np.zeros_like(forces)
    return np.asarray(np.linalg.lstsq(stiffness, forces.ravel(), rcond=RIGID)[0]).reshape(forces.shape)


def _turns_about_the_vertical(network: MassSpringNetwork) -> bool:
    """Whether a 3-D body can rotate about the vertical. It can if all anchors lie on one vertical line."""
    weight = float(np.linalg.norm(network.gravity))
    if network.dim < 3 or weight == 0.0:
        return False
    anchors = network.positions[network.fixed] - network.positions[network.fixed][0]
    along = network.gravity / weight
    return bool(np.abs(anchors - np.outer(anchors @ along, along)).max() <= RIGID * float(reaches(network).max()))


def _aligned(shape: Floats, drawn: Floats) -> Floats:
    """A shape (n_nodes, dim) after the rigid motion that fits it best to the drawn shape. Source: [kabsch1976]."""
    middle = shape.mean(axis=0)
    left, _, right = np.linalg.svd((shape - middle).T @ (drawn - drawn.mean(axis=0)))
    left[:, -1] *= np.sign(np.linalg.det(left @ right))
    return (shape - middle) @ left @ right + drawn.mean(axis=0)


def equilibrium_with_fixed(network: MassSpringNetwork, places: Mapping[str, ArrayLike]) -> Floats:
    """Positions of all nodes at equilibrium [m], (n_nodes, dim), if the nodes named in `places` are fixed.

    places: positions of these nodes, by name [m], (dim,). Raises NetworkError if there is no rest shape.
    """
    positions, fixed = network.positions.copy(), network.fixed.copy()
    for node, position in places.items():
        positions[network.index(node)] = position
        fixed[network.index(node)] = True
    if fixed.all():
        return positions
    return rest_shape(replace(network, positions=positions, fixed=fixed))


def reaches(network: MassSpringNetwork) -> Floats:
    """Distance of each node from its nearest anchor [m], (n_nodes,); if there are no anchors, from its farthest node.

    In a continuum, the distance is along a straight line. Otherwise, it is the sum of the rest lengths along a path.
    """
    if network.continuum is not None:
        ends = network.positions[network.fixed] if network.fixed.any() else network.positions
        straight = np.linalg.norm(network.positions[:, None] - ends, axis=2)
        return np.asarray(straight.min(axis=1) if network.fixed.any() else straight.max(axis=1))
    paths = path_lengths(network, network.rest_lengths)
    if network.fixed.any():
        return np.asarray(paths[network.fixed].min(axis=0))
    return np.asarray(paths.max(axis=1))


def fit_rest_lengths(
    network: MassSpringNetwork, positions: ArrayLike, *, sd_m: float = 0.0, known: float = 0.1
) -> MassSpringNetwork:
    """Correct the rest lengths so that the measured positions of the nodes are a rest shape; returns the new network.

    positions: measured positions of all nodes [m], (n_nodes, dim); sd_m: standard deviation of each coordinate [m]
    known: prior relative standard deviation of the rest lengths [1]

    Gauss-Newton steps find the smallest relative changes of rest lengths for which the forces in the measured shape are
    zero. If sd_m is above 0, small forces may remain, because errors of the measured positions cause forces; the steps
    then find the most probable changes. Raises NetworkError if a rest length has to change by more than half, if the
    iteration does not converge, or if there is no stable rest shape near the measured shape.
    """
    x = np.asarray(positions, dtype=float)
    if x.shape != network.positions.shape or not np.isfinite(x).all():
        raise NetworkError(f"positions: expected finite numbers of shape {network.positions.shape}, found {x.shape}")
    drawn = replace(network, positions=x)
    which = parameters(drawn, ("rest_length",))
    still = np.zeros_like(x)
    noise = sd_m * stiffness_matrix(drawn, x)
    change, corrected = np.zeros(len(which)), drawn
    for _ in range(MOST_PASSES):
        f = node_forces(corrected, x, still)[drawn.free].ravel()
        G = parameter_forces(corrected, which, x, still).T / (1.0 + change)
        balance = known**2 * G @ G.T + noise @ noise.T
        before = change
        change = known**2 * G.T @ np.linalg.lstsq(balance, G @ before - f, rcond=RANK_TOLERANCE)[0]
        if np.abs(change).max() > MOST_CHANGE:
            name = parameter_label(network, which[int(np.abs(change).argmax())])
            raise NetworkError(
                f"{name}: expected to rest where it was seen with a change below {100 * MOST_CHANGE:.0f} %,"
                f" found {100 * np.abs(change).max():.0f} %"
            )
        corrected = replace(drawn, rest_lengths=drawn.rest_lengths * (1.0 + change))
        if np.abs(change - before).max() <= CONVERGED:
            return replace(corrected, positions=rest_shape(corrected))
    raise NetworkError(f"rest lengths: expected to converge in {MOST_PASSES} passes, found none that balance")
