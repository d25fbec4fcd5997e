"""Pictures of several cameras in order of exposure, by a clock that the test moves."""

from collections import deque

import numpy as np
import pytest

from tests.vision.sources.scripted import Clock, numbered, wait_until
from vision import TOGETHER_S, EventKind, Exposure, Frame, SeveralFrames, SourceError, SourceEvent, played_together

INTERVAL_S = 1.0 / 30.0


class Camera:
    """A camera at 30 frames/s whose pictures come when the script says; the newest one waits."""

    interval_s, frames_dropped, origin_s, opening, waits, late_s, uneven = INTERVAL_S, 0, 0.0, False, False, 0.0, False

    def __init__(self, clock: Clock, coming: list[tuple[float, float]]) -> None:
        """Coming: when each picture comes, and when it was exposed [s]."""
        self.clock, self.coming = clock, deque(sorted(coming))
        self.closed = False

    @property
    def ended(self) -> bool:
        return not self.coming

    def next(self, _timeout_s: float) -> Frame | None:
        newest = None
        while self.coming and self.coming[0][0] <= self.clock.now:
            self.frames_dropped += newest is not None
            newest = self.coming.popleft()[1]
        return None if newest is None else Frame(0, newest, numbered(0))

    def take_events(self) -> tuple[SourceEvent, ...]:
        return (SourceEvent(1.0, EventKind.FROZEN, "for 3 pictures"),)

    def close(self) -> None:
        self.closed = True


def at(*exposures_s: float, after_s: float = 0.01) -> list[tuple[float, float]]:
    return [(exposed_s + after_s, exposed_s) for exposed_s in exposures_s]


def seen(clock: Clock, cameras: dict[str, list[tuple[float, float]]], takes_s: float = 0.0) -> list[tuple]:
    """When each exposure came, when it was exposed, and its cameras; each takes so long to use."""

    def nap(pause_s: float) -> None:
        clock.now += pause_s

    frames = SeveralFrames({name: Camera(clock, coming) for name, coming in cameras.items()}, clock=clock, nap=nap)
    found = []
    while not frames.ended:
        exposure = frames.next(0.1)
        if exposure is not None:
            found.append((clock.now, exposure.exposure_s, "".join(exposure.images)))
            clock.now += takes_s
    return [*found, frames.frames_dropped]


def trigger(n: int = 6, offset_s: float = 0.0) -> list[float]:
    return [100.1 + k * INTERVAL_S + offset_s for k in range(n)]


def test_pictures_of_one_time_come_together_however_late_one_is() -> None:
    late = {"a": at(*trigger(), after_s=0.005), "b": at(*trigger(offset_s=0.9 * TOGETHER_S), after_s=0.02)}
    *found, dropped = seen(Clock(), late)
    assert [(time_s, names) for _, time_s, names in found] == [(time_s, "ab") for time_s in trigger()]
    # within a period of asking after the later of the two came
    assert max(came_s - time_s for came_s, time_s, _ in found) < 0.02 + 0.9 * TOGETHER_S + 0.0021
    assert dropped == 0


def test_pictures_in_turn_come_in_order_of_exposure_and_wait_for_none_that_is_not_due() -> None:
    half = 0.5 * INTERVAL_S
    *found, dropped = seen(Clock(), {"a": at(*trigger()), "b": at(*trigger(offset_s=half))})
    assert [names for _, _, names in found] == ["a", "b"] * 6
    # but the first, which waits for the other camera to begin
    assert max(came_s - time_s for came_s, time_s, _ in found[1:]) < 0.01 + 0.0021
    assert dropped == 0


def test_an_earlier_exposure_that_comes_later_is_waited_for() -> None:
    slow = {"a": at(*trigger(), after_s=0.003), "b": at(*trigger(offset_s=-0.004), after_s=0.02)}
    *found, _ = seen(Clock(), slow)
    times_s = [time_s for _, time_s, _ in found]
    assert times_s == sorted(times_s)
    assert [names for _, _, names in found] == ["b", "a"] * 6


def test_a_camera_that_falls_silent_delays_the_other_by_a_few_frames_only() -> None:
    both, silent = trigger(30), trigger(5)
    clock = Clock()
    *found, dropped = seen(clock, {"a": at(*both), "b": [*at(*silent), (200.0, 200.0)]})
    alone = [(came_s - time_s, names) for came_s, time_s, names in found if time_s > both[4]]
    assert [names for _, names in alone[:-1]] == ["a"] * 25
    assert max(delay_s for delay_s, _ in alone[:3]) < 0.01 + INTERVAL_S + 0.0021
    assert max(delay_s for delay_s, _ in alone[3:-1]) < 0.01 + 0.0021
    assert dropped == 0


@pytest.mark.parametrize("offset_s", [0.01, -0.01, 0.5 * INTERVAL_S])
def test_a_slow_loop_gets_pictures_of_each_camera_and_counts_the_others(offset_s: float) -> None:
    n = 90
    *found, dropped = seen(Clock(), {"a": at(*trigger(n)), "b": at(*trigger(n, offset_s))}, takes_s=0.15)
    names = [names for *_, names in found]
    times_s = [time_s for _, time_s, _ in found]
    assert times_s == sorted(times_s)
    assert abs(names.count("a") - names.count("b")) <= 2
    assert sum(map(len, names)) + dropped == 2 * n
    assert max(came_s - time_s for came_s, time_s, _ in found[1:-2]) < 0.01 + 1.5 * INTERVAL_S


def test_a_picture_older_than_one_that_was_given_is_dropped() -> None:
    # b's second picture comes a second after it was exposed: longer than anything waits for it
    *found, dropped = seen(Clock(), {"a": at(*trigger(40)), "b": [*at(trigger()[0]), (101.2, trigger()[1])]})
    assert [names for *_, names in found] == ["ab", *"a" * 39]
    assert dropped == 1


def test_faults_name_their_camera() -> None:
    class Broken(Camera):
        def next(self, _timeout_s: float) -> Frame | None:
            raise SourceError("live frames: expected a camera, found none")

    clock = Clock()
    left, right = Camera(clock, at(100.1)), Broken(clock, at(100.1))
    with SeveralFrames({"left": left, "right": right}, clock=clock) as frames:
        assert [event.text for event in frames.take_events()] == [f"camera {n}: for 3 pictures" for n in frames.sources]
        with pytest.raises(SourceError, match=r"^camera right: live frames: expected a camera, found none$"):
            frames.next(0.0)
    assert left.closed
    assert right.closed


def test_films_play_on_one_clock() -> None:
    """A busy machine may miss pictures; those that come are of the films' times, the last ones always come."""

    class Film:
        def __init__(self, times_s: list[float]) -> None:
            self.times_s, self.closed = times_s, False

        def __iter__(self):
            return iter([Frame(k, time_s, numbered(k)) for k, time_s in enumerate(self.times_s)])

        def close(self) -> None:
            self.closed = True

    films = {"a": Film([0.0, 0.2, 0.4]), "b": Film([0.0, 0.2, 0.3])}
    with played_together(films) as frames:
        found: list[Exposure] = []
        while not frames.ended:
            exposure = frames.next(0.05)
            if exposure is not None:
                found.append(exposure)
        times_s = np.array([one.exposure_s for one in found]) - frames.origin_s
    expected = {0.0: {"a", "b"}, 0.2: {"a", "b"}, 0.3: {"b"}, 0.4: {"a"}}
    assert all(set(one.images) <= expected[round(t, 6)] for one, t in zip(found, times_s.tolist(), strict=True))
    assert (np.diff(times_s) > 0.0).all()
    assert set(found[-1].images) == {"a"}
    wait_until(lambda: all(film.closed for film in films.values()))
