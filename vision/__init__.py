"""Light: cameras, marks found by hue, which mark is which, frame sources, drawn frames.

Image axes: u right, v down, the centre of the first pixel is (0, 0). Names of lengths in a picture
end in _px; the plane is in metres.
"""

from vision.camera import PlaneCamera, posed, squarely
from vision.detect import Detection, HueError, detect_marks
from vision.draw import Disc, Lighting, distractors, draw_frame, paper_camera
from vision.finder import MarkFinder
from vision.following import FollowedHue
from vision.hues import MarkHue, hue_distance
from vision.identify import Expected, Identified, identify
from vision.lens import Lens, Pose
from vision.live import LiveFrames
from vision.outline import Outline
from vision.sources import FolderFrames, Frame, SourceError, VideoFileFrames, count_frames
from vision.video import VideoWriter, compress

__all__ = [
    "Detection",
    "Disc",
    "Expected",
    "FolderFrames",
    "FollowedHue",
    "Frame",
    "HueError",
    "Identified",
    "Lens",
    "Lighting",
    "LiveFrames",
    "MarkFinder",
    "MarkHue",
    "Outline",
    "PlaneCamera",
    "Pose",
    "SourceError",
    "VideoFileFrames",
    "VideoWriter",
    "compress",
    "count_frames",
    "detect_marks",
    "distractors",
    "draw_frame",
    "hue_distance",
    "identify",
    "paper_camera",
    "posed",
    "squarely",
]
