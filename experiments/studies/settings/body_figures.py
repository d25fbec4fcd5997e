"""What the constants of stiff, slender and large bodies are worth: the filter on bodies of the zoo, truth by MuJoCo.

    python -m experiments.studies.settings.sensitivity --out DIR --only "stiff or large bodies"

The seeds are for development, none that the zoo reports on.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from unittest.mock import patch

import numpy as np

from dynamics import strain_uncertainty
from estimators import FilterSettings, ForceMode, TissueFilter, coverage, normalised_error_squared
from estimators.process.target import target_map
from estimators.tissue.gate import CROWD
from estimators.tissue.settings import LED, POKED_WHITE, QUIET_WHITE
from experiments.arrays import Floats
from experiments.simulation.bodies.body import Body
from experiments.simulation.bodies.zoo import make_body
from experiments.studies.zoo.constants import measured

SEEDS = (5, 6)
BODIES: Mapping[str, float] = {"chain2": 2.0, "block27": 1.0, "cable-slow": 1.0, "cable-fast": 1.0}
"""Bodies and how long each is followed [s]."""


@dataclass(frozen=True, slots=True)
class BodyConstants:
    """Constants at the head of `estimators.tissue.settings` and `estimators.tissue.gate`, and those of the strain.

    strain_sd: strain by which springs may be off, smoothly over the body [1]; choice
    strain_length: over which it changes, by the body's longest side [1]; choice
    strain_directions: of it that are considered, at most [1]; choice
    quiet_white, poked_white: acceleration noise where nobody pokes, and where somebody does [m/s²/sqrt(Hz)]; choice
    led_white: acceleration noise where a hand leads [m/s²/sqrt(Hz)]; choice
    led_poke: acceleration by a hand that leads [m/s²]; choice
    led_lasting_s: correlation time of that [s]; choice
    crowd: marks beyond the gate together that are taken, half of a frame's or more [1]; choice
    """

    strain_sd: float = FilterSettings().strain_sd
    strain_length: float = 1.0
    strain_directions: int = 12
    quiet_white: float = QUIET_WHITE
    poked_white: float = POKED_WHITE
    led_white: float = LED.white
    led_poke: float = LED.poke
    led_lasting_s: float = LED.lasting_s
    crowd: int = CROWD


def body_figures(
    constants: BodyConstants, seeds: Sequence[int] = SEEDS, bodies: Mapping[str, float] = BODIES
) -> dict[str, float]:
    """Mean error of the hidden nodes of each body [mm], and the share of them in their 95 % regions."""
    strain = partial(strain_uncertainty, length=constants.strain_length, n_directions=constants.strain_directions)
    found = {}
    with (
        patch("estimators.tissue.filter.strain_uncertainty", strain),
        patch("estimators.tissue.settings.QUIET_WHITE", constants.quiet_white),
        patch("estimators.tissue.settings.POKED_WHITE", constants.poked_white),
        patch("estimators.tissue.settings.LED", _led(constants)),
        patch("estimators.tissue.gate.CROWD", constants.crowd),
    ):
        for name, seconds in bodies.items():
            runs = [_followed(name, seed, seconds, constants.strain_sd) for seed in seeds]
            errors, covs = (np.concatenate(each) for each in zip(*runs, strict=True))
            found[f"{name}_mm"] = 1e3 * float(np.linalg.norm(errors, axis=1).mean())
            found[f"{name}_coverage"] = coverage(normalised_error_squared(errors, covs), errors.shape[1])
    return found


def _led(constants: BodyConstants) -> ForceMode:
    return ForceMode(constants.led_white, constants.led_poke, constants.led_lasting_s)


@cache
def _body(name: str, seed: int, seconds: float) -> Body:
    return make_body(name, seed, seconds=seconds)


def _followed(name: str, seed: int, seconds: float, strain_sd: float) -> tuple[Floats, Floats]:
    """Errors [m], (n, dim), and covariances of all hidden nodes in all frames."""
    body = _body(name, seed, seconds)
    network = body.network
    tissue = TissueFilter(network, body.hidden[0], body.marked, FilterSettings(strain_sd=strain_sd))
    maps = [target_map(network, node) for node in body.hidden]
    truth = body.positions[:, [network.index(node) for node in body.hidden]]
    means, covs = [], []
    for time_s, marks in zip(body.times_s, measured(body, body.marked, seed), strict=True):
        tissue.predict(float(time_s))
        tissue.update(marks)
        means.append([each.position(tissue.mixture.x) for each in maps])
        covs.append([each.cov(tissue.mixture.P) for each in maps])
    errors = np.array(means) - truth
    dim = errors.shape[2]
    return errors.reshape(-1, dim), np.array(covs).reshape(-1, dim, dim)
