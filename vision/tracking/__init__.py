"""Mark tracking: association, drift of hue, appearance, finder of marks.

Methods that use earlier frames belong here.
"""

from vision.tracking.association import AssociatedMark, associate_marks
from vision.tracking.distractors import Distractor
from vision.tracking.finder import MarkFinder
from vision.tracking.hue_tracking import AdaptiveHue
from vision.tracking.reasons import LostMark

__all__ = [
    "AdaptiveHue",
    "AssociatedMark",
    "Distractor",
    "LostMark",
    "MarkFinder",
    "associate_marks",
]
