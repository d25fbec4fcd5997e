"""Settings of sources."""

from __future__ import annotations

from dataclasses import dataclass, fields


@dataclass(frozen=True, slots=True)
class SourceSettings:
    """Settings of sources: thresholds for faults, use of a device's clock, frames of a film for a calibration.

    The usual interval is the median interval between the last settled_frames frames.
    blocked_s: a source is blocked if no read returns for this time [s], frozen if one picture repeats for this time;
        it is reopened if reads fail for this time; choice. It is also the longest duration of `close`.
    hung_s: duration of a read [s] after which another thread opens the device, and FFmpeg ends the read of a stream;
        choice. It is also the longest pause between two attempts to open a lost device.
    opening_s: duration of the opening of a device after which another thread opens it [s]; choice: some cameras need
        ten seconds
    stream_opening_s: duration of the opening of a stream after which it fails [s]; choice
    most_readers: largest number of reading threads, including threads that hang [1]; choice
    slow_intervals: longest gap between pictures that is no fault, in usual intervals [1]; choice
    settled_frames: number of frames for the usual interval [1]; choice. As many plausible device times in a row are
        needed before device times are used.
    stuck_frames: number of frames in a row without an increasing time after which arrival times are used [1]; source: a
        fault is to be reported within 200 ms or three frames. The test for lost pictures uses as many frames.
    clock_error_s: largest variation of the delay between a device's times and arrival times [s]; choice
    uneven_s, uneven_share: arrival times do not determine exposure times if an interval differs from each multiple of
        the usual interval by more than uneven_s [s] and by more than uneven_share usual intervals [1]; choice
    even_s: time without uneven intervals, or without gaps, after which the fault ends [s]; choice
    remembered_frames: number of last frames whose least delay relates the device's clock to the monotonic clock [1];
        choice
    backlog: largest number of waiting frames of a device if every frame is to be delivered [1]; choice
    sharp_frames: number of equal parts of a film; the sharpest frame of each part is used for a calibration [1]; choice

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
