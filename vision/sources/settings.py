"""Settings of sources: thresholds for faults, trust in a device's clock, frames of a film for a calibration."""

from __future__ import annotations

from dataclasses import dataclass, fields


@dataclass(frozen=True, slots=True)
class SourceSettings:
    """Settings of sources: thresholds for faults and for trust in a clock; frames of a film for a calibration.

    blocked_s: time without a new picture after which a source is blocked (no answer) or frozen (the same picture), and
    a device whose reads fail is reopened; `close` waits as long for a reading thread [s]; choice
    hung_s: time after which a read has hung: another thread opens the device, FFmpeg drops a packet; also the longest
    pause between two attempts to open a lost device [s]; choice
    opening_s: time after which opening a device has hung [s]; choice: some cameras need ten seconds
    stream_opening_s: time after which opening a stream has hung [s]; choice
    most_readers: largest number of hung threads, each with the device that it opened [1]; choice
    slow_intervals: number of usual frame intervals for which a slow camera may have no picture [1]; choice
    settled_frames: number of frames whose median interval is the usual one, and of plausible times after which a
    device's own times are trusted [1]; choice
    stuck_frames: after this many frames in a row without increasing times, arrival times are used; this many frames are
    sparse if they take twice their usual time [1]; source: a fault is to be reported within 200 ms
        or three frames
    clock_error_s: largest drift of a device's times from the arrival times [s]; choice
    uneven_s, uneven_share: largest deviation of an interval from a multiple of the usual one, in [s] and relative to
        the usual one [1], at which arrival times determine exposure times; the larger counts; choice
    even_s: time without uneven intervals, or without gaps, after which the fault that they cause ends [s]; choice
    remembered_frames: number of frames whose earliest arrival ties the device's clock to the monotonic one [1]; choice
    backlog: largest number of waiting frames of a device if every frame is to be delivered [1]; choice
    sharp_frames: number of equal parts of a film whose sharpest frames are used for a calibration [1]; choice

    Raises ValueError that names the invalid field.
    """

    blocked_s: float = 0.5
    hung_s: float = 2.0
    opening_s: float = 20.0
    stream_opening_s: float = 5.0
    most_readers: int = 4
    slow_intervals: float = 3.0
    settled_frames: int = 30
    stuck_frames: int = 3
    clock_error_s: float = 0.05
    uneven_s: float = 0.01
    uneven_share: float = 0.25
    even_s: float = 1.0
    remembered_frames: int = 300
    backlog: int = 64
    sharp_frames: int = 40

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not value > 0:
                raise ValueError(f"{field.name}: expected more than 0, found {value}")


DEFAULTS = SourceSettings()
