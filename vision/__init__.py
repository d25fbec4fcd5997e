"""Light: cameras, marks found by hue, which mark is which, frame sources, drawn frames.

Image axes: u right, v down, the centre of the first pixel is (0, 0). Names of lengths in a picture
end in _px; the plane is in metres.
"""

from vision.board import DICTIONARIES, Board, Corners, find_board
from vision.bundle import CalibrationError
from vision.calibration import Calibration, View, board_text, calibrate, rms
from vision.camera import PlaneCamera, posed, squarely
from vision.detect import Detection, HueError, detect_marks
from vision.draw import Disc, Lighting, distractors, draw_frame, paper_camera
from vision.finder import MarkFinder
from vision.following import FollowedHue
from vision.hues import MarkHue, hue_distance
from vision.identify import Expected, Identified, identify
from vision.learning import learn_hue
from vision.lens import Lens, Pose
from vision.live import LiveFrames
from vision.outline import Outline
from vision.pictures import FILMS, SHARP_FRAMES, grey_picture, grey_pictures, sharp_frames
from vision.rig import CameraViews, calibrate_together
from vision.sources import FolderFrames, Frame, SourceError, VideoFileFrames, count_frames, quiet_opencv
from vision.video import VideoWriter, compress

__all__ = [
    "DICTIONARIES",
    "FILMS",
    "SHARP_FRAMES",
    "Board",
    "Calibration",
    "CalibrationError",
    "CameraViews",
    "Corners",
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
    "View",
    "board_text",
    "calibrate",
    "calibrate_together",
    "compress",
    "count_frames",
    "detect_marks",
    "distractors",
    "draw_frame",
    "find_board",
    "grey_picture",
    "grey_pictures",
    "hue_distance",
    "identify",
    "learn_hue",
    "paper_camera",
    "posed",
    "quiet_opencv",
    "rms",
    "sharp_frames",
    "squarely",
]
