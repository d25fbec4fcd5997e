"""Cases of the zoo: a body, its scale, the kind of constants that the filter assumes, and a seed."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import lru_cache
from typing import Any

import numpy as np

from dynamics import MassSpringNetwork, NetworkError, fit_rest_lengths
from estimators import CovarianceError, FilterSettings, IdentificationError, identify_constants
from estimators.identification.budget import Budget
from experiments.arrays import Floats
from experiments.simulation.bodies.body import Body, Scale
from experiments.simulation.bodies.zoo import BODIES, make_body
from experiments.studies.estimation.trials import Frames, Model, frames_of

CONSTANTS = ("true", "wrong", "identified")
"""Kinds of constants that the filter assumes: the true or best known constants, constants with random errors of 20 %
(1 sd), or constants identified from another recording of the body."""

SCALES = tuple(Scale(**{name: factor}) for name in ("size", "stiffness", "mass") for factor in (0.1, 10.0))

REPORT_SEEDS = range(1000, 1020)
"""Seeds of the table; seeds 0 to 19 are for development."""

N_SCALED = 10
"""Number of seeds of a scaled body."""


@dataclass(frozen=True, slots=True)
class Case:
    """One run of the zoo.

    body: name of the body in `BODIES`; constants: one of `CONSTANTS`
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
        """Factors by which the body's size, stiffness and mass are multiplied."""
        return Scale(self.size, self.stiffness, self.mass)

    @property
    def cell(self) -> str:
        """Name of the case's row: body and scale. If the body is not scaled: body and kind of constants."""
        scaled = [f"{name} x {factor:g}" for name, factor in asdict(self.scale).items() if factor != 1.0]
        return ", ".join([self.body, *(scaled or [self.constants])])

    @property
    def motion(self) -> Body:
        """The moving body, cached, because successive cases have the same motion."""
        return _body(self.body, self.seed, self.scale, self.length_s)

    @classmethod
    def from_json(cls, table: Mapping[str, Any]) -> Case:
        """The case from a row of a table. Columns that are not fields of a case are ignored."""
        return cls(**{field.name: table[field.name] for field in fields(cls) if field.name in table})


@lru_cache(maxsize=2)
def _body(name: str, seed: int, scale: Scale, length_s: float) -> Body:
    return make_body(name, seed, scale, length_s or None)


def cases(bodies: Sequence[str] = tuple(BODIES), seeds: Sequence[int] = REPORT_SEEDS) -> list[Case]:
    """All cases of these bodies with all seeds; scaled bodies have only the first `N_SCALED` seeds."""
    found = []
    for body in bodies:
        found += [Case(body, seed, constants) for seed in seeds for constants in CONSTANTS]
        found += [Case(body, seed, **asdict(scale)) for scale in SCALES for seed in seeds[:N_SCALED]]
    return found


def quick_cases() -> list[Case]:
    """A few cases of one second or less, which test that the study runs."""
    return [
        Case("chain2", 0, length_s=1.0),
        Case("phantom", 0, "wrong", length_s=1.0),
        Case("chain3", 0, length_s=0.5, size=10.0),
    ]


WRONG = float(np.log(1.2))
"""Standard deviation of `log(wrong constant / true constant)`: errors of about 20 %."""

OTHER_RECORDING = 100_000
"""Offset from a case's seed to the seed of its recording for identification."""

BUDGET_S = 12.0
"""Limit of an identification's processor time [s]; the whole zoo then takes an hour on two cores."""


class NotIdentifiedError(Exception):
    """The constants of a case could not be identified. The message gives the reason."""


def assumed(body: Body, case: Case) -> Model:
    """The model that a run of the case assumes; raises NotIdentifiedError."""
    settings = FilterSettings(led_nodes=body.led)
    if case.constants == "true":
        return Model(body.network, settings=settings)
    rng = np.random.default_rng([case.seed, 2])
    return identified(body, case, rng) if case.constants != "wrong" else Model(wrong_network(body, rng), None, settings)


def wrong_network(body: Body, rng: np.random.Generator) -> MassSpringNetwork:
    """The network with each stiffness, damping and mass multiplied by its own random log-normal factor, see `WRONG`.

    If `Body.at_rest`, rest lengths are fitted to the drawn shape.
    """
    network = body.network

    def factors(n: int) -> Floats:
        return np.exp(WRONG * rng.normal(size=n))

    n_springs = len(network.springs)
    wrong = replace(
        network,
        stiffness=network.stiffness * factors(n_springs),
        damping=network.damping * factors(n_springs),
        masses=network.masses * factors(network.n_nodes),
    )
    return fit_rest_lengths(wrong, network.positions) if body.at_rest else wrong


def identified(body: Body, case: Case, rng: np.random.Generator, *, seconds: float = BUDGET_S) -> Model:
    """Model with constants fitted to another recording of the body; raises NotIdentifiedError.

    The recording shows every node. The fit starts from exact masses and from wrong springs: for each kind of
    springs, one random factor multiplies all stiffnesses, and another multiplies all dampings. Rest lengths are fitted.

    seconds: limit of the fit's processor time [s]
    """
    factors = {kind: np.exp(WRONG * rng.normal(size=2)) for kind in dict.fromkeys(_kinds(body))}
    by_spring = np.array([factors[kind] for kind in _kinds(body)])
    start = replace(
        body.network, stiffness=body.network.stiffness * by_spring[:, 0], damping=body.network.damping * by_spring[:, 1]
    )
    if body.at_rest:
        start = fit_rest_lengths(start, body.network.positions)
    other = replace(case, seed=case.seed + OTHER_RECORDING).motion
    frames = measured(other, other.marked + other.hidden, case.seed + OTHER_RECORDING)
    settings = FilterSettings(led_nodes=body.led)
    try:
        found = identify_constants(
            start,
            frames,
            body.marked,
            body.hidden[0],
            spring_groups=body.kinds,
            settings=settings,
            budget=Budget(seconds, time.process_time),
        )
    except (IdentificationError, NetworkError, CovarianceError, np.linalg.LinAlgError) as error:
        raise NotIdentifiedError(f"not identified: {error}") from error
    return Model(found.network, found.uncertainty, settings)


def _kinds(body: Body) -> tuple[str, ...]:
    return body.kinds or tuple(str(spring) for spring in range(len(body.network.springs)))


def measured(body: Body, names: tuple[str, ...], seed: int) -> Frames:
    """Frames with noisy marks of these nodes."""
    rng = np.random.default_rng([seed, 1])
    places = body.positions[:, [body.network.index(name) for name in names]]
    return frames_of(body.times_s, places + rng.normal(0.0, body.mark_sd_m, places.shape), names, body.mark_sd_m)
