import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from vision import LiveFrames, SourceError

IMAGE = np.zeros((4, 6, 3), dtype=np.uint8)


class Gated:
    """A camera that gives a frame each time the test lets it, n_frames of them."""

    def __init__(self, n_frames: int) -> None:
        self.n_frames, self.given, self.released = n_frames, 0, False
        self.let = threading.Semaphore(0)

    def read(self) -> tuple[bool, np.ndarray | None]:  # noqa: D102 - as OpenCV's
        self.let.acquire()
        self.given += 1
        return (True, IMAGE) if self.given <= self.n_frames else (False, None)

    def release(self) -> None:  # noqa: D102 - as OpenCV's
        self.released = True


def wait_until(condition: object, *, limit_s: float = 5.0) -> None:
    end = time.monotonic() + limit_s
    while not condition():  # type: ignore[operator]
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.002)


def test_the_newest_frame_wins_and_the_rest_are_counted() -> None:
    camera = Gated(6)
    with LiveFrames(lambda: camera) as live:
        frames = iter(live)
        camera.let.release()
        assert next(frames).index == 0
        for _ in range(4):
            camera.let.release()
        wait_until(lambda: live.frames_dropped == 3)
        assert next(frames).index == 4
        camera.let.release()
        assert next(frames).index == 5
        camera.let.release()
        assert list(frames) == []
        assert live.frames_dropped == 3
        wait_until(lambda: camera.released)


def test_exposure_is_the_clock_when_the_frame_came() -> None:
    ticks = iter(np.arange(100.0, 200.0))
    camera = Gated(2)
    with LiveFrames(lambda: camera, clock=lambda: float(next(ticks))) as live:
        frames = iter(live)
        seen = []
        for _ in range(2):
            camera.let.release()
            seen.append(next(frames).exposure_s)
    assert seen == [101.0, 102.0]  # 100 was the start


def test_a_silent_source_is_an_error_within_its_time() -> None:
    with LiveFrames(lambda: Gated(1), timeout_s=0.1) as live:
        began = time.monotonic()
        with pytest.raises(SourceError, match=r"live frames: expected a frame within 0.1 s, found none"):
            next(iter(live))
        assert time.monotonic() - began < 1.0


def test_close_ends_the_loop_even_while_the_camera_blocks() -> None:
    live = LiveFrames(lambda: Gated(1), timeout_s=30.0)
    threading.Timer(0.05, live.close).start()
    began = time.monotonic()
    assert list(live) == []
    assert time.monotonic() - began < 5.0


def test_what_goes_wrong_in_the_thread_is_raised_to_the_reader() -> None:
    class Broken:
        def read(self) -> tuple[bool, None]:
            raise OSError("bus error")

    with LiveFrames(Broken) as live, pytest.raises(OSError, match="bus error"):
        next(iter(live))


def test_a_source_that_does_not_open_is_told() -> None:
    class Shut(Gated):
        def isOpened(self) -> bool:  # noqa: N802 - OpenCV's name
            return False

    with LiveFrames(lambda: Shut(1)) as live, pytest.raises(SourceError, match="expected a camera or film that opens"):
        next(iter(live))


def test_a_film_is_paced_by_its_frame_rate() -> None:
    class Film(Gated):
        def get(self, _prop: int) -> float:
            return 25.0

    film = Film(4)
    now = [10.0]
    naps: list[float] = []

    def sleep(seconds: float) -> None:
        naps.append(seconds)
        now[0] += seconds

    with LiveFrames(lambda: film, paced=True, clock=lambda: now[0], sleep=sleep) as live:
        exposures = []
        frames = iter(live)
        for _ in range(4):
            film.let.release()
            exposures.append(next(frames).exposure_s)
    assert exposures == pytest.approx([10.0, 10.04, 10.08, 10.12])
    assert naps[:3] == pytest.approx([0.04] * 3)


def test_a_blocked_camera_does_not_keep_the_program_alive() -> None:
    program = (
        "import time, vision\n"
        "class Dead:\n    def read(self):\n        time.sleep(60)\n"
        "live = vision.LiveFrames(Dead, timeout_s=0.1)\n"
        "try:\n    next(iter(live))\nexcept vision.SourceError as error:\n    print(error)\n"
    )
    root = Path(__file__).parents[2]
    done = subprocess.run(
        [sys.executable, "-c", program],
        env={"PYTHONPATH": str(root)},
        capture_output=True,
        text=True,
        timeout=30,
        check=True,
    )
    assert done.stdout == "live frames: expected a frame within 0.1 s, found none\n"
    assert done.stderr == ""
