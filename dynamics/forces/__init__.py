"""Force laws: forces, energy, tangent matrices, and derivatives with respect to constants.

What may enter: another force law, in `kernels.py`, with its energy and derivatives beside it.
"""

from dynamics.forces.energy import kinetic_energy, node_forces, potential_energy
from dynamics.forces.kernels import SLIP_VELOCITY
from dynamics.forces.parameters import (
    KINDS,
    Parameter,
    ParameterForces,
    Uncertainty,
    independent,
    label,
    parameter_forces,
    parameter_named,
    parameters,
    scaled,
    value,
)
from dynamics.forces.tangent import damping_matrix, stable_step, state_matrix, stiffness_matrix

__all__ = [
    "KINDS",
    "SLIP_VELOCITY",
    "Parameter",
    "ParameterForces",
    "Uncertainty",
    "damping_matrix",
    "independent",
    "kinetic_energy",
    "label",
    "node_forces",
    "parameter_forces",
    "parameter_named",
    "parameters",
    "potential_energy",
    "scaled",
    "stable_step",
    "state_matrix",
    "stiffness_matrix",
    "value",
]
