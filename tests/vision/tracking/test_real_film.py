"""The red pendulum of the real pictures: found once in every frame, where a person sees it."""

import numpy as np
import pytest

from tests.real_data import DATA
from vision import MarkHue, VideoFileFrames, detect_marks

FILM = DATA / "red-pendulum" / "ball.mp4"

RED, MIN_AREA_PX = MarkHue(0.0), 250.0
"""The defaults. Wall (hue 30) and most of the hand (hue 15 to 25) lie outside; the ball covers 790 px and more, red
spots on fingers less than 200."""


@pytest.mark.skipif(not FILM.is_file(), reason=f"no film {FILM.name}: set SOFTAIM_DATA to the folder of real pictures")
def test_the_red_ball_is_found_once_in_every_frame() -> None:
    counts, centers = [], []
    with VideoFileFrames(FILM) as film:
        for frame in film:
            found = detect_marks(frame.image, [RED], min_area_px=MIN_AREA_PX)
            counts.append(len(found))
            centers.append(found[0].center_px if found else np.array([np.nan, np.nan]))
    assert counts == [1] * 334
    # Read off enlarged frames by eye. The ball's top is white with stripes, so red's middle lies up to 6 px lower.
    by_eye = {28: (87.0, 490.0), 150: (229.0, 531.0), 250: (269.0, 528.0)}
    for index, place in by_eye.items():
        assert np.abs(centers[index] - place).max() < 6.0, (index, centers[index])
    # At rest at the end the cord still lets it swing a little: from frame to frame it moves less than 3 px.
    assert np.linalg.norm(np.diff(centers[260:], axis=0), axis=1).max() < 3.0
