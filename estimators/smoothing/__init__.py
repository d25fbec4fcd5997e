"""Out-of-sequence measurements; fixed-interval and fixed-lag smoothing.

What may enter: what uses later measurements.
"""

from estimators.smoothing.replay import Replay
from estimators.smoothing.smoother import FixedLag, fixed_interval

__all__ = [
    "FixedLag",
    "Replay",
    "fixed_interval",
]
