"""What the constants of identification by the linear filter are worth: stiff and large bodies, truth by MuJoCo.

    python -m experiments.studies.settings.sensitivity --out DIR --only "identification of links"

Constants are found from wrong ones, then judged by another recording of the same body in which only its own marks are
used. The seeds are for development, none that the zoo reports on.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from unittest.mock import patch

import numpy as np

from dynamics import MassSpringNetwork, NetworkError, parameters, scale_parameters
from estimators import (
    IdentificationError,
    IdentificationResult,
    IdentificationSettings,
    coverage,
    identify_constants,
    normalised_error_squared,
)
from estimators.identification.constants import PRIOR_SD, START_SPREAD
from estimators.identification.filter_pass import Frames
from estimators.identification.linear_filter import transition
from experiments.arrays import Floats
from experiments.simulation.bodies.body import Body, Scale
from experiments.simulation.bodies.zoo import make_body
from experiments.studies.settings.constants import constant, constants_in_place
from experiments.studies.zoo.constants import Assumed, measured
from experiments.studies.zoo.run import filtered

KINDS = ("stiffness", "rest_length")

OTHER_RECORDING = 50
"""Added to a seed: the recording on which constants are identified."""

PLACES = {
    "poke_level": "estimators.identification.linear_filter.POKE_LEVEL",
    "turned": "estimators.identification.linear_filter.TURNED",
    "frames_a_period": "estimators.identification.linear_filter.FRAMES_A_PERIOD",
    "rigid_share": "estimators.identification.linear_filter.RIGID_SHARE",
    "rigid_sd": "estimators.identification.groups.RIGID_SD",
    "shortest_step_s": "estimators.identification.filter_pass.SHORTEST_STEP",
    "screened": "estimators.identification.constants.SCREENED",
    "most_passes": "estimators.identification.search.MOST_PASSES",
    "slack": "estimators.identification.search.SLACK",
    "residual_level": "estimators.identification.residuals.LEVEL",
}
"""The module's constant of each name."""


@dataclass(frozen=True, slots=True)
class LinkIdentification:
    """Starts of an identification, and constants at the head of `estimators.identification`'s modules.

    n_starts: points from which the constants are searched, the given ones first [1]; choice
    start_spread: starts are within this of the constants given, in logarithms [1]; choice
    start_spread_lengths: the same of rest lengths [1]; choice
    poke_level: probability of a frame's marks without a poke below which there was one [1]; choice
    turned: change of a spring by its length beyond which the motion is linearised again [1]; choice
    frames_a_period: frames in a period of an oscillation that they show, at least [1]; choice
    rigid_share: share of a spring's motion along itself in such oscillations below which it is rigid [1]; choice
    rigid_sd: prior standard deviation of the logarithm of a rigid link's stiffness [1]; choice
    shortest_step_s: stable step of a network below which the linear filter is taken [s]; choice
    screened: frames through which all starts are followed; the best goes through all [1]; choice
    most_passes: of the filter from a start, at most [1]; choice
    slack: tolerance of the log posterior in the line search for each innovation [1]; choice
    residual_level: probability by which a test calls residuals of a right model unexplained [1]; choice
    """

    n_starts: int = IdentificationSettings().n_starts
    start_spread: float = START_SPREAD["stiffness"]
    start_spread_lengths: float = START_SPREAD["rest_length"]
    poke_level: float = constant(PLACES["poke_level"])
    turned: float = constant(PLACES["turned"])
    frames_a_period: float = constant(PLACES["frames_a_period"])
    rigid_share: float = constant(PLACES["rigid_share"])
    rigid_sd: float = constant(PLACES["rigid_sd"])
    shortest_step_s: float = constant(PLACES["shortest_step_s"])
    screened: int = int(constant(PLACES["screened"]))
    most_passes: int = int(constant(PLACES["most_passes"]))
    slack: float = constant(PLACES["slack"])
    residual_level: float = constant(PLACES["residual_level"])

    @property
    def spread(self) -> dict[str, float]:
        """Of the starts by kind."""
        return dict.fromkeys(START_SPREAD, self.start_spread) | {"rest_length": self.start_spread_lengths}


@dataclass(frozen=True, slots=True)
class Recorded:
    """A body of the zoo, and how it is recorded for identification.

    seconds: of the recording [s]; judged_s: of the other one, by which what is found is judged [s]
    stiffness: factor on its springs, in the truth, too
    seldom: whether hidden nodes are seen in the middle frame only, and all starts count
    wrong: whether constants are wrong at first; true: kinds of constants that the truth has, too
    """

    body: str
    seeds: tuple[int, ...]
    seconds: float
    judged_s: float
    stiffness: float = 1.0
    seldom: bool = False
    wrong: bool = True
    true: tuple[str, ...] = ("rest_length",)


RECORDINGS: Mapping[str, Recorded] = {
    "links": Recorded("chain2", (31, 32), 1.2, 1.5),
    "three": Recorded("chain3", (31, 32), 0.6, 1.0),
    "seldom": Recorded("chain2", (31, 32), 0.6, 1.5, seldom=True),
    "springs": Recorded("chain2", (31, 32), 0.6, 1.5, stiffness=0.5, wrong=False, true=KINDS),
    "cable": Recorded("cable-slow", (31, 32, 33), 0.7, 0.7, wrong=False, true=()),
    "gel": Recorded("block27", (31,), 0.7, 0.7, stiffness=0.1, wrong=False, true=()),
}
"""Two and three links, of which frames show no oscillation and one; links seen seldom; springs that frames half show;
two bodies of many nodes, one that turns and one that wobbles."""


@cache
def _motion(recorded: Recorded, seed: int, seconds: float) -> Body:
    return make_body(recorded.body, seed, Scale(stiffness=recorded.stiffness), seconds)


def _judged(recorded: Recorded, seed: int) -> Body:
    return _motion(recorded, seed, recorded.judged_s)


def _wrong(recorded: Recorded, seed: int) -> MassSpringNetwork:
    """The body's network, with constants drawn from the prior where they are wrong at first."""
    body, rng = _judged(recorded, seed), np.random.default_rng([seed, 3])
    if not recorded.wrong:
        return body.network
    which = parameters(body.network, KINDS)
    change = rng.normal(0.0, [PRIOR_SD[one.kind] for one in which])
    return scale_parameters(body.network, which, change)


def recorded_frames(recorded: Recorded, seed: int) -> Frames:
    """Of another recording of the body, all nodes seen, or hidden ones in the middle frame only."""
    body = _motion(recorded, seed + OTHER_RECORDING, recorded.seconds)
    middle = len(body.times_s) // 2
    seen = measured(body, body.marked + body.hidden, seed)
    return [
        (float(time_s), [mark for mark in marks if mark.node in body.marked or k == middle or not recorded.seldom])
        for k, (time_s, marks) in enumerate(zip(body.times_s, seen, strict=True))
    ]


def identified(choices: LinkIdentification, recorded: Recorded, seed: int) -> IdentificationResult:
    """What is found from wrong constants."""
    body = _judged(recorded, seed)
    with (
        constants_in_place(choices, PLACES),
        patch("estimators.identification.constants.START_SPREAD", choices.spread),
    ):
        return identify_constants(
            _wrong(recorded, seed),
            recorded_frames(recorded, seed),
            body.marked,
            body.hidden[0],
            prior_sd={kind: PRIOR_SD[kind] for kind in KINDS},
            spring_groups=body.kinds,
            search=IdentificationSettings(n_starts=choices.n_starts if recorded.seldom else 1),
        )


def scaled_errors(recorded: Recorded, seed: int, found: IdentificationResult, kind: str) -> Floats:
    """Errors of the logarithms of the constants of a kind, and these by their standard errors, (2, n)."""
    true, network = _judged(recorded, seed).network, found.network
    places = [group.places[0] for group in found.groups if group.kind == kind]
    factors = network.stiffness / true.stiffness if kind == "stiffness" else network.rest_lengths / true.rest_lengths
    errors = np.log(factors[places])
    return np.array([errors, errors / found.sd[[group.kind == kind for group in found.groups]]])


def hidden_errors(recorded: Recorded, seed: int, found: IdentificationResult) -> tuple[Floats, Floats] | None:
    """Errors of the hidden nodes [m], (n, dim), and NEES, (n,), their marks not used; None where the filter fails."""
    body = _judged(recorded, seed)
    run = filtered(Assumed(found.network, found.uncertainty), body, measured(body, body.marked, seed), limit_s=np.inf)
    if run.failure:
        return None
    dim = body.network.dim
    errors = (run.means - body.positions[:, [body.network.index(name) for name in body.hidden]]).reshape(-1, dim)
    return errors, normalised_error_squared(errors, run.covs.reshape(-1, dim, dim))


def link_figures(choices: LinkIdentification, recordings: Mapping[str, Recorded] = RECORDINGS) -> dict[str, float]:
    """Of each recording by its name: errors and coverage of constants found, and of hidden nodes on another recording.

    _found: share of the seeds in which constants are found with which the filter runs; the others are figures of these
    _linearised: how often the motion is linearised for a seed [1], a measure of time
    _lengths, _stiffness: rms error of rest lengths and stiffnesses [%]; _z: the same by their standard errors [1]
    _mm: median error of hidden nodes, their marks not used [mm]; _covered: share of them in their 95 % regions
    """
    figures: dict[str, float] = {}
    for name, recorded in recordings.items():
        errors: dict[str, list[Floats]] = {kind: [] for kind in recorded.true}
        hidden = []
        with patch("estimators.identification.linear_filter.transition", wraps=transition) as linearised:
            for seed in recorded.seeds:
                try:
                    found = identified(choices, recorded, seed)
                except (IdentificationError, NetworkError):
                    continue
                if (unseen := hidden_errors(recorded, seed, found)) is not None:
                    hidden.append(unseen)
                    for kind, of_kind in errors.items():
                        of_kind.append(scaled_errors(recorded, seed, found, kind))
        figures[f"{name}_found"] = len(hidden) / len(recorded.seeds)
        figures[f"{name}_linearised"] = linearised.call_count / len(recorded.seeds)
        if hidden:
            figures |= {f"{name}_{key}": value for key, value in _of_found(errors, hidden).items()}
    return figures


def _of_found(errors: Mapping[str, Sequence[Floats]], hidden: Sequence[tuple[Floats, Floats]]) -> dict[str, float]:
    """Figures of the seeds in which constants are found."""
    labels = {"rest_length": "lengths", "stiffness": "stiffness"}
    figures = {labels[kind]: 100.0 * _rms([one[0] for one in of_kind]) for kind, of_kind in errors.items()}
    if errors:
        figures["z"] = _rms([one[1] for of_kind in errors.values() for one in of_kind])
    unseen, nees = (np.concatenate(each) for each in zip(*hidden, strict=True))
    distances = np.linalg.norm(unseen, axis=1)
    return figures | {"mm": 1e3 * float(np.median(distances)), "covered": coverage(nees, unseen.shape[1])}


def _rms(values: Sequence[Floats]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(values) ** 2)))
