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

from dynamics import MassSpringNetwork, ParameterUncertainty, strain_uncertainty
from estimators import FilterSettings, ForceMode, coverage, normalised_error_squared
from estimators.process.linear_motion import TURNED
from estimators.tissue.gate import CROWD
from estimators.tissue.model import STIFFEST
from estimators.tissue.model_error import UNDIRECTED
from estimators.tissue.settings import LED
from experiments.arrays import Floats
from experiments.simulation.bodies.body import Body
from experiments.simulation.bodies.zoo import make_body
from experiments.studies.zoo.constants import Assumed, measured
from experiments.studies.zoo.run import filtered

SEEDS = (5, 6)
BODIES: Mapping[str, float] = {"block27": 1.0, "sheet": 1.0, "cable-slow": 1.0, "cable-fast": 1.0}
"""Bodies and how long each is followed [s]."""


@dataclass(frozen=True, slots=True)
class BodyConstants:
    """Constants of the filter of stiff or large bodies: strain, forces, gate, linearisation.

    strain_sd: strain by which springs may be off, smoothly over the body [1]; choice
    strain_length: over which it changes, by the body's longest side [1]; choice
    strain_directions: of it that are considered, at most [1]; choice
    quiet_white: acceleration noise where nobody pokes [m/s²/sqrt(Hz)]; choice
    poked_white: acceleration noise where somebody pokes [m/s²/sqrt(Hz)]; choice
    led_white: acceleration noise where a hand leads [m/s²/sqrt(Hz)]; choice
    led_poke: acceleration by a hand that leads [m/s²]; choice
    led_lasting_s: correlation time of that [s]; choice
    hidden_share: of a poke, what may act on each node without a mark [1]; choice
    crowd: marks beyond the gate together that are taken, half of a frame's or more [1]; choice
    turned: by so many of the links' lengths may an update move the ends of a body of many states without another pass
        [1]; choice
    stiffest: stiffness of a link by that which the body's weight stretches by strain_sd, at most [1]; choice
    smooth: share of the extent over which displacements that springs do not explain are smooth [1]; choice
    led_inflation: by so much at most innovations inflate the covariance of a simulation led along the marks [1]; choice
    remember_s: for so long innovations that exceed their covariance are remembered, at least [s]; choice
    remember_swings: so many of a body's slowest oscillations they are [1]; choice
    undirected: share by which a covariance is made even that is of an inflation [1]; choice
    """

    strain_sd: float = FilterSettings().strain_sd
    strain_length: float = 1.0
    strain_directions: int = 12
    quiet_white: float = FilterSettings().least_white[0]
    poked_white: float = FilterSettings().least_white[1]
    led_white: float = LED.white
    led_poke: float = LED.poke
    led_lasting_s: float = LED.lasting_s
    hidden_share: float = FilterSettings().hidden_share
    crowd: int = CROWD
    turned: float = TURNED
    stiffest: float = STIFFEST
    smooth: float = FilterSettings().smooth
    led_inflation: float = FilterSettings().led_inflation
    remember_s: float = FilterSettings().remember_s
    remember_swings: float = FilterSettings().remember_swings
    undirected: float = UNDIRECTED


def body_figures(
    constants: BodyConstants, seeds: Sequence[int] = SEEDS, bodies: Mapping[str, float] = BODIES
) -> dict[str, float]:
    """Mean error of the hidden nodes of each body [mm], and the share of them in their 95 % regions.

    Raises ValueError where the filter fails.
    """
    led = ForceMode(constants.led_white, constants.led_poke, constants.led_lasting_s)

    def strain(network: MassSpringNetwork, _sd: float) -> ParameterUncertainty:
        length, n_directions = constants.strain_length, constants.strain_directions
        return strain_uncertainty(network, constants.strain_sd, length=length, n_directions=n_directions)

    settings = partial(
        FilterSettings,
        hidden_share=constants.hidden_share,
        least_white=(constants.quiet_white, constants.poked_white),
        smooth=constants.smooth,
        led_inflation=constants.led_inflation,
        remember_s=constants.remember_s,
        remember_swings=constants.remember_swings,
    )
    found = {}
    with (
        patch("estimators.tissue.model.strain_uncertainty", strain),
        patch("estimators.tissue.model.STIFFEST", constants.stiffest),
        patch("estimators.tissue.settings.LED", led),
        patch("estimators.tissue.gate.CROWD", constants.crowd),
        patch("estimators.tissue.prediction.UNDIRECTED", constants.undirected),
        patch("estimators.process.linear_motion.TURNED", constants.turned),
        patch("experiments.studies.zoo.run.FilterSettings", settings),
    ):
        for name, seconds in bodies.items():
            runs = [_errors(name, seed, seconds) for seed in seeds]
            errors, covs = (np.concatenate(each) for each in zip(*runs, strict=True))
            found[f"{name}_mm"] = 1e3 * float(np.linalg.norm(errors, axis=1).mean())
            found[f"{name}_coverage"] = coverage(normalised_error_squared(errors, covs), errors.shape[1])
    return found


@cache
def _body(name: str, seed: int, seconds: float) -> Body:
    return make_body(name, seed, seconds=seconds)


def _errors(name: str, seed: int, seconds: float) -> tuple[Floats, Floats]:
    """Errors [m], (n, dim), and covariances [m²], (n, dim, dim), of all hidden nodes in all frames."""
    body = _body(name, seed, seconds)
    found = filtered(Assumed(body.network), body, measured(body, body.marked, seed), limit_s=np.inf)
    if found.failure:
        raise ValueError(f"{name}, seed {seed}: {found.failure}")
    errors = found.means - body.positions[:, [body.network.index(node) for node in body.hidden]]
    dim = body.network.dim
    return errors.reshape(-1, dim), found.covs.reshape(-1, dim, dim)
