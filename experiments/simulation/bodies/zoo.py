"""Names of the simulated bodies, and the functions that create them."""

from __future__ import annotations

from collections.abc import Callable

from experiments.simulation.bodies.body import Body, Scale
from experiments.simulation.bodies.chains import cable, chain
from experiments.simulation.bodies.elastic import block, floating_block, sheet
from experiments.simulation.bodies.phantom import unbraced_phantom

BODIES: dict[str, Callable[[int, Scale, float], Body]] = {
    "chain2": lambda seed, scale, seconds: chain(2, seed, scale, seconds),
    "chain3": lambda seed, scale, seconds: chain(3, seed, scale, seconds),
    "cable-slow": lambda seed, scale, seconds: cable(seed, scale, 0.25, seconds),
    "cable-fast": lambda seed, scale, seconds: cable(seed, scale, 1.0, seconds),
    "sheet": sheet,
    "block27": lambda seed, scale, seconds: block(3, seed, scale, seconds),
    "block64": lambda seed, scale, seconds: block(4, seed, scale, seconds),
    "floating": floating_block,
    "phantom": unbraced_phantom,
}
"""Functions that create a body from a seed, factors on size, stiffness and mass, and the recording's length [s]."""

SECONDS = {"chain2": 4.0, "chain3": 4.0, "cable-slow": 5.0, "cable-fast": 5.0, "phantom": 5.0}
"""Length of a body's recording [s], if it differs from 3 s."""


def make_body(name: str, seed: int, scale: Scale | None = None, seconds: float | None = None) -> Body:
    """Create the body of this name with the motion of this seed; KeyError for an unknown name."""
    length_s = SECONDS.get(name, 3.0) if seconds is None else seconds
    return BODIES[name](seed, Scale() if scale is None else scale, length_s)
