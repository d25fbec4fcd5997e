"""Light: cameras, marks found by hue, which mark is which, frame sources, drawn frames.

Image axes: u right, v down, the centre of the first pixel is (0, 0). Names of lengths in a picture
end in _px; the plane is in metres.
"""

from vision.camera import PlaneCamera, squarely
from vision.detect import Detection, HueError, detect_marks
from vision.draw import Disc, Lighting, distractors, draw_frame, paper_camera
from vision.every_frame import EveryFrame, FrameFile
from vision.exposure_times import DeviceTimes, ExposureRule, FilmTimes, told_times
from vision.hues import MarkHue, hue_distance
from vision.identify import Expected, Identified, identify
from vision.live import Capture, LiveFrames
from vision.open_source import EVERY, from_file, open_source, shown_source
from vision.picture_folder import PictureFolderFrames
from vision.playback import Playback
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
from vision.sources import FolderFrames, Frame, SourceError, VideoFileFrames, count_frames
from vision.video import Codec, VideoWriter, compress
from vision.watch import Watch

__all__ = [
    "EVERY",
    "NOMINAL_FPS",
    "SUFFIX",
    "Capture",
    "Codec",
    "Detection",
    "DeviceTimes",
    "Disc",
    "EventKind",
    "EveryFrame",
    "Expected",
    "ExposureRule",
    "FilmTimes",
    "FolderFrames",
    "Frame",
    "FrameFile",
    "HueError",
    "Identified",
    "Lighting",
    "LiveFrames",
    "MarkHue",
    "PictureFolderFrames",
    "PlaneCamera",
    "Playback",
    "SegmentFrames",
    "SegmentWriter",
    "Source",
    "SourceError",
    "SourceEvent",
    "VideoFileFrames",
    "VideoWriter",
    "Watch",
    "compress",
    "count_frames",
    "count_segment_frames",
    "detect_marks",
    "distractors",
    "draw_frame",
    "from_file",
    "hue_distance",
    "identify",
    "join_segments",
    "open_source",
    "paper_camera",
    "segments_in",
    "shown_source",
    "squarely",
    "told_times",
]
