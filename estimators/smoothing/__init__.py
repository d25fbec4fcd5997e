"""Smoothers, and a filter for measurements that arrive late.

Methods that use later measurements belong here.
"""

from estimators.smoothing.replay import Replay
from estimators.smoothing.smoother import FixedLag, fixed_interval

__all__ = [
    "FixedLag",
    "Replay",
    "fixed_interval",
]
