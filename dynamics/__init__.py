"""The tissue: nodes, springs, forces, energy, time integration and rest shapes."""

from dynamics.forces import kinetic_energy, node_forces, potential_energy
from dynamics.network import MassSpringNetwork, NetworkError, all_positions, pack, unpack
from dynamics.phantom import HIDDEN, OUTER, four_mass_phantom
from dynamics.plain import plain_derivative, plain_step
from dynamics.rest import rest_shape, shape_held
from dynamics.stepping import Stepper, adaptive, derivative
from dynamics.tangent import damping_matrix, stable_step, state_matrix, stiffness_matrix

__all__ = [
    "HIDDEN",
    "OUTER",
    "MassSpringNetwork",
    "NetworkError",
    "Stepper",
    "adaptive",
    "all_positions",
    "damping_matrix",
    "derivative",
    "four_mass_phantom",
    "kinetic_energy",
    "node_forces",
    "pack",
    "plain_derivative",
    "plain_step",
    "potential_energy",
    "rest_shape",
    "shape_held",
    "stable_step",
    "state_matrix",
    "stiffness_matrix",
    "unpack",
]
