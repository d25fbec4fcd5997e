"""Light: cameras, marks found by hue, which mark is which, frame sources, drawn frames.

Image axes: u right, v down, the centre of the first pixel is (0, 0). Names of lengths in a picture
end in _px; the plane is in metres.
"""

from vision.camera import PlaneCamera, squarely
from vision.detect import Detection, HueError, detect_marks
from vision.draw import Disc, Lighting, distractors, draw_frame, paper_camera
from vision.drawn_camera import Highlight, RealCamera, RealFrame, RealMark, Shadow, draw_real_frame, reflectance
from vision.drawn_clutter import Hand, Needle, blood_layer, hand_layer, needle_layers, plain_surface
from vision.drawn_layers import Layer
from vision.drawn_runs import RunFrame, drawn_run, exposure_path
from vision.drawn_sensor import Sensor, light_of, srgb_of
from vision.drawn_view import DrawnView, tilted_view
from vision.hues import MarkHue, hue_distance
from vision.identify import Expected, Identified, identify
from vision.live import LiveFrames
from vision.sources import FolderFrames, Frame, SourceError, VideoFileFrames, count_frames
from vision.video import VideoWriter, compress

__all__ = [
    "Detection",
    "Disc",
    "DrawnView",
    "Expected",
    "FolderFrames",
    "Frame",
    "Hand",
    "Highlight",
    "HueError",
    "Identified",
    "Layer",
    "Lighting",
    "LiveFrames",
    "MarkHue",
    "Needle",
    "PlaneCamera",
    "RealCamera",
    "RealFrame",
    "RealMark",
    "RunFrame",
    "Sensor",
    "Shadow",
    "SourceError",
    "VideoFileFrames",
    "VideoWriter",
    "blood_layer",
    "compress",
    "count_frames",
    "detect_marks",
    "distractors",
    "draw_frame",
    "draw_real_frame",
    "drawn_run",
    "exposure_path",
    "hand_layer",
    "hue_distance",
    "identify",
    "light_of",
    "needle_layers",
    "paper_camera",
    "plain_surface",
    "reflectance",
    "squarely",
    "srgb_of",
    "tilted_view",
]
