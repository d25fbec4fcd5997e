"""Noise levels from the innovations of a recording, without truth: maximum likelihood."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from dynamics import MassSpringNetwork, ParameterUncertainty
from estimators.arrays import Floats
from estimators.filters.unscented import CovarianceError
from estimators.identification.budget import Budget, IdentificationError, OutOfTimeError, Workers, too_short
from estimators.identification.filter_pass import Frames
from estimators.identification.newton import minimum
from estimators.identification.stretch import affordable, frame_seconds, from_first_marks, liveliest
from estimators.threads import one_blas_thread
from estimators.tissue.filter import TissueFilter
from estimators.tissue.settings import FilterSettings
from estimators.tissue.target_filter import TargetFilter

NAMES = ("white", "poke", "marks")
"""Tuned: `ForceMode.white` of all modes, `ForceMode.poke` of the poked one, the marks' noise by the reported one."""

PRIOR_LOG_SD = np.log(2.0)
"""Prior standard deviation of the log of each level: a recording without pokes leaves them undetermined; choice,
its cost in docs/settings.md."""

MOST_PASSES = 60
"""Limit of the iteration: Newton's method needs ten to twenty-five passes, a part's by its share."""

FEW_PASSES = 25
"""Passes for which there is time at least, where frames are left out for it: the search is then near its end."""

PART = 0.25
"""Share of the frames, the liveliest in a row, by which the levels are found before all of them are used: numerical."""

PART_FRAMES = 100
"""Frames from which on a part of so many is used: numerical."""

MOST_OF_STIFF, MOST_FRAMES = 5000, 300
"""Frames, the liveliest in a row, that are used at most, by the states of the filter of a stiff or large body, and of
others: numerical, a pass then takes one or two seconds."""

STRAINS = tuple(share * FilterSettings().strain_sd for share in (1.0, 0.3, 0.1, 0.0))
"""By which the springs of a stiff or large body may be off [1]: the likeliest is taken before levels are searched."""

TOLERANCE, TOLERANCE_OF_STIFF = 1.0, 5.0
"""Of the log posterior that the last step may promise; numerical: it then ends well within a standard error, and a
likelihood is uneven by half of that, that of a stiff or large body by more: smaller steps mean nothing."""


@dataclass(frozen=True, slots=True, eq=False)
class TuningResult:
    """The noise levels under which a recording's innovations are most probable.

    settings: with the levels found, and the likeliest strain of a stiff or large body
    marks: standard deviation of the marks by the reported one
    names, values, log_sd: what was tuned, its value in the unit of its setting, and the standard error of the value's
        logarithm [1], each (3,)
    log_likelihood: of the innovations there, and with the levels from before
    n_frames: of the recording that were used; in_time: False where the time was too short for all frames and passes
    """

    settings: FilterSettings
    marks: float
    names: tuple[str, ...]
    values: Floats
    log_sd: Floats
    log_likelihood: float
    log_likelihood_before: float
    n_frames: int
    in_time: bool


def log_likelihood(tissue: TissueFilter, frames: Frames, budget: Budget | None = None) -> float:
    """Of the innovations of a filter through frames, (time [s], marks) in order; the first marks start it, only.

    Raises OutOfTimeError where the time is over.
    """
    return summed(tissue, frames, lambda: tissue.mixture.log_likelihood, budget)


def summed(
    tissue: TargetFilter, frames: Frames, log_likelihood: Callable[[], float], budget: Budget | None = None
) -> float:
    """Of a log likelihood after each frame whose marks were used, but for the first.

    Raises OutOfTimeError where the time is over.
    """
    limit = Budget() if budget is None else budget
    total = 0.0
    for time_s, marks in frames:
        limit.check()
        started = tissue.seen_s is not None
        tissue.predict(time_s)
        if tissue.update(marks).marks_used and started:
            total += log_likelihood()
    return total


@dataclass(frozen=True, slots=True, eq=False)
class _Passes:
    """Passes through frames at several levels, in logs by those before, (3,): their log likelihoods.

    start: the levels before, (3,)
    """

    network: MassSpringNetwork
    nodes: tuple[Sequence[str], str]
    uncertainty: ParameterUncertainty | None
    settings: FilterSettings
    start: Floats
    frames: Frames
    budget: Budget

    def __call__(self, logs: Floats) -> float:
        values = self.start * np.exp(logs)
        levels = with_noise_levels(self.settings, values)
        try:
            tissue = TissueFilter(self.network, self.nodes[1], self.nodes[0], levels, uncertainty=self.uncertainty)
            return log_likelihood(tissue, with_scaled_noise(self.frames, values[2]), self.budget)
        except (CovarianceError, np.linalg.LinAlgError):
            return -np.inf

    def with_strain(self, strain_sd: float) -> _Passes:
        """The same where springs may be off by so much."""
        return replace(self, settings=replace(self.settings, strain_sd=strain_sd))

    def by_strain(self, strain_sd: float, logs: Floats) -> float:
        """Of these levels, where springs may be off by so much."""
        return self.with_strain(strain_sd)(logs)

    def of_strains(self, logs: Floats, likelihood: float, workers: Workers) -> dict[float, float]:
        """Of these levels, by each of `STRAINS` and the present strain, whose likelihood is known."""
        found = {self.settings.strain_sd: likelihood}
        others = [strain for strain in STRAINS if strain not in found]
        return found | dict(zip(others, workers(partial(self.by_strain, logs=logs), others), strict=True))


class _Cost:
    """Minus the log posterior of noise levels, in logs by the levels before, (3,).

    share: of all frames that it passes through; workers: that several passes are shared out to
    known: log likelihoods that were found before, by `_key` of the levels
    State: passes done, those before it included, a pass of all frames as one; the least cost and where it was.
    """

    def __init__(
        self,
        run: Callable[[Floats], float],
        advance: Callable[[float], None],
        share: float = 1.0,
        passes: float = 0.0,
        workers: Workers = map,
        known: Mapping[bytes, float] | None = None,
    ) -> None:
        self._run, self._advance, self.share, self._workers = run, advance, share, workers
        self._known = dict(known or {})
        self.passes = passes
        self.least, self.best = np.inf, np.zeros(len(NAMES))

    def __call__(self, logs: Floats) -> float:
        return self.each([logs])[0]

    @property
    def likelihood(self) -> float:
        """Log likelihood of the levels of the least cost."""
        return prior_cost(self.best) - self.least

    def each(self, places: Sequence[Floats]) -> list[float]:
        """Of several levels. Raises OutOfPassesError after those for which passes are left."""
        new = [logs for logs in places if _key(logs) not in self._known]
        left = max(0, int(np.ceil((MOST_PASSES - self.passes) / self.share)))
        if left < len(new):
            self.each(new[:left])
            raise OutOfPassesError
        runs = self._workers if len(new) > 1 else map
        for logs, likelihood in zip(new, runs(self._run, new), strict=True):
            self._known[_key(logs)] = likelihood
            self.passes += self.share
            self._advance(min(1.0, self.passes / FEW_PASSES))
            self._cost(logs)
        return [self._cost(logs) for logs in places]

    def _cost(self, logs: Floats) -> float:
        """Of levels whose likelihood is known."""
        cost = prior_cost(logs) - self._known[_key(logs)]
        if cost < self.least:
            self.least, self.best = cost, np.array(logs)
        return cost


def _key(logs: Floats) -> bytes:
    """Of levels that are the same."""
    return (logs + 0.0).tobytes()  # no negative nought


class OutOfPassesError(Exception):
    """As many passes as are allowed are done."""


def prior_cost(logs: Floats) -> float:
    """Minus the log of the prior density of levels, in logs by the levels before, up to a constant."""
    return 0.5 * float(np.sum((logs / PRIOR_LOG_SD) ** 2))


@one_blas_thread()
def tune_noise(
    network: MassSpringNetwork,
    frames: Frames,
    marked: Sequence[str],
    target: str,
    *,
    uncertainty: ParameterUncertainty | None = None,
    settings: FilterSettings | None = None,
    budget: Budget | None = None,
    workers: Workers = map,
    advance: Callable[[float], None] = lambda _share: None,
) -> TuningResult:
    """Fit the noise levels; the target's mark is used where the frames have it. `advance` gets the share done.

    budget: the time that it may take, then the best until then is returned. workers: `map` of this process, or that of
    a pool of processes, among which passes of the filter are shared out, as SciPy's solvers do. Raises
    IdentificationError where the time is too short for anything.
    """
    before = FilterSettings() if settings is None else settings
    limit = Budget() if budget is None else budget
    start = np.array([before.quiet.white, before.poked.poke, 1.0])
    none = np.zeros(len(start))
    frames = from_first_marks(frames)
    model = TissueFilter(network, target, marked, before, uncertainty=uncertainty).model
    stiff = model.stiff
    frames = liveliest(frames, MOST_OF_STIFF // model.dim_x if stiff else MOST_FRAMES)
    fixed = replace(before, white_bounds=(1.0, 1.0))  # a level that adapts says nothing of what it began with
    run = _Passes(network, (tuple(marked), target), uncertainty, fixed, start, frames, limit)
    try:
        frame_s = frame_seconds(lambda some: replace(run, frames=some)(none), frames, limit)
        used = affordable(frames, frame_s, FEW_PASSES * (2 if stiff else 1), limit)
        run = replace(run, frames=used)
        likelihood_before = run(none)
        by_strain = {before.strain_sd: likelihood_before}
        if stiff:
            by_strain = run.of_strains(none, likelihood_before, workers)
    except OutOfTimeError:
        raise too_short(limit) from None
    if not np.isfinite(likelihood_before):
        raise IdentificationError("expected levels under which the filter stays finite, found others")
    # levels and strain explain the same innovations: without a strain other levels are the best
    strains = list(dict.fromkeys([max(by_strain, key=by_strain.__getitem__), *([0.0] if stiff else [])]))
    searches, tolerance = [], TOLERANCE_OF_STIFF if stiff else TOLERANCE
    finished = True
    try:
        for k, strain in enumerate(strains):
            progress = partial(_progress, advance, limit, (k, len(strains)))
            searches.append(_Search(run.with_strain(strain), progress, workers, by_strain[strain]))
            searches[-1].search(tolerance)
    except OutOfTimeError:
        finished = False
    best = min(searches, key=lambda one: one.cost.least)
    by_strain = {best.run.settings.strain_sd: best.cost.likelihood}
    try:
        if stiff:  # once more, for by levels that are too low the springs explain what forces do
            by_strain = best.run.of_strains(best.cost.best, best.cost.likelihood, workers)
    except OutOfTimeError:
        finished = False
    best_strain = max(by_strain, key=by_strain.__getitem__)
    settings = best.run.with_strain(best_strain).settings
    values = start * np.exp(best.cost.best)
    advance(1.0)
    return TuningResult(
        replace(with_noise_levels(settings, values), white_bounds=before.white_bounds),
        float(values[2]),
        NAMES,
        values,
        best.log_sd,
        by_strain[best_strain],
        likelihood_before,
        len(used),
        finished and len(used) == len(frames),
    )


def _progress(advance: Callable[[float], None], limit: Budget, place: tuple[int, int], share: float) -> None:
    """Tell the share done of all searches, of so many the one that is this place's has done this share of its own."""
    k, n = place
    advance(max((k + share) / n, limit.share))


class _Search:
    """The search for the levels under which innovations are most probable, by one strain.

    State: cost, of all frames; log_sd, standard errors of the logs there, (3,), those of the prior until it has ended.
    """

    def __init__(self, run: _Passes, advance: Callable[[float], None], workers: Workers, likelihood: float) -> None:
        self.run, self._advance, self._workers = run, advance, workers
        none = np.zeros(len(NAMES))
        self.cost = _Cost(run, advance, workers=workers, known={_key(none): likelihood})
        self.cost(none)
        self.log_sd = np.full(len(NAMES), PRIOR_LOG_SD)

    def search(self, tolerance: float) -> None:
        """Search, first by a part of the frames where there are enough. Raises OutOfTimeError."""
        frames = self.run.frames
        some = liveliest(frames, int(PART * len(frames)))
        of_part = None
        if len(some) >= PART_FRAMES:
            of_part = _Cost(replace(self.run, frames=some), self._advance, PART, 1.0, self._workers)
        self.log_sd = _search(self.cost, of_part, tolerance)


def _search(cost: _Cost, of_part: _Cost | None, tolerance: float = TOLERANCE) -> Floats:
    """Standard errors of the logs about the least cost, (3,), by the curvature along each axis; see `cost` for that.

    of_part: as cost, by a part of the frames, which is searched first; None: all of them from the start
    """
    least = np.full(len(cost.best), PRIOR_LOG_SD**-2.0)
    start, curvature = np.zeros(len(least)), None
    try:
        if of_part is not None:
            found = minimum(of_part, start, least, tolerance=tolerance, costs=of_part.each)
            cost.passes = of_part.passes
            start, curvature = found.x, least + (found.curvature - least) / of_part.share
        found = minimum(cost, start, least, tolerance=tolerance, curvature=curvature, costs=cost.each)
    except OutOfPassesError:
        return np.full(len(least), PRIOR_LOG_SD)
    return np.asarray(1.0 / np.sqrt(found.curvature))


def with_noise_levels(settings: FilterSettings, values: Floats) -> FilterSettings:
    """The settings with these levels of white noise [m/s²/sqrt(Hz)] and poke [m/s²]."""
    white, poke = float(values[0]), float(values[1])
    # the quiet modes' poke is a trace that keeps the state's poke alive: as strong as the white noise, as before
    quiet = replace(settings.quiet, white=white, poke=settings.quiet.poke * white / settings.quiet.white)
    poked = replace(settings.poked, white=white, poke=poke)
    return replace(settings, quiet=quiet, poked=poked, least_white=(0.0, 0.0))


def with_scaled_noise(frames: Frames, factor: float) -> Frames:
    """The frames with each mark's standard deviation times a factor."""
    return [(time_s, [replace(mark, cov=factor**2 * mark.cov) for mark in marks]) for time_s, marks in frames]
