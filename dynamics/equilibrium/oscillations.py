"""Small oscillations of a network about its rest shape: frequencies and decay times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dynamics.arrays import Floats
from dynamics.forces.tangent import state_matrix
from dynamics.network.mass_spring import MassSpringNetwork

ROUNDING = 1e-6
"""Eigenvalues below this share of the largest one are rounding errors. Imaginary parts below this share of the
eigenvalue are, too. A double eigenvalue has a relative rounding error of about the root of the machine precision."""


@dataclass(frozen=True, slots=True, eq=False)
class Oscillations:
    """Natural oscillations of a network about a rest shape. They solve `(z² M + z C + K) u = 0`, with eigenvalues z.

    frequencies_hz: undamped natural frequencies `abs(z) / (2 pi)` of the oscillating motions [Hz], (n,), ascending
    damping_ratios: damping ratios `-Re z / abs(z)` of the oscillating motions [1], (n,)
    decays_s: time constants of the motions that do not oscillate, longest first [s], (m,)
    """

    frequencies_hz: Floats
    damping_ratios: Floats
    decays_s: Floats


def oscillations(network: MassSpringNetwork, shape: ArrayLike) -> Oscillations:
    """Compute the natural oscillations about a rest shape; shape: positions of all nodes [m], (n_nodes, dim).

    Dry friction is ignored, because it is not proportional to speed. Motions without resistance are omitted, such as
    the motion of a whole network without anchors. Source: [tisseur2001], first companion form.
    """
    rates = np.linalg.eigvals(state_matrix(network, np.asarray(shape, dtype=float), speed_m_s=np.inf))
    rates = rates[np.abs(rates) > ROUNDING * np.abs(rates).max()]
    turning = np.abs(rates.imag) > ROUNDING * np.abs(rates)
    paired = rates[turning & (rates.imag > 0.0)]
    paired = paired[np.argsort(np.abs(paired))]
    creeping = rates[~turning & (rates.real < 0.0)].real
    size = np.abs(paired)
    return Oscillations(size / (2.0 * np.pi), -paired.real / size, np.sort(-1.0 / creeping)[::-1])
