"""Measurements out of sequence, and estimates of the past: replay, fixed-interval and fixed-lag smoothing.

What may enter: what uses measurements later than the time of which it speaks.
"""

from estimators.smoothing.replay import Replay
from estimators.smoothing.smoother import FixedLag, fixed_interval

__all__ = [
    "FixedLag",
    "Replay",
    "fixed_interval",
]
