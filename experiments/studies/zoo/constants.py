"""The constants of a body that a run assumes: best-known, 20 % wrong, or identified."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dynamics import MassSpringNetwork, NetworkError, fit_rest_lengths
from estimators import IdentificationError, MarkMeasurement, identify_constants
from experiments.arrays import Floats
from experiments.simulation.bodies.body import Body
from experiments.studies.zoo.case import Case

WRONG = float(np.log(1.2))
"""Standard deviation of the logarithm of a wrong constant."""

OTHER_RECORDING = 100_000
"""Added to a seed: the recording on which constants are identified."""

MOST_SPRINGS = 10
"""Networks of more springs are not identified: with a sensitivity for each constant that takes minutes."""


class NotIdentifiedError(Exception):
    """Constants could not be found; the message gives the reason."""


def network_of(body: Body, case: Case) -> MassSpringNetwork:
    """The body's network with the constants of the case; raises NotIdentifiedError."""
    if case.constants == "true":
        return body.network
    wrong = wrong_network(body, np.random.default_rng([case.seed, 2]))
    return wrong if case.constants == "wrong" else identified_network(wrong, case)


def wrong_network(body: Body, rng: np.random.Generator) -> MassSpringNetwork:
    """Each stiffness, dashpot and mass by its own factor, log-normal, 20 % one standard deviation.

    Where the body is drawn at rest, rest lengths are made to fit as a user would, from the drawing.
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


def identified_network(start: MassSpringNetwork, case: Case) -> MassSpringNetwork:
    """Constants fitted from `start` on another recording of the same body, every node seen; NotIdentifiedError."""
    if len(start.springs) > MOST_SPRINGS:
        raise NotIdentifiedError(f"not identified: {len(start.springs)} springs, at most {MOST_SPRINGS}")
    body = replace(case, seed=case.seed + OTHER_RECORDING).motion
    names = body.marked + body.hidden
    frames = [(float(t), marks) for t, marks in zip(body.times_s, measured(body, names, case.seed), strict=True)]
    try:
        return identify_constants(start, frames, body.marked, body.hidden[0]).network
    except (IdentificationError, NetworkError, np.linalg.LinAlgError) as error:
        raise NotIdentifiedError(f"not identified: {error}") from error


def measured(body: Body, names: tuple[str, ...], seed: int) -> list[list[MarkMeasurement]]:
    """Noisy marks of these nodes, frame by frame."""
    rng = np.random.default_rng([seed, 1])
    nodes = [body.network.index(name) for name in names]
    noisy = body.positions[:, nodes] + rng.normal(0.0, body.mark_sd_m, body.positions[:, nodes].shape)
    cov = body.mark_sd_m**2 * np.eye(body.network.dim)
    return [[MarkMeasurement(name, place, cov) for name, place in zip(names, frame, strict=True)] for frame in noisy]
