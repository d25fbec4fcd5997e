"""Noise levels from the innovations of a recording, without truth: maximum likelihood."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize

from dynamics import MassSpringNetwork, ParameterUncertainty
from estimators.arrays import Floats
from estimators.tissue.estimate import MarkMeasurement
from estimators.tissue.filter import TissueFilter
from estimators.tissue.settings import FilterSettings

Frames = Sequence[tuple[float, Sequence[MarkMeasurement]]]

NAMES = ("white", "poke", "marks")
"""Tuned: `ForceMode.white` of all modes, `ForceMode.poke` of the poked one, the marks' noise by the reported one."""

PRIOR_LOG_SD = np.log(2.0)
"""Prior standard deviation of the log of each level: a recording without pokes leaves them undetermined; choice,
its cost in docs/settings.md."""

MOST_PASSES = 60
"""Limit of the iteration: the simplex closes to its tolerances in about fifty passes."""


@dataclass(frozen=True, slots=True, eq=False)
class TuningResult:
    """The noise levels under which a recording's innovations are most probable.

    settings: with the levels found; marks: standard deviation of the marks by the reported one
    names, values, log_sd: what was tuned, its value, and the standard error of its logarithm, (3,)
    log_likelihood: of the innovations there, and with the levels from before
    """

    settings: FilterSettings
    marks: float
    names: tuple[str, ...]
    values: Floats
    log_sd: Floats
    log_likelihood: float
    log_likelihood_before: float


def log_likelihood(tissue: TissueFilter, frames: Frames) -> float:
    """Of the innovations of a filter through frames, (time [s], marks) in order; the first marks start it, only."""
    total = 0.0
    for time_s, marks in frames:
        started = tissue.seen_s is not None
        tissue.predict(time_s)
        if tissue.update(marks).marks_used and started:
            total += tissue.mixture.log_likelihood
    return total


def tune_noise(
    network: MassSpringNetwork,
    frames: Frames,
    marked: Sequence[str],
    target: str,
    *,
    uncertainty: ParameterUncertainty | None = None,
    settings: FilterSettings | None = None,
    advance: Callable[[float], None] = lambda _share: None,
) -> TuningResult:
    """Fit the noise levels; the target's mark is used where the frames have it. `advance` gets the share done."""
    before = FilterSettings() if settings is None else settings
    start = np.array([before.quiet.white, before.poked.poke, 1.0])
    passes = 0

    def cost(logs: Floats) -> float:
        nonlocal passes
        passes += 1
        advance(min(1.0, passes / MOST_PASSES))
        values = start * np.exp(logs)
        tissue = TissueFilter(network, target, marked, with_noise_levels(before, values), uncertainty=uncertainty)
        return 0.5 * float(np.sum((logs / PRIOR_LOG_SD) ** 2)) - log_likelihood(
            tissue, with_scaled_noise(frames, values[2])
        )

    n = len(start)
    simplex = np.vstack([np.zeros(n), 0.3 * np.eye(n)])
    options = {"initial_simplex": simplex, "xatol": 0.01, "fatol": 0.05, "maxfev": MOST_PASSES - 2 * n}
    found = minimize(cost, np.zeros(n), method="Nelder-Mead", options=options)
    # standard errors by the curvature along each axis of the search
    step = 0.1
    curvature = np.array([cost(found.x + step * e) + cost(found.x - step * e) - 2.0 * found.fun for e in np.eye(n)])
    log_sd = step / np.sqrt(np.maximum(curvature, (step / PRIOR_LOG_SD) ** 2))
    values = start * np.exp(found.x)
    prior = 0.5 * float(np.sum((found.x / PRIOR_LOG_SD) ** 2))
    advance(1.0)
    return TuningResult(
        with_noise_levels(before, values),
        float(values[2]),
        NAMES,
        values,
        log_sd,
        prior - float(found.fun),
        -cost(np.zeros(n)),
    )


def with_noise_levels(settings: FilterSettings, values: Floats) -> FilterSettings:
    """The settings with these levels of white noise [m/s²/sqrt(Hz)] and poke [m/s²]."""
    white, poke = float(values[0]), float(values[1])
    # the quiet modes' poke is a trace that keeps the state's poke alive: as strong as the white noise, as before
    quiet = replace(settings.quiet, white=white, poke=settings.quiet.poke * white / settings.quiet.white)
    return replace(settings, quiet=quiet, poked=replace(settings.poked, white=white, poke=poke))


def with_scaled_noise(frames: Frames, factor: float) -> Frames:
    """The frames with each mark's standard deviation times a factor."""
    return [(time_s, [replace(mark, cov=factor**2 * mark.cov) for mark in marks]) for time_s, marks in frames]
