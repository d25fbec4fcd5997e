"""Detection of marks in one picture: hues, components, centres.

Stages that need no earlier pictures belong here.
"""

from vision.detection.components import detect_marks
from vision.detection.expected import Expected
from vision.detection.hue import MarkHue, hue_distance
from vision.detection.hue_learning import learn_hue
from vision.detection.outline import Outline
from vision.detection.records import Detection, HueError, Reason

__all__ = [
    "Detection",
    "Expected",
    "HueError",
    "MarkHue",
    "Outline",
    "Reason",
    "detect_marks",
    "hue_distance",
    "learn_hue",
]
