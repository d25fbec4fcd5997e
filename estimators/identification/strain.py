"""Estimation of a model's discrepancy, which is the relative error of its displacements, from a recording."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynamics import MassSpringNetwork, ParameterUncertainty
from dynamics.threads import one_blas_thread
from estimators.arrays import Floats
from estimators.core.track import TissueFilter
from estimators.identification.budget import Budget, OutOfTimeError, Progress, TooShortError, Workers
from estimators.identification.filter_pass import Frames
from estimators.identification.stretch import affordable, frame_seconds, from_first_marks
from estimators.tissue.settings import FilterSettings

STRAINS = (0.002, 0.003, 0.01, 0.03)
"""Values of the model's discrepancy that are compared, relative to the body's extent [1]; choice."""

UNSEEN = 0.003
"""Lower limit of the discrepancy if the constants were not identified [1]; measured: docs/filter.md. The marks do not
show how well such a model predicts the target."""

REFUTED = 3.0
"""A discrepancy is rejected if its log likelihood is below the largest log likelihood by more than this [1]; choice."""


@dataclass(frozen=True, slots=True, eq=False)
class TuningResult:
    """Estimated discrepancy of a model.

    settings: the given settings, with the estimated discrepancy
    names: always ("strain",); values: the estimated discrepancy [1], (1,)
    strains, log_likelihoods: compared discrepancies [1], and the log likelihood of each, (n,)
    log_likelihood, log_likelihood_before: log likelihood of the estimated, and of the given discrepancy
    n_frames: number of used frames; in_time: False if the time was too short for all frames and passes
    """

    settings: FilterSettings
    names: tuple[str, ...]
    values: Floats
    strains: Floats
    log_likelihoods: Floats
    log_likelihood: float
    log_likelihood_before: float
    n_frames: int
    in_time: bool


@dataclass(frozen=True, slots=True)
class _Passes:
    """Function from a discrepancy to its log likelihood, see `tune_strain`."""

    network: MassSpringNetwork
    nodes: tuple[Sequence[str], str]
    uncertainty: ParameterUncertainty | None
    settings: FilterSettings
    frames: Frames
    budget: Budget

    def __call__(self, strain: float | None) -> float:
        marked, target = self.nodes
        settings = replace(self.settings, discrepancy=strain)
        tissue = TissueFilter(self.network, target, marked, settings, uncertainty=self.uncertainty)
        total = 0.0
        with one_blas_thread():
            for time_s, marks in self.frames:
                self.budget.check()
                started = tissue.seen_s is not None
                tissue.predict(time_s)
                if tissue.update(marks).marks_used and started:
                    total += tissue.level.log_withheld
        return total


def tune_strain(
    network: MassSpringNetwork,
    frames: Frames,
    marked: Sequence[str],
    target: str,
    *,
    uncertainty: ParameterUncertainty | None = None,
    settings: FilterSettings | None = None,
    is_identified: bool = False,
    budget: Budget | None = None,
    workers: Workers = map,
    advance: Callable[[float], None] = lambda _share: None,
) -> TuningResult:
    """Estimate a model's discrepancy from a recording: the largest value of `STRAINS` that the marks do not reject.

    The log likelihood is the sum of the log densities of all marks, each given the other marks of its frame. This sum
    shows how well the marks predict a hidden position. The joint density of all marks would hardly show this.

    frames: (time [s], marks) in order; marked: the nodes whose marks are used
    uncertainty: uncertainty of the constants; budget: time limit
    is_identified: whether the constants were estimated from this tissue; if False, the result is at least `UNSEEN`
    workers: `map`, or the map function of a pool of processes; advance: called with the completed share of the work
    Raises IdentificationError if the time is too short for any result.
    """
    before, limit = settings or FilterSettings(), budget or Budget()
    strains = [strain for strain in STRAINS if is_identified or strain >= UNSEEN]
    frames = from_first_marks([(time_s, [mark for mark in marks if mark.node in marked]) for time_s, marks in frames])
    passes = _Passes(network, (tuple(marked), target), uncertainty, before, frames, limit)
    n = len(strains) + 1
    try:
        frame_s = frame_seconds(lambda some: replace(passes, frames=some)(strains[0]), frames, limit)
        used, found = affordable(frames, frame_s, n, limit), list[float]()
        progress = Progress(n * len(used), advance)
        counted = replace(passes, frames=used, budget=limit.watched(progress.frame))
        for one in workers(counted, [before.discrepancy, *strains]):
            found.append(one)
            progress.passes(len(used))
    except OutOfTimeError:
        raise TooShortError(limit) from None
    logs: Floats = np.array(found[1:])
    best = int(np.flatnonzero(logs >= logs.max() - REFUTED)[-1])
    return TuningResult(
        replace(before, discrepancy=strains[best]),
        ("strain",),
        np.array([strains[best]]),
        np.array(strains),
        logs,
        float(logs[best]),
        found[0],
        len(used),
        len(used) == len(frames),
    )
