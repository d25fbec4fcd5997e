"""Predicted path of the target. If the body is near rest, tables give a fast prediction; otherwise the filter predicts.

Usually no short force acts on the tissue before the needle arrives. A single Gaussian would be too wide if no short
force acts, and too narrow if one acts. The path is therefore a mixture of three cases: (1) no short force acts, and no
slow force becomes stronger; (2) a short force acts, or a slow force becomes stronger; (3) a force drags a node.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from weakref import WeakKeyDictionary

import numpy as np

from dynamics import SAME_STEP, rest_shape
from dynamics.threads import one_blas_thread
from estimators.arrays import Floats
from estimators.core.ahead import AheadTables
from estimators.core.track import TissueFilter
from estimators.guidance.breathing import Breathing
from estimators.guidance.needle import Insertion, Needle
from estimators.guidance.settings import AdviceSettings

CYCLE_S = 1.0 / 30.0
"""Step between two times of the tables for fast predictions [s]; choice."""

TURNED = 0.35
"""Largest angle between a spring and its direction at rest for which the tables are valid [rad]; measured:
docs/guidance.md, "The predicted path"."""

LEAST_PART = 1e-6
"""A part of the mixture with a smaller probability is omitted, because rounding errors would dominate it; numerical."""

ASIDE_M = 0.05
"""Largest distance of the target from its rest position for which the tables last long enough [m]; choice."""

MOST_S = 30.0
"""Longest time from the latest start to the end of a predicted path, even for a slow needle [s]; choice."""


@dataclass(frozen=True, slots=True, eq=False)
class PathParts:
    """Gaussian mixture of c parts at k times: weights, (k, c); means [m], (k, c, dim); covs [m²], (k, c, dim, dim)."""

    weights: Floats
    means: Floats
    covs: Floats


@dataclass(frozen=True, slots=True, eq=False)
class TargetPath:
    """Predicted path of a target: increasing times [s], (k,); means [m], (k, dim); covariances [m²], (k, dim, dim).

    mixture: distribution of the target at each time; None for a Gaussian
    """

    times_s: Floats
    means: Floats
    covs: Floats
    mixture: PathParts | None = None

    def __post_init__(self) -> None:
        k, dim = self.means.shape
        if k < 2 or self.times_s.shape != (k,) or self.covs.shape != (k, dim, dim):
            raise ValueError(
                f"path: expected two or more times, means (k, dim), covs (k, dim, dim), "
                f"found {self.times_s.shape}, {self.means.shape}, {self.covs.shape}"
            )
        if not (np.diff(self.times_s) > 0.0).all():
            raise ValueError(f"path times_s: expected increasing times, found {self.times_s}")
        if self.mixture is not None:
            weights, means, covs = self.mixture.weights, self.mixture.means, self.mixture.covs
            c = weights.shape[-1]
            if (weights.shape, means.shape, covs.shape) != ((k, c), (k, c, dim), (k, c, dim, dim)):
                raise ValueError(
                    f"path mixture: expected weights ({k}, c), means ({k}, c, {dim}), covs ({k}, c, {dim}, {dim}), "
                    f"found {weights.shape}, {means.shape}, {covs.shape}"
                )

    def widened(self, cov: Floats) -> TargetPath:
        """The path with an additional constant error; cov: covariance of this error [m²], (dim, dim)."""
        return self.moved(np.zeros(len(cov)), cov)

    def moved(self, by: Floats, cov: Floats) -> TargetPath:
        """The path, shifted by `by` [m], (dim,) or (k, dim); cov: covariance of the shift [m²], (dim, dim)."""
        parts = self.mixture
        each = np.expand_dims(by, -2)
        mixture = None if parts is None else replace(parts, means=parts.means + each, covs=parts.covs + cov)
        return replace(self, means=self.means + by, covs=self.covs + cov, mixture=mixture)

    @property
    def parts(self) -> tuple[Floats, Floats, Floats]:
        """Mixture: weights, (k, c); means minus overall mean [m], (k, c, dim); covs [m²], (k, c, dim, dim)."""
        if self.mixture is None:
            k, dim = self.means.shape
            return np.ones((k, 1)), np.zeros((k, 1, dim)), self.covs[:, None]
        return self.mixture.weights, self.mixture.means - self.means[:, None], self.mixture.covs


def breathing_track(tissue: TissueFilter, mean: Floats) -> tuple[Floats, Floats]:
    """Mean [m], (dim,), and covariance [m²], (dim, dim), of the target, as if the errors that last were zero.

    These are the considered errors and that of `TargetPoint.offset_m`. `breathing_ahead` adds them to the prediction.
    """
    return mean - tissue.offset_mean, tissue.tissue_cov - tissue.considered_cov


def breathing_ahead(breathing: Breathing, tissue: TissueFilter, times_s: Floats) -> tuple[Floats, Floats]:
    """Means [m], (k, dim), and covariances [m²], (k, dim, dim), that the breathing model predicts for the target."""
    means, covs = breathing.predict(times_s)
    return means + tissue.offset_mean, covs + tissue.offset_cov + tissue.considered_cov


def either_path(one: TargetPath, other: TargetPath, probability: Floats) -> TargetPath:
    """Mixture of two paths at the same times; probability: probability of the first path at each time [1], (k,)."""
    share = np.stack([probability, 1.0 - probability], axis=1)
    both = [path.parts for path in (one, other)]
    weights = np.concatenate([share[:, i, None] * parts[0] for i, parts in enumerate(both)], axis=1)
    means = np.concatenate(
        [path.means[:, None] + parts[1] for path, parts in zip((one, other), both, strict=True)], axis=1
    )
    covs = np.concatenate([parts[2] for parts in both], axis=1)
    mean = np.einsum("kc,kcd->kd", weights, means)
    away = means - mean[:, None]
    cov = np.einsum("kc,kcde->kde", weights, covs + away[..., :, None] * away[..., None, :])
    return TargetPath(one.times_s, mean, cov, PathParts(weights, means, covs))


def path_reach_s(tissue: TissueFilter, insertion: Insertion, needle: Needle, settings: AdviceSettings) -> float:
    """Duration [s] for which advice needs a predicted path: from the oldest usable estimate to the latest arrival."""
    rest = tissue.target.position(rest_shape(tissue.network)[tissue.network.free].ravel())
    way_s = time_to(float(np.linalg.norm(rest - insertion.entry)) + ASIDE_M, insertion, needle)
    return settings.horizon_s + min(way_s, MOST_S) + settings.stale_s


def time_to(distance_m: float, insertion: Insertion, needle: Needle) -> float:
    """Time [s] until the part of the needle that has to hit is at a depth of distance_m; 0 if this part is deeper."""
    return max(distance_m + needle.reach_m - insertion.depth_m, 0.0) / insertion.speed_m_s


def path_tables(tissue: TissueFilter, ahead_s: float) -> AheadTables:
    """Tables for predictions over ahead_s [s]. They are valid at any time at which the body is near rest."""
    return tissue.tables(_times_until(ahead_s, CYCLE_S), CYCLE_S)


def _times_until(ahead_s: float, cycle_s: float) -> int:
    """Number of times, at intervals of cycle_s from now on, that cover the next ahead_s."""
    return int(np.ceil(ahead_s / cycle_s * (1.0 - SAME_STEP))) + 1


def path_by_tables(tables: AheadTables, tissue: TissueFilter) -> TargetPath:
    """The predicted path at all times of the tables. Raises ValueError if the filter has seen no frame."""
    return _first_of_tables(tables, tissue, tables.n_times)


def path_near_rest(tables: AheadTables, tissue: TissueFilter, times_s: Floats) -> TargetPath:
    """The predicted path, which covers the requested times [s], (k,).

    If the body is near rest and the tables are long enough, the tables give the path. The path then has the times of
    the tables, which begin at the filter's time. Otherwise the filter predicts the path at the requested times.
    """
    if tissue.time_s is None or tissue.time_s > times_s[0]:
        return TargetPath(times_s, *tissue.predict_path(times_s))
    n = _times_until(float(times_s[-1] - tissue.time_s), tables.cycle_s)
    if n > tables.n_times or not _is_near_rest(tables, tissue):
        return TargetPath(times_s, *tissue.predict_path(times_s))
    return _first_of_tables(tables, tissue, max(n, 2))


_KEPT: WeakKeyDictionary[TissueFilter, AheadTables] = WeakKeyDictionary()
"""Tables for each existing filter for which `kept_path` was called."""


def kept_path(tissue: TissueFilter, times_s: Floats) -> TargetPath:
    """The path of `path_near_rest`, with cached tables. If the tables are too short, new tables are computed."""
    ahead_s = float(times_s[-1]) - (float(times_s[0]) if tissue.time_s is None else tissue.time_s)
    tables = _KEPT.get(tissue)
    if tables is None or _times_until(ahead_s, tables.cycle_s) > tables.n_times:
        if ahead_s > MOST_S:
            return TargetPath(times_s, *tissue.predict_path(times_s))
        # while the needle moves, later calls need slightly longer tables
        tables = _KEPT[tissue] = path_tables(tissue, 1.25 * ahead_s)
    return path_near_rest(tables, tissue, times_s)


@one_blas_thread()
def _first_of_tables(tables: AheadTables, tissue: TissueFilter, n: int) -> TargetPath:
    """The predicted path at the first n times of the tables."""
    times, cases = tables.times(tissue)[:n], [tuple(each[:n] for each in case) for case in tables.parts(tissue)]
    _, means, covs = cases[-1]
    return TargetPath(times, means, covs, _mixture(cases))


def _is_near_rest(tables: AheadTables, tissue: TissueFilter) -> bool:
    """Whether no spring has turned by more than `TURNED` from its direction at rest."""
    now = tissue.positions
    i, j = tissue.network.springs.T
    springs, at_rest = now[j] - now[i], tables.shape[j] - tables.shape[i]
    lengths = np.linalg.norm(springs, axis=1) * np.linalg.norm(at_rest, axis=1)
    return bool(((springs * at_rest).sum(axis=1) >= np.cos(TURNED) * lengths).all())


def _mixture(cases: Sequence[tuple[Floats, ...]]) -> PathParts:
    """Mixture from nested cases. Each case has probabilities (k,), means (k, dim) and covariances (k, dim, dim).

    If case i - 1 is true, so is case i. The last case is always true. Part i: case i is true, but case i - 1 is not.
    """
    weights, means, covs = (np.stack(each, axis=1) for each in zip(*cases, strict=True))
    apart = means - means[:, -1:]
    own = np.diff(weights, axis=1, prepend=0.0)
    own[own < LEAST_PART] = 0.0
    share = np.maximum(own, LEAST_PART)[..., None]
    mean = np.diff(weights[..., None] * apart, axis=1, prepend=0.0) / share
    second = covs + apart[..., :, None] * apart[..., None, :]
    second = np.diff(weights[..., None, None] * second, axis=1, prepend=0.0) / share[..., None]
    cov = second - mean[..., :, None] * mean[..., None, :]
    is_none = (own == 0.0)[..., None]
    return PathParts(
        own / own.sum(axis=1, keepdims=True),
        np.where(is_none, means, means[:, -1:] + mean),
        np.where(is_none[..., None], covs, cov),
    )
