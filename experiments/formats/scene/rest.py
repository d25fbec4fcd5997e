"""Test whether a network's rest shape is near the drawn shape. If not, guess which key has a wrong unit.

Masses in g and stiffnesses in N/mm change the rest shape equally, because it depends on the ratio of weight to
stiffness. Therefore the density, computed from masses and distances, shows which unit is wrong.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dynamics import MassSpringNetwork, NetworkError, node_forces, rest_shape, spring_lengths
from experiments.arrays import Floats
from experiments.errors import shown
from experiments.formats.scene.schema import SceneError

UNIT = 30.0
"""If a number is UNIT times too large or too small, its unit is wrong; choice: units differ by 100 or 1000."""

BALANCED = 0.05
"""Springs balance the weight if at most this share of the weight remains unbalanced; choice: lengths are rounded."""

LONGEST = 2.0
"""A spring counts as stretched if its length in the rest shape is this many times its unloaded length; choice."""

DENSITY = 100.0
"""A plausible density [kg/m³], in the sense of `mass of a node / (length of a spring)³`. Choice: tissue has 1000 kg/m³,
and a phantom has less."""

GRAVITY = 9.81
"""Acceleration of gravity [m/s²]."""

UNITS = {
    ("mass_kg", 3): "g",
    ("mass_kg", -3): "t",
    ("stiffness_N_m", 3): "N/mm",
    ("stiffness_N_m", 2): "N/cm",
    ("stiffness_N_m", -3): "mN/m",
    ("gravity_m_s2", 3): "mm/s²",
    ("gravity_m_s2", 2): "cm/s²",
    ("position_mm", 3): "m",
    ("position_mm", -3): "µm",
}
"""Probable unit of a key's numbers if springs are 10**n times too soft. Each index is a pair: the key, and n."""


NO_REST = "braces, stiffer springs or anchors would hold it"


def check_rest(network: MassSpringNetwork) -> None:
    """Raise SceneError if a network's rest shape is far from the drawn shape, or if a key seems to have a wrong unit.

    Raises NetworkError if there is no rest shape for another reason.
    """
    if network.continuum is not None:
        return
    lengths = spring_lengths(network.positions, network.springs)
    for s, ratio in enumerate(network.rest_lengths / lengths):
        if not 1.0 / UNIT < ratio < UNIT:
            raise SceneError(
                f"network.spring[{s}].rest_length_mm: expected about the distance drawn, {1e3 * lengths[s]:.4g} mm,"
                f" found {1e3 * network.rest_lengths[s]:.4g}; are both in mm?"
            )
    still, weightless = np.zeros_like(network.positions), replace(network, gravity=np.zeros(network.dim))
    springs = node_forces(weightless, network.positions, still)[network.free]
    weight = network.masses[network.free, None] * network.gravity
    heavy = bool(network.fixed.any() and weight.any())  # a body without anchors is supported at its marks
    if heavy and _is_unit(lacking := _lacking(springs, weight)):
        raise SceneError(_suspect(network, lacking))
    if (fault := _fault(network)) is not None:
        if heavy and _fault(replace(network, stiffness=1e3 * network.stiffness)) is None:
            raise SceneError(_suspect(network, 1e3))
        raise fault


def _is_unit(factor: float) -> bool:
    return factor > 0 and not 1.0 / UNIT < factor < UNIT


def _lacking(springs: Floats, weight: Floats) -> float:
    """Factor on all stiffnesses that makes springs balance the weight in the drawn shape; 1 if no factor does this."""
    largest, heaviest = np.abs(springs).max(), np.abs(weight).max()
    if largest == 0.0:
        return 1.0
    f, w = springs / largest, weight / heaviest  # scaled to avoid overflow
    factor = -float(np.vdot(f, w) / np.vdot(f, f))
    balanced = np.linalg.norm(factor * f + w) <= BALANCED * np.linalg.norm(w)
    return float(factor * (heaviest / largest)) if balanced else 1.0


def _fault(network: MassSpringNetwork) -> ValueError | None:
    """The error if the rest shape is far from the drawn shape and springs are stretched; otherwise None."""
    try:
        with np.errstate(all="ignore"):  # overflow means no rest
            rest = rest_shape(network)
    except NetworkError as error:
        return NetworkError(f"network: {error}; {NO_REST}")
    except (ValueError, ArithmeticError) as error:  # numbers so large that they overflow
        return SceneError(f"network: rest shape: expected constants without overflow, found {shown(str(error))}")
    off = np.linalg.norm(rest - network.positions, axis=1)
    size_m = np.linalg.norm(np.ptp(network.positions, axis=0))
    stretched = (spring_lengths(rest, network.springs) / network.rest_lengths).max() > LONGEST
    if not (stretched and off.max() > size_m):
        return None
    return SceneError(
        f"network: expected a rest shape within one body size ({1e3 * size_m:.4g} mm) of the drawing,"
        f" found {shown(network.names[int(off.argmax())])} {1e3 * off.max():.4g} mm away"
    )


def _suspect(network: MassSpringNetwork, lacking: float) -> str:
    """Message that names the key whose unit is probably wrong. The stiffness is too small by the factor `lacking`."""
    first = int(network.free[0])
    length_m = np.median(spring_lengths(network.positions, network.springs))
    density, factor = np.median(network.masses[network.free]) / length_m**3, np.log(lacking)
    # power with which the unit of each key enters the density
    powers = {"stiffness_N_m": 0, "mass_kg": 1, "position_mm": 3}
    key = min(powers, key=lambda key: abs(np.log(density / DENSITY) - powers[key] * factor))
    if _is_unit(float(np.linalg.norm(network.gravity)) / GRAVITY):
        key = "gravity_m_s2"
    place, value = {
        "stiffness_N_m": ("network.spring[0].stiffness_N_m", float(network.stiffness[0])),
        "mass_kg": (f"network.node[{first}].mass_kg", float(network.masses[first])),
        "position_mm": (f"network.node[{first}].position_mm", (1e3 * network.positions[first]).round(9).tolist()),
        "gravity_m_s2": ("network.gravity_m_s2", network.gravity.tolist()),
    }[key]
    unit = UNITS.get((key, round(np.log10(lacking))), "another unit")
    times = f"{_rounded(lacking)} times too soft" if lacking > 1 else f"{_rounded(1 / lacking)} times too stiff"
    return (
        f"{place}: expected springs that balance the weight near the network's drawing,"
        f" found {shown(value)}, with which they are {times}; in {unit}?"
    )


def _rounded(factor: float) -> str:
    return f"{float(f'{factor:.3g}'):g}"
