"""Simulated worlds: truth and films of scenarios, a camera before the phantom, closed-loop insertion.

What may enter: what makes truth. No filter is scored here.
"""

from experiments.simulation.phantom_camera import PhantomCamera
from experiments.simulation.simulate import draw, scene_of

__all__ = ["PhantomCamera", "draw", "scene_of"]
