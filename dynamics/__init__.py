"""The tissue: nodes, springs, forces, energy, time integration and rest shapes."""

from dynamics.forces import kinetic_energy, node_forces, potential_energy
from dynamics.network import MassSpringNetwork, NetworkError, all_positions, pack, unpack
from dynamics.parameters import (
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
from dynamics.phantom import HIDDEN, OUTER, four_mass_phantom
from dynamics.plain import plain_derivative, plain_step
from dynamics.rest import at_rest_where_seen, rest_shape, shape_held
from dynamics.reversal import reversed_springs
from dynamics.stepping import Stepper, adaptive, derivative, motion
from dynamics.tangent import damping_matrix, stable_step, state_matrix, stiffness_matrix

__all__ = [
    "HIDDEN",
    "KINDS",
    "OUTER",
    "MassSpringNetwork",
    "NetworkError",
    "Parameter",
    "ParameterForces",
    "Stepper",
    "Uncertainty",
    "adaptive",
    "all_positions",
    "at_rest_where_seen",
    "damping_matrix",
    "derivative",
    "four_mass_phantom",
    "independent",
    "kinetic_energy",
    "label",
    "motion",
    "node_forces",
    "pack",
    "parameter_forces",
    "parameter_named",
    "parameters",
    "plain_derivative",
    "plain_step",
    "potential_energy",
    "rest_shape",
    "reversed_springs",
    "scaled",
    "shape_held",
    "stable_step",
    "state_matrix",
    "stiffness_matrix",
    "unpack",
    "value",
]
