"""The moving picture: the frames of the time shown, at half speed, the resting target in both views."""

from pathlib import Path

import cv2
import numpy as np

from experiments.film.overlay import TARGET
from experiments.studies.readme.moving_picture import (
    NEAR,
    NEAR_CORNER_PX,
    NEAR_PX,
    PICTURE,
    SCENARIO,
    SIZE_PX,
    WHOLE_AT_PX,
    enlarged,
    write_moving_picture,
)
from vision import fronto_parallel_camera


def test_a_point_of_the_plane_is_enlarged_about_its_pixel() -> None:
    camera = fronto_parallel_camera("plain", (64, 48), (2.0, 2.0))
    image = np.zeros((48, 64, 3), np.uint8)
    image[20, 30] = 255  # u 30, v 20: (-1.5, 3.5) pixels of 2 mm from mid-picture
    larger, closer = enlarged(image, camera, np.array([-3e-3, 7e-3]), 4.0, (100.0, 50.0), (200, 100))
    assert np.unravel_index(larger[:, :, 0].argmax(), larger.shape[:2]) == (50, 100)
    assert np.allclose(closer.project([[-3e-3, 7e-3], [-2e-3, 7e-3]]), [[100.0, 50.0], [102.0, 50.0]])


def test_the_frames_show_the_target_at_rest_in_both_views(tmp_path: Path) -> None:
    still = SCENARIO.model_copy(update={"duration_s": 0.5, "pokes": None, "tremor": None})
    write_moving_picture(tmp_path / "moving.webp", still, (0.29, 0.41))
    read, film = cv2.imreadanimation(str(tmp_path / "moving.webp"))
    assert read
    assert (len(film.frames), list(film.durations)) == (4, [67] * 4)  # 0.3 to 0.4 s at 30 frames/s
    frame = film.frames[-1][:, :, :3].astype(int)
    assert frame.shape == (SIZE_PX[1], SIZE_PX[0], 3)
    near = [NEAR_CORNER_PX[k] + NEAR_PX[k] // 2 for k in (0, 1)]
    for u, v in (WHOLE_AT_PX, near):
        # half of the calibration's 0.68 px, enlarged ten times, is the most that the target is seen away from its rest
        part = frame[round(v) - int(NEAR) : round(v) + int(NEAR), round(u) - int(NEAR) : round(u) + int(NEAR)]
        assert (np.abs(part - TARGET).max(axis=2) < 90).any(), (u, v)


def test_the_picture_of_the_readme_is_small_enough() -> None:
    assert PICTURE.stat().st_size < 1.5e6
