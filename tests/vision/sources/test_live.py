"""Live frames from captures that fail as real ones do. Faults are timed by the test's own clock."""

import subprocess
import sys
import threading
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.vision.sources.scripted import Clock, Scripted, Ticking, opened, wait_until
from vision import EventKind, LiveFrames, Playback, SourceError, stated_exposure_time
from vision.sources.frames import Frame

IMAGE = np.zeros((4, 6, 3), dtype=np.uint8)


def picture(k: int, size_px: tuple[int, int] = (6, 4)) -> np.ndarray:
    return np.full((size_px[1], size_px[0], 3), k % 250, dtype=np.uint8)


def next_frame(live: LiveFrames) -> Frame:
    """The next frame, by a clock that stands."""
    found: list[Frame] = []

    def came() -> bool:
        frame = live.next(0.0)
        found.extend([] if frame is None else [frame])
        return frame is not None

    wait_until(came)
    return found[0]


def kinds(live: LiveFrames) -> list[EventKind]:
    return [event.kind for event in live.take_events()]


def test_the_newest_frame_wins_and_the_rest_are_counted() -> None:
    clock, camera = Clock(), Scripted(picture(0))
    with opened(camera, clock=clock) as live:
        assert next_frame(live).index == 0
        for k in range(1, 5):
            clock.now += 0.1
            n = live.frames_dropped
            camera.give(picture(k))
            wait_until(lambda: camera.waits)
            assert live.frames_dropped == n + (k > 1)
        assert next_frame(live).index == 4
        assert live.frames_dropped == 3
    wait_until(lambda: camera.released.is_set() or not camera.give(None))


def test_a_read_that_blocks_is_reported_in_its_time_and_no_frame_is_made_up() -> None:
    clock, camera = Clock(), Scripted(picture(0))
    with opened(camera, clock=clock) as live:
        next_frame(live)
        clock.now += 0.5
        assert live.next(0.0) is None
        assert kinds(live) == []
        clock.now += 0.01
        assert live.next(0.0) is None
        assert kinds(live) == [EventKind.BLOCKED]
        camera.give(picture(1))
        assert next_frame(live).exposure_s > 100.0
        assert kinds(live) == [EventKind.RESUMED]


def test_a_device_that_hangs_is_reopened_and_the_old_read_is_not_taken_when_it_comes_back() -> None:
    clock, dead, alive = Clock(), Scripted(picture(0)), Scripted()
    with opened(dead, alive, clock=clock) as live:
        next_frame(live)
        wait_until(lambda: dead.waits)
        clock.now += 2.1
        assert live.next(0.0) is None
        alive.give(picture(1))
        assert next_frame(live).image[0, 0, 0] == 1
        assert kinds(live) == [EventKind.BLOCKED, EventKind.RESUMED]
        dead.give(picture(2))  # comes back after all
        assert dead.released.wait(120.0)
        clock.now += 0.1
        alive.give(picture(3))
        assert next_frame(live).image[0, 0, 0] == 3


@pytest.mark.parametrize("reopened", [False, True])
def test_after_a_pause_pictures_may_be_late_but_not_those_of_a_device_reopened(reopened: bool) -> None:
    clock, first, other = Clock(), Scripted(), Scripted()
    with opened(first, other, clock=clock) as live:
        for k in range(20):
            clock.now += 0.1
            first.give(picture(k))
            next_frame(live)
        wait_until(lambda: first.waits)
        clock.now += 2.1
        assert live.next(0.0) is None
        wait_until(lambda: other.n_asked)  # both are asked now
        (other if reopened else first).give(picture(20))
        next_frame(live)
        assert live.late_s == (0.0 if reopened else pytest.approx(2.0))


def test_threads_that_hang_are_few() -> None:
    clock = Clock()
    dead = [Scripted(picture(0)), *(Scripted() for _ in range(9))]
    with opened(*dead, clock=clock) as live:
        next_frame(live)
        before = threading.active_count()
        for _ in range(9):
            clock.now += 30.0
            live.next(0.0)
        assert threading.active_count() <= before + 3


def test_a_frozen_picture_is_never_delivered_and_reported_in_its_time() -> None:
    clock, camera = Clock(), Scripted(picture(7))
    with opened(camera, clock=clock) as live:
        next_frame(live)
        for _ in range(6):
            clock.now += 0.1
            camera.give(picture(7))
            wait_until(lambda: camera.waits)
            assert live.next(0.0) is None
        assert kinds(live) == [EventKind.FROZEN]
        clock.now += 0.1
        one_pixel = picture(7)
        one_pixel[3, 5, 2] += 1
        camera.give(one_pixel)
        assert next_frame(live).index == 1
        assert kinds(live) == [EventKind.RESUMED]


@pytest.mark.parametrize("failure", [None, "no picture", OSError("bus error"), cv2.error("bus error")])
def test_a_read_that_fails_once_costs_no_more_than_itself(failure: object) -> None:
    clock, camera = Clock(), Scripted(picture(0))
    with opened(camera, clock=clock) as live:
        next_frame(live)
        clock.now += 0.1
        camera.give(failure, picture(1))  # type: ignore[arg-type]
        assert next_frame(live).index == 1
        assert kinds(live) == [EventKind.DROPPED, EventKind.RESUMED]
        assert not camera.released.is_set()


def test_a_device_that_goes_is_opened_again_until_it_is_back() -> None:
    clock, first, back = Clock(), Scripted(picture(0)), Scripted(picture(1))
    with opened(first, Scripted(opens=False), Scripted(opens=False), back, clock=clock) as live:
        next_frame(live)
        clock.now += 0.1
        first.give(None)
        wait_until(lambda: not first.answers)
        wait_until(lambda: kinds(live) == [EventKind.DROPPED])
        clock.now += 0.6
        first.give(*[None] * 3)
        assert next_frame(live).image[0, 0, 0] == 1
        assert first.released.is_set()
        assert kinds(live) == [EventKind.RESUMED]


def test_another_size_is_reported_and_delivered() -> None:
    clock, camera = Clock(), Scripted(picture(0))
    with opened(camera, clock=clock) as live:
        next_frame(live)
        clock.now += 0.1
        camera.give(picture(0, (8, 8)))
        assert next_frame(live).image.shape == (8, 8, 3)
        assert kinds(live) == [EventKind.RESIZED]


def test_it_gives_up_when_it_is_asked_to_and_not_before() -> None:
    clock, camera = Clock(), Scripted(picture(0))
    with opened(camera, clock=clock, give_up_s=3.0) as live:
        next_frame(live)
        clock.now += 3.0
        assert live.next(0.0) is None
        clock.now += 0.01
        with pytest.raises(SourceError, match="live frames: expected a new frame within 3 s, found none"):
            live.next(0.0)
        assert live.ended
        assert live.next(0.0) is None


def test_next_comes_back_in_its_time() -> None:
    clock, camera = Ticking(), Scripted()
    with LiveFrames(lambda: camera, clock=clock) as live:
        wait_until(lambda: camera.waits)  # from here on the reading thread leaves the clock alone
        began = clock.now
        assert live.next(0.05) is None
        assert 0.05 <= clock.now - began <= 0.05 + 2 * Ticking.STEP_S


def test_close_ends_the_loop_even_while_the_camera_blocks() -> None:
    clock, camera = Ticking(), Scripted()
    live = LiveFrames(lambda: camera, clock=clock)
    wait_until(lambda: camera.waits)
    began, seen = clock.now, list[list[Frame]]()
    loop = threading.Thread(target=lambda: seen.append(list(live)), daemon=True)
    loop.start()
    wait_until(lambda: clock.now > began)
    live.close()
    loop.join(120.0)
    assert seen == [[]]


@pytest.mark.parametrize(
    ("capture", "fault", "message"),
    [
        (Scripted(opens=False), SourceError, "expected a camera, stream or film that gives frames, found none"),
        (Scripted(ZeroDivisionError("a bug")), ZeroDivisionError, "a bug"),
    ],
)
def test_what_is_wrong_with_source_or_program_is_raised_to_the_reader(capture, fault, message) -> None:
    with LiveFrames(lambda: capture) as live, pytest.raises(fault, match=message):
        next(iter(live))


FILM = {"ends": lambda _capture: True, "exposures": lambda: stated_exposure_time, "may_repeat": True, "keep": 3}


def test_what_waits_begins_when_it_is_first_asked_for_a_frame() -> None:
    """However long that takes: no frame is missed, and it was not blocked."""
    clock, opened = Clock(), []

    def opens() -> Playback:
        opened.append(clock.now)
        return Playback([Frame(k, 0.01 * k, IMAGE) for k in range(3)], clock=clock, sleep=lambda _seconds: None)  # type: ignore[arg-type]

    with LiveFrames(opens, clock=clock, waits=True, **FILM) as live:  # type: ignore[arg-type]
        clock.now += 60.0
        assert not opened
        assert len(list(live)) == 3
        assert live.frames_dropped == 0
        assert [event.kind for event in live.take_events()] == [EventKind.ENDED]


def test_a_blocked_camera_does_not_keep_the_program_alive() -> None:
    program = (
        "import time, vision\n"
        "class Dead:\n"
        "    def isOpened(self):\n        return True\n"
        "    def get(self, prop):\n        return 0.0\n"
        "    def release(self):\n        pass\n"
        "    def grab(self):\n        time.sleep(3600)\n"
        "live = vision.LiveFrames(Dead, give_up_s=0.05)\n"
        "try:\n    next(iter(live))\nexcept vision.SourceError as error:\n    print(error)\n"
    )
    root = Path(__file__).parents[3]
    command, env = [sys.executable, "-c", program], {"PYTHONPATH": str(root)}
    done = subprocess.run(command, env=env, capture_output=True, text=True, timeout=600, check=True)
    assert done.stdout == "live frames: expected a new frame within 0.05 s, found none\n"
    assert done.stderr == ""


class Stated(Scripted):
    """States these times [s], one a frame, as its own."""

    times_s: np.ndarray

    def get(self, prop: int) -> float:
        return 1e3 * self.times_s[self.n_given - 1] if prop == cv2.CAP_PROP_POS_MSEC else 0.0


DUE_S = 100.0 + 0.1 * np.arange(60)
LATER = {"stand still": DUE_S[39], "go back": DUE_S - 30.0, "no numbers": np.nan}
STUCK = {name: np.where(np.arange(60) < 40, DUE_S, later) for name, later in LATER.items()}


@pytest.mark.parametrize("own", [True, False], ids=["stated", "device"])
@pytest.mark.parametrize("fault", STUCK)
def test_exposure_times_that_do_not_rise_are_reported_within_three_frames(fault: str, own: bool) -> None:
    """Frames each 0.1 s that arrive 20 ms late; from frame 40 on their times fail: arrival counts, to 50 ms."""
    clock, camera = Clock(), Stated(*[picture(k) for k in range(60)])
    camera.times_s = STUCK[fault]
    camera.let = threading.Semaphore(0)
    rule = {"exposures": lambda: stated_exposure_time} if own else {}
    times, reported = {}, {}
    with opened(camera, clock=clock, keep=99, **rule) as live:
        for k in range(60):
            clock.now = DUE_S[k] + 0.02
            camera.let.release()
            wait_until(lambda k=k: camera.n_asked == k + 2 or camera.waits)
            if (frame := live.next(0.0)) is not None:
                times[k] = frame.exposure_s
            reported |= {event.kind: (k, event.text) for event in live.take_events()}
    assert list(reported) == [EventKind.CLOCK]
    noticed, text = reported[EventKind.CLOCK]
    assert 40 <= noticed <= 42
    assert "times of arrival are used" in text
    assert (np.diff(list(times.values())) > 0.0).all()
    assert set(range(43, 60)) <= set(times)
    own_s = 0.0 if own else 0.05  # of a device, half an interval before it is complete
    np.testing.assert_allclose([times[k] for k in range(43, 60)], DUE_S[43:] - own_s, atol=0.05)
