"""Needle mechanics: forces of contact, cutting and friction.

Mechanics belong here, hit probabilities do not.
"""

from dynamics.needle.insertion import InsertionHistory, force_on_free, forced_states, simulate_insertion
from dynamics.needle.loads import (
    GAUGES_MM,
    SHAFT,
    NeedleLoad,
    NeedleMechanics,
    NeedlePose,
    distributed_force,
    indentation,
    needle_load,
    node_weights,
    straight_insertion,
)
from dynamics.needle.steered import NeedleMotion, SampledForces, advance_steered, sliding_friction, steady_state

__all__ = [
    "GAUGES_MM",
    "SHAFT",
    "InsertionHistory",
    "NeedleLoad",
    "NeedleMechanics",
    "NeedleMotion",
    "NeedlePose",
    "SampledForces",
    "advance_steered",
    "distributed_force",
    "force_on_free",
    "forced_states",
    "indentation",
    "needle_load",
    "node_weights",
    "simulate_insertion",
    "sliding_friction",
    "steady_state",
    "straight_insertion",
]
