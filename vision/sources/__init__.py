"""Frame sources: films, folders, devices, streams; exposure times, faults, writers.

A new source or container belongs here.
"""

from vision.sources.events import EventKind, Source, SourceEvent, SourceOf
from vision.sources.every_frame import EveryFrame, FrameFile
from vision.sources.exposure_times import DeviceTimes, ExposureRule, FilmTimes, stated_exposure_time
from vision.sources.frames import (
    Closing,
    Exposure,
    FilePath,
    FolderFrames,
    Frame,
    SourceError,
    VideoFileFrames,
    count_frames,
    count_numbered,
    quiet_opencv,
)
from vision.sources.live import Capture, LiveFrames
from vision.sources.opening import from_file, open_source, shown_source
from vision.sources.picture_folder import PictureFolderFrames
from vision.sources.pictures import FILMS, grey_picture, grey_pictures, sharp_frames
from vision.sources.playback import Playback
from vision.sources.segments import (
    NOMINAL_FPS,
    SUFFIX,
    SegmentFrames,
    SegmentWriter,
    count_segment_frames,
    join_segments,
    segments_in,
)
from vision.sources.settings import SourceSettings
from vision.sources.several import TOGETHER_S, SeveralFrames, played_together
from vision.sources.video import Codec, VideoWriter, compress
from vision.sources.watchdog import FrozenValues, SourceWatchdog

__all__ = [
    "FILMS",
    "NOMINAL_FPS",
    "SUFFIX",
    "TOGETHER_S",
    "Capture",
    "Closing",
    "Codec",
    "DeviceTimes",
    "EventKind",
    "EveryFrame",
    "Exposure",
    "ExposureRule",
    "FilePath",
    "FilmTimes",
    "FolderFrames",
    "Frame",
    "FrameFile",
    "FrozenValues",
    "LiveFrames",
    "PictureFolderFrames",
    "Playback",
    "SegmentFrames",
    "SegmentWriter",
    "SeveralFrames",
    "Source",
    "SourceError",
    "SourceEvent",
    "SourceOf",
    "SourceSettings",
    "SourceWatchdog",
    "VideoFileFrames",
    "VideoWriter",
    "compress",
    "count_frames",
    "count_numbered",
    "count_segment_frames",
    "from_file",
    "grey_picture",
    "grey_pictures",
    "join_segments",
    "open_source",
    "played_together",
    "quiet_opencv",
    "segments_in",
    "sharp_frames",
    "shown_source",
    "stated_exposure_time",
]
