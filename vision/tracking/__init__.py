"""Marks from frame to frame: association, drift of hue, appearance models, and the finder that runs all.

What may enter: what remembers earlier frames.
"""

from vision.tracking.association import Identified, identify
from vision.tracking.finder import MarkFinder
from vision.tracking.hue_tracking import FollowedHue

__all__ = [
    "FollowedHue",
    "Identified",
    "MarkFinder",
    "identify",
]
