"""Force laws of springs and nodes, with energy and derivatives.

A new law belongs in `kernels.py`.
"""

from dynamics.forces.energy import kinetic_energy, node_forces, potential_energy
from dynamics.forces.kernels import KINDS, LAWS, OF_SPRINGS, SLIP_VELOCITY
from dynamics.forces.parameters import (
    Parameter,
    ParameterForces,
    ParameterUncertainty,
    independent_uncertainty,
    parameter_forces,
    parameter_label,
    parameter_named,
    parameter_value,
    parameters,
    scale_parameters,
    strain_uncertainty,
)
from dynamics.forces.tangent import damping_matrix, stable_step, state_matrix, stiffness_matrix

__all__ = [
    "KINDS",
    "LAWS",
    "OF_SPRINGS",
    "SLIP_VELOCITY",
    "Parameter",
    "ParameterForces",
    "ParameterUncertainty",
    "damping_matrix",
    "independent_uncertainty",
    "kinetic_energy",
    "node_forces",
    "parameter_forces",
    "parameter_label",
    "parameter_named",
    "parameter_value",
    "parameters",
    "potential_energy",
    "scale_parameters",
    "stable_step",
    "state_matrix",
    "stiffness_matrix",
    "strain_uncertainty",
]
