"""Cases of the zoo: a body, the assumed constants, a scale of the body, and a seed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Any

from experiments.simulation.bodies.body import Body, Scale
from experiments.simulation.bodies.zoo import BODIES, make_body

CONSTANTS = ("true", "wrong", "identified")
"""Kinds of constants that a run assumes: best-known, with random errors of 20 % (1 sd), or identified from another
recording of the body."""

SCALES = tuple(Scale(**{name: factor}) for name in ("size", "stiffness", "mass") for factor in (0.1, 10.0))

REPORT_SEEDS = range(1000, 1020)
"""Seeds of the table; seeds 0 to 19 are for development."""

N_SCALED = 10
"""Number of seeds of a scaled body."""


@dataclass(frozen=True, slots=True)
class Case:
    """One run of the zoo.

    body: its name in `BODIES`; constants: one of `CONSTANTS`
    length_s: length of the recording [s], 0 for the body's default
    """

    body: str
    seed: int
    constants: str = "true"
    size: float = 1.0
    stiffness: float = 1.0
    mass: float = 1.0
    length_s: float = 0.0

    @property
    def scale(self) -> Scale:
        """Factors on the body's size, stiffness and mass."""
        return Scale(self.size, self.stiffness, self.mass)

    @property
    def cell(self) -> str:
        """The name of the case's cell in the table: body, scale or constants, without the seed."""
        factors = {"size": self.size, "stiffness": self.stiffness, "mass": self.mass}
        scaled = [f"{name} x {factor:g}" for name, factor in factors.items() if factor != 1.0]
        return ", ".join([self.body, *(scaled or [self.constants])])

    @property
    def motion(self) -> Body:
        """The moving body, cached for the next cases with the same motion."""
        return _body(self.body, self.seed, self.scale, self.length_s)

    @classmethod
    def from_json(cls, table: Mapping[str, Any]) -> Case:
        """The case from a row of a table; columns that are no field of a case are ignored."""
        return cls(**{field.name: table[field.name] for field in fields(cls) if field.name in table})


@lru_cache(maxsize=2)
def _body(name: str, seed: int, scale: Scale, length_s: float) -> Body:
    return make_body(name, seed, scale, length_s or None)


def cases(bodies: Sequence[str] = tuple(BODIES), seeds: Sequence[int] = REPORT_SEEDS) -> list[Case]:
    """All cases of these bodies with all seeds; scaled bodies have only the first `N_SCALED` seeds."""
    found = []
    for body in bodies:
        found += [Case(body, seed, constants) for seed in seeds for constants in CONSTANTS]
        found += [
            Case(body, seed, size=scale.size, stiffness=scale.stiffness, mass=scale.mass)
            for scale in SCALES
            for seed in seeds[:N_SCALED]
        ]
    return found


def quick_cases() -> list[Case]:
    """A few bodies for a second or less, for a test of all steps."""
    return [
        Case("chain2", 0, length_s=1.0),
        Case("phantom", 0, "wrong", length_s=1.0),
        Case("chain3", 0, length_s=0.5, size=10.0),
    ]
