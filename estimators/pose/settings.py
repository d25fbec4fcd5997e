"""Settings of the pose filter: how a camera or tracker may move, and how a reference mark may be wrong."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class PoseSettings:
    """Settings of the pose filter: prior of the pose error of a camera or tracker, and of its motion.

    start_m, start_rad: standard deviation of the pose error at the start, along and about each axis [m], [rad]; choice
    rate_m_s, rate_rad_s: standard deviation of the drift's speed, along and about each axis [m/s], [rad/s]; choice
    lasting_s: correlation time of the drift's speed [s]; choice
    moved_m, moved_rad: standard deviation of a sudden move, along and about each axis [m], [rad]; choice
    moved_each_s: mean time between two sudden moves [s]; choice
    wrong_share: share of measurements of reference marks that show another object by mistake [1]; choice
    wrong_m: distance of such an object from the reference mark on each axis, a standard deviation [m]; choice
    gate: normalised innovation squared per degree of freedom above which one of the marks may be wrong [1]; choice
    n_hypotheses: largest number of hypotheses [1]; choice
    least: probability of a hypothesis, relative to the best one, below which it is dropped [1]; choice
    drifted_m, drifted_rad: change since the last report above which a drift is reported [m], [rad]; choice
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
