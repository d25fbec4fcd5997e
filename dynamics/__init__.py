"""The tissue: nodes, springs, forces, energy, time integration and rest shapes.

Names to start with:

    four_mass_phantom     the paper's phantom, a network ready to use
    build_network         a network from names, positions and edges
    MassSpringNetwork     nodes and springs, checked
    rest_shape            where a network rests
    fit_rest_lengths      rest lengths from a picture of the network at rest
    node_forces           forces on all nodes
    potential_energy      of which forces are minus the gradient
    stiffness_matrix      the tangent of the forces
    stable_step           the longest stable time step
    Stepper               fast fixed steps, for filters
    integrate_adaptive    slow exact motion, for truths
    pack, unpack          state vectors to and from positions and velocities
"""

from dynamics.equilibrium import (
    build_network,
    carried,
    elbow_parts,
    equilibrium_with_fixed,
    fit_rest_lengths,
    inverted_springs,
    mirror_through,
    mirrored_shapes,
    reaches,
    rest_shape,
)
from dynamics.forces import (
    KINDS,
    LAWS,
    OF_SPRINGS,
    SLIP_VELOCITY,
    Parameter,
    ParameterForces,
    ParameterUncertainty,
    damping_matrix,
    independent_uncertainty,
    kinetic_energy,
    node_forces,
    parameter_forces,
    parameter_label,
    parameter_named,
    parameter_value,
    parameters,
    potential_energy,
    scale_parameters,
    stable_step,
    state_matrix,
    stiffness_matrix,
    strain_uncertainty,
)
from dynamics.integration import (
    SAME_STEP,
    ImplicitStepper,
    Stepper,
    derivative,
    integrate_adaptive,
    motion,
    plain_derivative,
    plain_step,
)
from dynamics.needle import (
    GAUGES_MM,
    SHAFT,
    InsertionHistory,
    NeedleLoad,
    NeedleMechanics,
    NeedleMotion,
    NeedlePose,
    SampledForces,
    advance_steered,
    distributed_force,
    force_on_free,
    forced_states,
    indentation,
    needle_load,
    node_weights,
    simulate_insertion,
    sliding_friction,
    straight_insertion,
)
from dynamics.network import MassSpringNetwork, NetworkError, all_positions, pack, unpack
from dynamics.phantoms import HIDDEN, OUTER, four_mass_phantom

__all__ = [
    "GAUGES_MM",
    "HIDDEN",
    "KINDS",
    "LAWS",
    "OF_SPRINGS",
    "OUTER",
    "SAME_STEP",
    "SHAFT",
    "SLIP_VELOCITY",
    "ImplicitStepper",
    "InsertionHistory",
    "MassSpringNetwork",
    "NeedleLoad",
    "NeedleMechanics",
    "NeedleMotion",
    "NeedlePose",
    "NetworkError",
    "Parameter",
    "ParameterForces",
    "ParameterUncertainty",
    "SampledForces",
    "Stepper",
    "advance_steered",
    "all_positions",
    "build_network",
    "carried",
    "damping_matrix",
    "derivative",
    "distributed_force",
    "elbow_parts",
    "equilibrium_with_fixed",
    "fit_rest_lengths",
    "force_on_free",
    "forced_states",
    "four_mass_phantom",
    "indentation",
    "independent_uncertainty",
    "integrate_adaptive",
    "inverted_springs",
    "kinetic_energy",
    "mirror_through",
    "mirrored_shapes",
    "motion",
    "needle_load",
    "node_forces",
    "node_weights",
    "pack",
    "parameter_forces",
    "parameter_label",
    "parameter_named",
    "parameter_value",
    "parameters",
    "plain_derivative",
    "plain_step",
    "potential_energy",
    "reaches",
    "rest_shape",
    "scale_parameters",
    "simulate_insertion",
    "sliding_friction",
    "stable_step",
    "state_matrix",
    "stiffness_matrix",
    "straight_insertion",
    "strain_uncertainty",
    "unpack",
]
