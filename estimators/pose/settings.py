"""Settings of the pose filter: how a camera or tracker moves, and how often a reference mark is measured wrongly."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class PoseSettings:
    """Settings of the filter for the pose error of a camera or tracker.

    In a pair of settings, the first is for translation along each axis [m], the second for rotation about each axis
    [rad].
    start_m, start_rad: standard deviation of the pose error at the start [m], [rad]; choice
    rate_m_s, rate_rad_s: standard deviation of the drift's speed [m/s], [rad/s]; choice
    lasting_s: correlation time of the drift's speed [s]; choice
    moved_m, moved_rad: standard deviation of a sudden move [m], [rad]; choice
    moved_each_s: mean time between two sudden moves [s]; choice
    wrong_share: share of the measurements of reference marks that show another object [1]; choice
    wrong_m: standard deviation of the error of a wrong measurement, on each axis [m]; choice
    gate: if the normalised innovation squared per degree of freedom exceeds this number, the filter searches for wrong
        measurements [1]; choice
    n_hypotheses: largest number of hypotheses [1]; choice
    least: probability of a hypothesis, relative to the best one, below which it is dropped [1]; choice
    drifted_m, drifted_rad: smallest drift since the last report that causes a new report [m], [rad]; choice
    """

    start_m: float = 1e-3
    start_rad: float = 5e-3
    rate_m_s: float = 1e-3
    rate_rad_s: float = 1e-3
    lasting_s: float = 20.0
    moved_m: float = 0.05
    moved_rad: float = 0.05
    moved_each_s: float = 100.0
    wrong_share: float = 1e-3
    wrong_m: float = 0.1
    gate: float = 3.0
    n_hypotheses: int = 5
    least: float = 1e-7
    drifted_m: float = 5e-3
    drifted_rad: float = 0.02
