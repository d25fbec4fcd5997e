"""Settings of a calibration: valid boards, pictures and results."""

from __future__ import annotations

from dataclasses import dataclass, fields


@dataclass(frozen=True, slots=True)
class CalibrationSettings:
    """Settings of a calibration: valid boards, pictures and results.

    corner_window: half width of the window in which a corner is refined, relative to the least distance of corners [1];
        choice
    fewest_corners: least number of visible corners of a ChArUco board [1]; choice
    fewest_views: least number of pictures with the board [1]; source: [zhang2000] section 3.1, three views determine
        the camera matrix, and one more shows whether they agree
    outlier_ratio: a picture is omitted if its rms residual exceeds this many times the median of all [1]; choice
    least_tilt_deg: angle by which at least two boards must differ [degrees]; choice: parallel boards determine no more
    than one board ([zhang2000] section 4)
    largest_focal_sd: relative standard error of a focal length above which pictures are too similar [1]; choice
    together_px: pictures of one name were not simultaneous if the joint adjustment raises a camera's rms by more than
        this [px]; choice

    Raises ValueError that names the invalid field.
    """

    corner_window: float = 0.3
    fewest_corners: int = 8
    fewest_views: int = 4
    outlier_ratio: float = 3.0
    least_tilt_deg: float = 10.0
    largest_focal_sd: float = 0.05
    together_px: float = 1.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not value > 0:
                raise ValueError(f"{field.name}: expected more than 0, found {value}")


DEFAULTS = CalibrationSettings()
