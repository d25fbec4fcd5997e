"""Settings of sources."""

from __future__ import annotations

from dataclasses import dataclass, fields


@dataclass(frozen=True, slots=True)
class SourceSettings:
    """Settings of sources: thresholds for faults, use of a device's clock, frames of a film for a calibration.

    The median interval is the median of the intervals between the last settled_frames frames.
    blocked_s: time limit for faults [s]; choice. If no read returns for this time, the source is blocked. If only one
        picture repeats for this time, the source is frozen. If all reads fail for this time, the source is reopened.
        `close` takes at most this time.
    hung_s: longest duration of a read [s]; choice. After this time, another thread opens the device, or the read of a
        stream fails. It is also the longest pause between two attempts to open a lost device.
    opening_s: time after which another thread opens a device whose opening has not ended [s]; choice: some cameras need
        ten seconds
    stream_opening_s: longest duration of the opening of a stream, which then fails [s]; choice
    most_readers: largest number of reading threads, including threads that hang [1]; choice
    slow_intervals: longest interval that is not a fault, relative to the median interval [1]; choice
    settled_frames: number of frames for the median interval [1]; choice. Device times are used after this number of
        plausible device times in a row.
    stuck_frames: number of successive frames without increasing times after which arrival times are used [1]; source: a
        fault is to be reported within 200 ms or three frames. The test for lost pictures uses this number of intervals.
    clock_error_s: largest variation of the delay, which is the arrival time minus the device time [s]; choice
    uneven_s, uneven_share: largest deviation of an even interval from a multiple of the median interval, as a time [s]
        and as a share of the median interval [1]; choice. The larger one applies. After an uneven interval, arrival
        times do not determine exposure times.
    even_s: time without uneven intervals, or without lost pictures, after which the fault ends [s]; choice
    remembered_frames: number of last frames among which the least delay is searched [1]; choice. The least delay is
        taken as the offset between the device's clock and the monotonic clock.
    backlog: largest number of frames of a device that wait if every frame is to be delivered [1]; choice
    sharp_frames: number of frames of a film that a calibration uses [1]; choice. The film is divided into this number
        of equal parts, and the sharpest frame of each part is used.

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
