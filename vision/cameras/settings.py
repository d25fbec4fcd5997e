"""Settings of a calibration: requirements on boards, pictures and results."""

from __future__ import annotations

from dataclasses import dataclass, fields


@dataclass(frozen=True, slots=True)
class CalibrationSettings:
    """Settings of a calibration: requirements on boards, pictures and results.

    corner_window: half width of the window in which a corner is refined, relative to the least distance between two
        corners [1]; choice
    fewest_corners: least number of visible corners of a ChArUco board [1]; choice
    fewest_views: least number of pictures with the board [1]; source: [zhang2000] section 3.1, three views determine
        the camera matrix, and a fourth view shows whether they agree
    outlier_ratio: largest rms residual of a used picture, relative to the median over all pictures [1]; choice
    least_tilt_deg: least angle between the two most different orientations of the board [degrees]; choice: parallel
        boards give no more information than one board ([zhang2000] section 4)
    largest_focal_sd: largest relative standard error of a focal length [1]; choice. If it is larger, the views are too
        similar.
    together_px: largest increase of a camera's rms residual by the joint adjustment [px]; choice. If it is larger,
        pictures of equal name were not simultaneous.

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
