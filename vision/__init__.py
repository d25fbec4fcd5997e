"""Light: cameras, marks found by hue, which mark is which, frame sources, drawn frames.

Image axes: u right, v down, the centre of the first pixel is (0, 0). Names of lengths in a picture
end in _px; the plane is in metres.
"""

from vision.board import DICTIONARIES, Board, Corners, find_board
from vision.bundle import CalibrationError
from vision.calibration import Calibration, View, board_text, calibrate, rms
from vision.camera import PlaneCamera, posed, squarely
from vision.detect import detect_marks
from vision.detection import Detection, HueError
from vision.draw import Disc, Lighting, distractors, draw_frame, paper_camera
from vision.drawn_camera import Highlight, RealCamera, RealFrame, RealMark, Shadow, draw_real_frame, reflectance
from vision.drawn_clutter import Hand, Needle, blood_layer, hand_layer, needle_layers, plain_surface
from vision.drawn_layers import Layer
from vision.drawn_runs import Level, RunFrame, drawn_run, exposure_path
from vision.drawn_sensor import Sensor, light_of, srgb_of
from vision.drawn_view import DrawnView, tilted_view
from vision.every_frame import EveryFrame, FrameFile
from vision.exposure_times import DeviceTimes, ExposureRule, FilmTimes, told_times
from vision.finder import MarkFinder
from vision.following import FollowedHue
from vision.hues import MarkHue, hue_distance
from vision.identify import Expected, Identified, identify
from vision.learning import learn_hue
from vision.lens import Lens, Pose
from vision.live import Capture, LiveFrames
from vision.open_source import EVERY, from_file, open_source, shown_source
from vision.outline import Outline
from vision.picture_folder import PictureFolderFrames
from vision.pictures import FILMS, SHARP_FRAMES, grey_picture, grey_pictures, sharp_frames
from vision.playback import Playback
from vision.rig import CameraViews, calibrate_together
from vision.segments import (
    NOMINAL_FPS,
    SUFFIX,
    SegmentFrames,
    SegmentWriter,
    count_segment_frames,
    join_segments,
    segments_in,
)
from vision.source_events import EventKind, Source, SourceEvent
from vision.sources import FolderFrames, Frame, SourceError, VideoFileFrames, count_frames, quiet_opencv
from vision.video import Codec, VideoWriter, compress
from vision.watch import Watch

__all__ = [
    "DICTIONARIES",
    "EVERY",
    "FILMS",
    "NOMINAL_FPS",
    "SHARP_FRAMES",
    "SUFFIX",
    "Board",
    "Calibration",
    "CalibrationError",
    "CameraViews",
    "Capture",
    "Codec",
    "Corners",
    "Detection",
    "DeviceTimes",
    "Disc",
    "DrawnView",
    "EventKind",
    "EveryFrame",
    "Expected",
    "ExposureRule",
    "FilmTimes",
    "FolderFrames",
    "FollowedHue",
    "Frame",
    "FrameFile",
    "Hand",
    "Highlight",
    "HueError",
    "Identified",
    "Layer",
    "Lens",
    "Level",
    "Lighting",
    "LiveFrames",
    "MarkFinder",
    "MarkHue",
    "Needle",
    "Outline",
    "PictureFolderFrames",
    "PlaneCamera",
    "Playback",
    "Pose",
    "RealCamera",
    "RealFrame",
    "RealMark",
    "RunFrame",
    "SegmentFrames",
    "SegmentWriter",
    "Sensor",
    "Shadow",
    "Source",
    "SourceError",
    "SourceEvent",
    "VideoFileFrames",
    "VideoWriter",
    "View",
    "Watch",
    "blood_layer",
    "board_text",
    "calibrate",
    "calibrate_together",
    "compress",
    "count_frames",
    "count_segment_frames",
    "detect_marks",
    "distractors",
    "draw_frame",
    "draw_real_frame",
    "drawn_run",
    "exposure_path",
    "find_board",
    "from_file",
    "grey_picture",
    "grey_pictures",
    "hand_layer",
    "hue_distance",
    "identify",
    "join_segments",
    "learn_hue",
    "light_of",
    "needle_layers",
    "open_source",
    "paper_camera",
    "plain_surface",
    "posed",
    "quiet_opencv",
    "reflectance",
    "rms",
    "segments_in",
    "sharp_frames",
    "shown_source",
    "squarely",
    "srgb_of",
    "tilted_view",
    "told_times",
]
