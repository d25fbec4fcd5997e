"""A ball before a plane that is turned from the picture: found where it is, as a disc there is not."""

import numpy as np
import pytest

from experiments.film.taken import kinds_of
from experiments.formats.scene.scene import Mark, Scene, Target
from experiments.pipeline.line import Line
from experiments.simulation.film import draw
from tests.networks import build_network
from vision import Disc, Lighting, PlaneCamera, draw_frame

FOCAL_PX, AWAY_M, TURN_RAD, RADIUS_M = 800.0, 1.0, np.radians(45.0), 0.02
PLACE_M = np.array([0.0, -0.1])
RADIUS_PX = FOCAL_PX * RADIUS_M / AWAY_M


def turned() -> PlaneCamera:
    """A pinhole 1 m from the origin of a plane that is turned about the vertical; mid-picture, which shows PLACE_M."""
    across, down = np.cos(TURN_RAD), np.sin(TURN_RAD)
    onto = np.array([[across, 0.0, 0.0], [0.0, -1.0, PLACE_M[1]], [down, 0.0, AWAY_M]])
    lens = np.array([[FOCAL_PX, 0.0, 319.5], [0.0, FOCAL_PX, 239.5], [0.0, 0.0, 1.0]])
    return PlaneCamera("front", (640, 480), lens @ onto, calibration_sd_px=0.1)


def hanging(ball: bool) -> Scene:
    """A ball, or a disc of the plane, of 16 px in the picture's middle, on a spring."""
    constants = {"masses": 0.05, "stiffness": 60.0, "rest_lengths": 0.1 - 0.05 * 9.81 / 60.0, "damping": 0.5}
    network = build_network([[0.0, 0.0], PLACE_M], [[0, 1]], [0], ["hook", "ball"], gravity=[0.0, -9.81], **constants)
    mark = Mark("ball", 0.0, 2.0 * RADIUS_M, even=False, ball=ball)
    return Scene(network, (mark,), Target("ball", RADIUS_M), (turned(),))


def seen_px(scene: Scene) -> np.ndarray:
    """Where the mark is found [px], (10, 2), in pictures of a ball whose upper left is white, as a highlight is."""
    camera, rng = scene.cameras[0], np.random.default_rng(0)
    (center,), line, found = camera.project(PLACE_M), Line(scene, baseline=False), []
    whole = Disc(center, (RADIUS_PX, RADIUS_PX), 0.0)
    for k in range(10):
        picture = draw_frame(camera.size_px, [whole], Lighting(), rng)
        v, u = np.mgrid[: picture.shape[0], : picture.shape[1]]
        white = (u - center[0] + v - center[1] < -0.6 * RADIUS_PX) & (
            np.hypot(u - center[0], v - center[1]) < RADIUS_PX
        )
        picture[white] = 230
        (mark,) = line.see(k / 30.0, picture).marks
        found.append(camera.project(mark.position)[0])
    return np.array(found)


def test_a_ball_is_found_in_its_middle():
    """To 0.3 px; looked for as a disc, which is 11 px wide and 16 high, it is found 3 px aside or more."""
    np.testing.assert_allclose(turned().project(PLACE_M)[0], [319.5, 239.5], atol=1e-9)
    errors = np.hypot(*(seen_px(hanging(ball=True)) - [319.5, 239.5]).T)
    assert errors.max() < 0.3
    assert np.hypot(*(seen_px(hanging(ball=False)) - [319.5, 239.5]).T).min() > 3.0


def test_a_ball_is_simulated_and_expected_as_large_as_it_is():
    """16 px of radius: the area that its colour takes by the scene, and in a picture that is simulated."""
    scene, area = hanging(ball=True), np.pi * RADIUS_PX**2
    assert kinds_of(scene)[0].area_px == pytest.approx(area, rel=1e-9)
    picture = draw(scene, scene.network.positions, Lighting(), np.random.default_rng(0), strays=[]).astype(float)
    red = picture[..., 2] - picture[..., 1]
    assert (red > red.max() / 2.0).sum() == pytest.approx(area, rel=0.05)
