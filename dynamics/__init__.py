"""The tissue: nodes, springs, forces, energy, time integration and rest shapes."""

from dynamics.forces import kinetic_energy, node_forces, potential_energy
from dynamics.insertion import Insertion, force_on_free, insert_needle, pushed_states
from dynamics.kernels import SLIP_VELOCITY
from dynamics.needle import (
    GAUGES_MM,
    SHAFT,
    Needle,
    NeedleLoad,
    Pose,
    dent,
    needle_load,
    shared_force,
    shares,
    straight_insertion,
)
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
from dynamics.steered import Drive, Knots, sliding_forces, steered
from dynamics.stepping import SAME_STEP, Stepper, adaptive, derivative, motion
from dynamics.tangent import damping_matrix, stable_step, state_matrix, stiffness_matrix

__all__ = [
    "GAUGES_MM",
    "HIDDEN",
    "KINDS",
    "OUTER",
    "SAME_STEP",
    "SHAFT",
    "SLIP_VELOCITY",
    "Drive",
    "Insertion",
    "Knots",
    "MassSpringNetwork",
    "Needle",
    "NeedleLoad",
    "NetworkError",
    "Parameter",
    "ParameterForces",
    "Pose",
    "Stepper",
    "Uncertainty",
    "adaptive",
    "all_positions",
    "at_rest_where_seen",
    "damping_matrix",
    "dent",
    "derivative",
    "force_on_free",
    "four_mass_phantom",
    "independent",
    "insert_needle",
    "kinetic_energy",
    "label",
    "motion",
    "needle_load",
    "node_forces",
    "pack",
    "parameter_forces",
    "parameter_named",
    "parameters",
    "plain_derivative",
    "plain_step",
    "potential_energy",
    "pushed_states",
    "rest_shape",
    "reversed_springs",
    "scaled",
    "shape_held",
    "shared_force",
    "shares",
    "sliding_forces",
    "stable_step",
    "state_matrix",
    "steered",
    "stiffness_matrix",
    "straight_insertion",
    "unpack",
    "value",
]
