"""A filter's estimates of hidden points in a recording, and their scores against the truth."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dynamics import MassSpringNetwork
from estimators import MarkMeasurement, Status, TissueFilter, coverage, normalised_error_squared
from estimators.process.target import TargetPoint, target_map
from experiments.arrays import Floats

SIGMAS, SHARE_OF_SIZE = 5.0, 0.1
"""The status TRACKING is wrong if an error exceeds both SIGMAS standard deviations and SHARE_OF_SIZE body sizes."""


@dataclass(slots=True, eq=False)
class Followed:
    """Estimates of a filter in a recording. They end early if the filter fails or exceeds its time limit.

    means: positions of hidden points [m], (n_frames, n_hidden, dim)
    covs: covariances of these positions [m²], (n_frames, n_hidden, dim, dim)
    status: status of each frame; seconds: the filter's processor time [s]
    repairs: number of numerical repairs by kind; failure: why the run ended early, empty if it used all frames
    """

    means: Floats
    covs: Floats
    status: list[Status] = field(default_factory=list)
    seconds: float = 0.0
    repairs: Counter[str] = field(default_factory=Counter)
    failure: str = ""

    @property
    def tracking(self) -> NDArray[np.bool_]:
        """Whether each frame is TRACKING, (n_frames,)."""
        return np.array([status is Status.TRACKING for status in self.status], dtype=bool)


def followed(
    begun: Callable[[], TissueFilter],
    network: MassSpringNetwork,
    hidden: Sequence[str | TargetPoint],
    frames: Sequence[tuple[float, Sequence[MarkMeasurement]]],
    limit_s: float = np.inf,
) -> Followed:
    """Run a filter through a recording; returns its estimates of the hidden points.

    begun: function that creates the filter; limit_s: limit of the filter's processor time [s]
    """
    means, covs = [], []
    found = Followed(np.empty((0, len(hidden), network.dim)), np.empty((0, len(hidden), network.dim, network.dim)))
    start_s = time.process_time()
    try:
        with np.errstate(all="ignore"):  # the scores count states that overflow
            tissue = begun()
            maps = [target_map(network, one) for one in hidden]
            for time_s, marks in frames:
                tissue.predict(time_s)
                estimate = tissue.update(marks)
                found.repairs = Counter(tissue.repairs)
                places = [tissue.place_of(one) for one in maps]
                found.status.append(estimate.status)
                means.append([mean for mean, _ in places])
                covs.append([cov for _, cov in places])
                if time.process_time() - start_s > limit_s and len(means) < len(frames):
                    found.failure = f"stopped after {limit_s:g} s"
                    break
    except Exception as error:  # any exception that a filter raises is a result of the study
        found.failure = f"{type(error).__name__}: {error}"
    found.seconds = time.process_time() - start_s
    if means:
        found.means, found.covs = np.array(means), np.array(covs)
    return found


def mean_distance(places: Floats, truth: Floats) -> float:
    """Mean distance between positions and true positions [m], both (..., dim); infinite if a position is not finite."""
    if not np.isfinite(places).all():
        return float("inf")
    return float(np.linalg.norm(places - truth, axis=-1).mean())


def hidden_scores(
    means: Floats, covs: Floats, truth: Floats, *, tracking: NDArray[np.bool_], size_m: float
) -> dict[str, float | int]:
    """Figures over all hidden points and all frames.

    means, truth: positions [m], (n_frames, n_hidden, dim); covs: covariances [m²], (n_frames, n_hidden, dim, dim)
    tracking: whether each frame is TRACKING, (n_frames,); size_m: extent of the body [m]
    non_finite: number of estimates with a non-finite value or without a positive definite covariance. `nees` and
    `sigma_m` omit such estimates. A non-finite position makes the errors infinite.
    wrong_tracking: number of TRACKING frames with a wrong estimate, see `SIGMAS` and `SHARE_OF_SIZE`
    """
    dim = truth.shape[-1]
    errors = (means - truth).reshape(-1, dim)
    flat = covs.reshape(-1, dim, dim)
    finite = np.asarray(np.isfinite(errors).all(axis=1) & np.isfinite(flat).all(axis=(1, 2)))
    good = np.zeros(len(errors), dtype=bool)
    good[finite] = np.linalg.eigvalsh(flat[finite])[:, 0] > 0.0
    nees = np.full(len(errors), np.inf)
    nees[good] = normalised_error_squared(errors[good], flat[good])
    distance = np.full(len(errors), np.inf)
    distance[finite] = np.linalg.norm(errors[finite], axis=1)
    wrong = (nees > SIGMAS**2) & (distance > SHARE_OF_SIZE * size_m)
    by_frame = wrong.reshape(truth.shape[:2]).any(axis=1)
    return {
        "error_m": float(distance.mean()),
        "rms_m": float(np.sqrt((distance**2).mean())),
        "worst_m": float(distance.max()),
        "covered": coverage(nees, dim),
        "nees": float(nees[good].mean() / dim) if good.any() else float("inf"),
        "sigma_m": float(np.sqrt(np.trace(flat[good], axis1=1, axis2=2).mean())) if good.any() else float("inf"),
        "non_finite": int((~good).sum()),
        "wrong_tracking": int((by_frame & tracking).sum()),
    }
