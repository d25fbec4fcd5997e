"""The film of a live run: whole at the end, in pieces after a kill, and never in the way of the loop."""

import shutil
import threading
from pathlib import Path

import cv2
import numpy as np
import pytest

import experiments.film.live_film
from experiments.film.live_film import WAITING, LiveFilm
from experiments.pipeline.line import Line
from experiments.pipeline.live.session import Session
from experiments.pipeline.recorder import PIECE_S, Recorder
from experiments.simulation.film import draw_in_space, film
from experiments.simulation.simulate import scene_of, true_motion
from tests.experiments.command import softaim
from tests.experiments.in_space import breast
from tests.experiments.rows import complaint
from tests.experiments.webcam import coarse_webcam
from vision import Exposure, Frame, Lighting, SpaceCamera, count_frames


@pytest.fixture(scope="module")
def frames() -> list[Frame]:
    scenario = coarse_webcam().model_copy(update={"duration_s": 1.1})
    rng = np.random.default_rng(1)
    scene = scene_of(scenario)
    truth = true_motion(scene.network, scenario, rng)
    images = film(scenario, scene, truth, rng)
    return [Frame(k, float(t), image) for k, (t, image) in enumerate(zip(truth.times_s, images, strict=True))]


def line() -> Line:
    return Line(scene_of(coarse_webcam()), baseline=False, explain=True)


def taken(one: LiveFilm, frames: list[Frame]) -> None:
    """Hand over frames, each when the thread has written the one before."""
    own = line()
    for k, frame in enumerate(frames):
        one.take(frame, own, own.see(frame.exposure_s, frame.image))
        while one.n_written + one.n_dropped <= k and one.fault is None:
            threading.Event().wait(1e-3)


def test_the_loop_never_waits_and_the_oldest_frames_go(frames, tmp_path, monkeypatch) -> None:
    held = threading.Event()
    draw = experiments.film.live_film.drawn

    def slow(image: np.ndarray, overlay: object) -> np.ndarray:
        held.wait(60.0)
        return draw(image, overlay)

    monkeypatch.setattr(experiments.film.live_film, "drawn", slow)
    out = tmp_path / "out"
    out.mkdir()
    one, own = LiveFilm(line().scene, tmp_path / "out-film"), line()
    steps = [(frame, own.see(frame.exposure_s, frame.image)) for frame in frames[:30]]
    one.take(steps[0][0], own, steps[0][1])
    while one._threads[""]._waiting:  # until the thread holds the first
        threading.Event().wait(1e-3)
    for frame, step in steps[1:]:
        one.take(frame, own, step)  # comes back although the thread stands still
    assert one.n_dropped == 29 - WAITING
    held.set()
    one.finish(out)
    assert one.n_written == 1 + WAITING
    assert count_frames(out / "film.avi") == 1 + WAITING


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), cv2.error("No space left")])
def test_what_fails_in_the_thread_ends_the_film_and_not_the_run(frames, tmp_path, monkeypatch, error) -> None:
    def full(*_given: object) -> None:
        raise error

    monkeypatch.setattr(Recorder, "take", full)
    one = LiveFilm(line().scene, tmp_path / "out-film")
    session = Session(line().scene, tmp_path / "estimates.csv", lambda _text: None, watch=one)
    for frame in frames[:10]:
        assert session.take(frame)
    one._threads[""]._thread.join(30.0)
    session.take(frames[10])
    assert session.counters.frames == 11
    assert "No space left" in str(one.fault)
    session.close()


def test_a_folder_in_which_a_killed_run_left_its_film_is_not_written_over(tmp_path) -> None:
    (tmp_path / "out-film").mkdir()
    assert "softaim record --recover" in complaint(LiveFilm, line().scene, tmp_path / "out-film")


@pytest.fixture(scope="module")
def exposures() -> list[Exposure]:
    """A body at rest before two cameras for 1.2 s; every third exposure is of the left one alone."""
    scene, rng = breast(), np.random.default_rng(1)
    images = {
        camera.name: draw_in_space(scene, camera, scene.network.positions, Lighting(), rng)
        for camera in scene.space_cameras
    }
    return [Exposure(0.1 * k, images if k % 3 else {"left": images["left"]}) for k in range(13)]


def filmed_in_space(exposures: list[Exposure], folder: Path) -> LiveFilm:
    """The film, not finished, of a live run that used all exposures."""
    one = LiveFilm(breast(), folder / "out-film")
    session = Session(breast(), folder / "estimates.csv", lambda _text: None, watch=one, clock=lambda: 2.0)
    n_pictures = 0
    for exposure in exposures:
        assert session.take(exposure)
        n_pictures += len(exposure.images)
        while one.n_written + one.n_dropped < n_pictures and one.fault is None:
            threading.Event().wait(1e-3)
    session.close()
    return one


def around(picture: np.ndarray, camera: SpaceCamera, node: str) -> np.ndarray:
    """The part of a picture in which the camera sees a node of the body."""
    scene = breast()
    u, v = camera.project(scene.network.positions[scene.network.index(node)])[0].round().astype(int)
    return picture[v - 12 : v + 13, u - 12 : u + 13]


def coloured(picture: np.ndarray, camera: SpaceCamera, node: str) -> int:
    """The number of colourful pixels about a node."""
    return int((np.ptp(around(picture, camera, node), axis=-1) > 120).sum())


def test_in_space_each_camera_has_a_live_film_also_after_a_kill(exposures, tmp_path) -> None:
    """The target is yellow where the body has it; the five of six marks that face a camera are ringed."""
    out, scene, n_pictures = tmp_path / "out", breast(), {"left": 13, "right": 8}
    out.mkdir()
    one = filmed_in_space(exposures, tmp_path)
    shutil.copytree(one.growing, tmp_path / "killed")
    one.finish(out)
    assert (one.n_written, one.n_dropped, one.fault) == (21, 0, None)
    assert one.written == [out / "film.left.avi", out / "film.right.avi"]
    assert (out / "worst.png").exists()
    assert not one.growing.exists()
    for camera in scene.space_cameras:
        assert count_frames(out / f"film.{camera.name}.avi") == n_pictures[camera.name]
        film = cv2.VideoCapture(str(out / f"film.{camera.name}.avi"))
        film.set(cv2.CAP_PROP_POS_FRAMES, n_pictures[camera.name] - 1)
        frame, plain = film.read()[1].astype(int), exposures[-2].images[camera.name].astype(int)

        blue, green, red = np.moveaxis(around(frame, camera, scene.target.node), -1, 0)
        assert ((green - blue > 80) & (red - blue > 80)).any()
        before, after = (
            [coloured(picture, camera, node) for node in scene.measured_nodes] for picture in (plain, frame)
        )
        ringed = [b > a + 20 for a, b in zip(before, after, strict=True) if a > 10]
        assert ringed == [True] * 5
    assert cv2.VideoCapture(str(out / "film.left.avi")).get(cv2.CAP_PROP_FPS) == pytest.approx(10.0, rel=0.01)
    assert softaim("record", "--recover", tmp_path / "killed") == 0
    for name in n_pictures:
        times_s = [one.exposure_s for one in exposures if name in one.images]
        n_kept = count_frames(tmp_path / "killed" / f"video.{name}.avi")
        assert times_s[-1] - times_s[n_kept - 1] < PIECE_S + 0.2


def test_a_fault_in_the_film_of_one_camera_does_not_end_the_other(exposures, tmp_path, monkeypatch) -> None:
    take = Recorder.take

    def full(recorder: Recorder, frame: Frame) -> None:
        if recorder.folder.name == "segments.left":
            raise OSError(28, "No space left on device")
        take(recorder, frame)

    monkeypatch.setattr(Recorder, "take", full)
    out = tmp_path / "out"
    out.mkdir()
    one = filmed_in_space(exposures, tmp_path)
    one.finish(out)
    assert "No space left" in str(one.fault)
    assert [path.name for path in out.glob("film*")] == ["film.right.avi"]
    assert count_frames(out / "film.right.avi") == 8
