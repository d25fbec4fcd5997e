"""The phantom's camera in another process: pictures at their times, and nothing left when it is released."""

import time
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from experiments.errors import InputError
from experiments.formats.scenario import read_scenario
from experiments.pipeline.frame_sources import open_source
from experiments.simulation.phantom_camera import PhantomCamera
from experiments.simulation.phantom_process import SCENARIO, PhantomProcess
from tests.experiments.webcam import coarse_webcam


def clocked() -> tuple[PhantomCamera, list[float], list[float]]:
    """A camera by a clock of the test's own, that clock [s], and how long it slept each time [s]."""
    now, waits = [100.0], []

    def sleep(seconds: float) -> None:
        waits.append(seconds)
        now[0] += seconds

    return PhantomCamera(coarse_webcam(), clock=lambda: now[0], sleep=sleep), now, waits


def moved(n_frames: int) -> np.ndarray:
    """Where all nodes are in so many frames [m], (n_frames, n_nodes, 2)."""
    camera, places = clocked()[0], []
    for _ in range(n_frames):
        assert camera.grab()
        places.append(camera.positions)
    return np.array(places)


def test_a_folder_of_the_phantoms_name_does_not_hide_it(tmp_path, monkeypatch):
    (tmp_path / "phantom").mkdir()
    (tmp_path / "phantom" / "scene.toml").touch()  # as in a project of that name
    monkeypatch.chdir(tmp_path)
    scene, _ = open_source("phantom", None, live=True, phantom=PhantomProcess.__new__(PhantomProcess))
    assert scene is not None
    with pytest.raises(InputError, match="found none"):
        open_source("./phantom", None, live=True)


@pytest.mark.slow
def test_pictures_come_at_times_that_this_process_shares():
    """17 a second; the usual 30 are tested below, by a clock of the test's own."""
    opened_s = time.monotonic()
    camera = PhantomProcess(fps=17.0).opened()
    try:
        times, means = [], []
        for _ in range(4):
            assert camera.grab()
            read, image = camera.retrieve()
            assert read
            assert image.shape == (480, 640, 3)
            assert image.flags.writeable
            times.append(1e-3 * camera.get(cv2.CAP_PROP_POS_MSEC))
            means.append(image.mean())
    finally:
        camera.release()
    assert opened_s < times[0] < times[-1] < time.monotonic()
    in_intervals = np.diff(times) * 17.0
    np.testing.assert_allclose(in_intervals, np.rint(in_intervals), atol=1e-3)
    assert min(in_intervals) > 0.5
    assert min(means) > 100.0  # the light ground of the plain frames
    assert not camera._process.is_alive()
    assert not camera.grab()


def test_the_phantom_is_a_source_of_live_frames():
    """Here by a phantom in this process; the other process is tested above."""
    scenario = read_scenario(SCENARIO)
    here = SimpleNamespace(opened=lambda: PhantomCamera(scenario))
    scene, frames = open_source("phantom", None, live=True, phantom=here)
    with frames:
        frame = next(seen for _ in range(120) if (seen := frames.next(0.5)) is not None)
    assert scene is not None
    assert frame.image.shape[:2] == scene.cameras[0].size_px[::-1]
    assert scene.steps[-1].step == "simulate"


@pytest.mark.parametrize(("away_s", "n_moved"), [(0.25, 7), (0.99, 29), (60.0, 1)])
def test_the_phantom_makes_up_for_a_moment_and_stood_still_in_a_longer_one(away_s, n_moved):
    """Pictures are of now in either case: the phantom has moved by so many frames since the one before."""
    camera, now, _ = clocked()
    assert camera.grab()
    now[0] += away_s + 1e-6
    assert camera.grab()
    assert camera.time_s == pytest.approx((1 + n_moved) / 30)
    assert now[0] - 1e-3 * camera.get(cv2.CAP_PROP_POS_MSEC) == pytest.approx(0.0, abs=1 / 30)


def test_a_picture_is_there_when_it_is_due_however_long_it_is_drawn(monkeypatch):
    """Of 20 ms a picture: no latency of the simulation is in that of what sees it."""
    camera, now, waits = clocked()

    def slowly(*_: object, **_strays: object) -> np.ndarray:
        now[0] += 0.02
        return np.zeros((480, 640, 3), np.uint8)

    monkeypatch.setattr("experiments.simulation.phantom_camera.draw", slowly)
    for k in range(4):
        assert camera.grab()
        assert camera.retrieve()[1].shape == (480, 640, 3)
        assert now[0] == pytest.approx(100.0 + (k + 1) / 30)
        assert camera.get(cv2.CAP_PROP_POS_MSEC) == pytest.approx(1e3 * now[0])
    assert waits == pytest.approx([1 / 30 - 0.02] * 4)


def test_the_phantom_goes_on_when_its_forces_come_again(monkeypatch):
    """Of half a second here: after two seconds it still moves."""
    monkeypatch.setattr("experiments.simulation.phantom_camera.COMES_AGAIN_S", 0.5)
    places = moved(60)
    assert np.ptp(places[:15], axis=0).max() > 1e-5
    assert np.ptp(places[45:], axis=0).max() > 1e-5


def test_the_phantom_moves_as_by_an_exact_integrator(monkeypatch):
    """Within 3 µm, a tenth of what its marks are found to, over 1.5 s with pokes."""
    found = moved(45)
    for name, value in (("RTOL", 1e-9), ("ATOL", 1e-11)):
        monkeypatch.setattr(f"experiments.simulation.phantom_camera.{name}", value)
    exact = moved(45)
    assert np.ptp(exact, axis=0).max() > 5e-3
    np.testing.assert_allclose(found, exact, rtol=0.0, atol=3e-6)
