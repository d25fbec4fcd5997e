"""Time integration: compiled Runge-Kutta steps, implicit steps, adaptive steps as reference.

Another integrator belongs here.
"""

from dynamics.integration.implicit import DRIVEN, ImplicitStepper, Linearised
from dynamics.integration.plain import plain_derivative, plain_step
from dynamics.integration.stepping import SAME_STEP, Stepper, derivative, integrate_adaptive, motion

__all__ = [
    "DRIVEN",
    "SAME_STEP",
    "ImplicitStepper",
    "Linearised",
    "Stepper",
    "derivative",
    "integrate_adaptive",
    "motion",
    "plain_derivative",
    "plain_step",
]
