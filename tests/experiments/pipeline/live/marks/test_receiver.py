"""What a feed hands over: the newest first, refusals counted and reported now and then, faults as of a camera.

By a clock of the test's own; the feed is the test.
"""

import json
import re
import threading

import numpy as np
import pytest

from experiments.formats.scenario import read_scenario
from experiments.pipeline.live.marks.receiver import LiveMarks
from experiments.simulation.simulate import scene_of
from vision import EventKind, SourceError, SourceSettings

SCENE = scene_of(read_scenario("webcam"))
SETTINGS = SourceSettings()


class Idle:
    """A feed that waits, and then ends or fails."""

    def __init__(self, error: Exception | None = None) -> None:
        self.error, self.over, self.closed = error, threading.Event(), False

    def run(self, receiver: LiveMarks) -> None:
        while receiver.wanted and not self.over.wait(0.005):
            pass
        if self.error is not None:
            raise self.error

    def close(self) -> None:
        self.closed = True


class Bench:
    """A receiver whose clock the test sets."""

    def __init__(self, feed: Idle | None = None) -> None:
        self.now, self.feed = 100.0, Idle() if feed is None else feed
        self.marks = LiveMarks(SCENE, self.feed, clock=lambda: self.now)

    def send(self, time_s: float, marks: str = "") -> None:
        self.marks.take_line(f'{{"time_s": {time_s}, "marks": [{marks}]}}\n'.encode())


@pytest.fixture
def bench():
    made = Bench()
    yield made
    made.marks.close()


def test_the_newest_frame_is_delivered_once(bench) -> None:
    bench.send(5.0)
    bench.now = 100.2
    bench.send(5.2, '{"node": "M1", "x_mm": -200, "y_mm": 195, "sd_mm": 2}')
    frame = bench.marks.next(0.0)
    assert frame.exposure_s == pytest.approx(100.2)
    assert frame.index == 1
    (mark,) = frame.marks
    assert mark.node == "M1"
    np.testing.assert_allclose(mark.position, [-0.2, 0.195])
    np.testing.assert_allclose(mark.cov, 4e-6 * np.eye(2))
    assert bench.marks.next(0.0) is None
    assert bench.marks.frames_dropped == 1
    bench.marks.take_line(b" \r")  # which is nothing
    assert bench.marks.next(0.0) is None
    assert not bench.marks.refused
    assert bench.marks.take_events() == ()


def test_refusals_are_counted_all_and_reported_now_and_then(bench) -> None:
    """300 in 10 s: the first at once, then one report in each 2 s, which counts those since."""
    bench.send(1.0)
    for k in range(300):
        bench.now = 100.0 + k / 30.0
        if k % 3:
            bench.marks.take_line(b"nonsense")
        else:
            bench.send(1.0)
    events = [event for event in bench.marks.take_events() if event.kind is EventKind.REFUSED]
    assert bench.marks.refused == {"malformed": 200, "out of order": 100}
    assert len(events) == 5
    assert events[0].text == "1 out of order: time_s: expected more than 1.000000, found 1.000000"
    nonsense = '40 malformed, first: expected a line of JSON, found "nonsense"'
    assert events[1].text == f"{nonsense}; 20 out of order, first: time_s: expected more than 1.000000, found 1.000000"
    assert np.diff([event.time_s for event in events]).min() > SETTINGS.hung_s - 1e-9


def test_what_was_refused_is_reported_though_nothing_else_is(bench) -> None:
    for now_s, line in ((100.0, b"one"), (100.1, b"two"), (102.2, None)):
        bench.now = now_s
        bench.send(now_s) if line is None else bench.marks.take_line(line)
    texts = [event.text for event in bench.marks.take_events() if event.kind is EventKind.REFUSED]
    assert texts == [f'1 malformed: expected a line of JSON, found "{word}"' for word in ("one", "two")]


def test_marks_in_another_unit_are_refused_in_every_frame(bench) -> None:
    """In metres after some in mm: the body would have shrunk to a point."""
    network = SCENE.network
    places = {mark.node: 1e3 * network.positions[network.index(mark.node)] for mark in SCENE.marks}
    for k in range(3):
        bench.now = 100.0 + k
        size = 1e-3 if k == 1 else 1.0
        marks = [{"node": n, "x_mm": size * (x + k), "y_mm": size * y, "sd_mm": 1.0} for n, (x, y) in places.items()]
        bench.marks.take_line(json.dumps({"time_s": float(k), "marks": marks}).encode())
        frame = bench.marks.next(0.0)
        assert (frame is None) == (k == 1)
    (text,) = [event.text for event in bench.marks.take_events() if event.kind is EventKind.REFUSED]
    assert re.fullmatch(r"1 of another size: marks: expected a spread of some \d+ mm, found 0.\d+ mm", text)


def test_a_sender_that_falls_silent_is_blocked_and_resumes(bench) -> None:
    bench.send(1.0)
    bench.marks.next(0.0)
    bench.now = 100.6
    bench.marks.next(0.0)
    bench.now = 103.0
    bench.send(4.0)
    blocked, resumed = ((event.kind, event.text) for event in bench.marks.take_events())
    assert blocked == (EventKind.BLOCKED, "no answer for 0.60 s")
    assert resumed == (EventKind.RESUMED, "after 3.00 s without a frame")


def test_a_sender_that_never_sends_is_blocked_though_no_frame_is_waited_for(bench) -> None:
    """As while a run is prepared; after the end nothing is missed."""
    assert bench.marks.take_events() == ()
    bench.now = 100.6
    assert [event.kind for event in bench.marks.take_events()] == [EventKind.BLOCKED]
    bench.marks.close()
    bench.now = 107.0
    assert bench.marks.take_events() == ()


def test_another_clock_of_the_sender_is_reported(bench) -> None:
    for k in range(20):
        bench.now = 100.0 + 0.1 * k
        bench.send((500.0 if k < 10 else 0.0) + 0.1 * k)
    (text,) = [event.text for event in bench.marks.take_events() if event.kind is EventKind.RESUMED]
    assert text == "the sender's clock was set to 1.500 s"
    assert bench.marks.refused == {"out of order": 5}
    assert bench.marks.next(0.0).exposure_s == pytest.approx(101.9)


def test_after_the_last_frame_it_ends() -> None:
    bench = Bench()
    bench.send(1.0)
    bench.feed.over.set()
    assert bench.marks.next(5.0).index == 0
    bench.marks._thread.join()
    assert bench.marks.next(0.0) is None
    assert bench.marks.ended
    assert [event.kind for event in bench.marks.take_events()] == [EventKind.ENDED]


@pytest.mark.parametrize(
    ("error", "raised", "message"),
    [
        (OSError(5, "Input/output error"), SourceError, "expected lines of marks, found input/output error"),
        (ZeroDivisionError("here"), ZeroDivisionError, "here"),
    ],
)
def test_a_feed_that_fails_is_an_error_after_its_frames(error, raised, message) -> None:
    bench = Bench(Idle(error))
    bench.send(1.0)
    bench.feed.over.set()
    bench.marks._thread.join()
    assert bench.marks.next(0.0).index == 0
    with pytest.raises(raised, match=message):
        bench.marks.next(0.0)
    assert bench.marks.ended


def test_closing_lets_go_of_the_feed() -> None:
    bench = Bench()
    with bench.marks:
        pass
    assert bench.feed.closed
    assert bench.marks.ended
    assert not bench.marks.wanted
    assert bench.marks.next(1.0) is None


def mark(node: str, x_mm: float, y_mm: float) -> str:
    return f'{{"node": "{node}", "x_mm": {x_mm}, "y_mm": {y_mm}, "sd_mm": 2}}'


def test_values_that_freeze_bring_no_marks_until_they_change(bench) -> None:
    """The frame that first repeats is not delivered; those after it have no marks. Times, and so no BLOCKED, go on."""
    found = []
    for k in range(40):
        bench.now = 100.0 + 0.1 * k
        x_mm = -200.0 + min(k, 5) + max(k - 34, 0)
        bench.send(5.0 + 0.1 * k, mark("M1", x_mm, 195.0))
        frame = bench.marks.next(0.0)
        found.append(None if frame is None else len(frame.marks))
    assert found == [1] * 6 + [None] + [0] * 28 + [1] * 5
    assert [(event.kind, event.time_s) for event in bench.marks.take_events()] == [
        (EventKind.FROZEN, pytest.approx(100.7)),
        (EventKind.RESUMED, pytest.approx(103.5)),
    ]
    assert not bench.marks.refused


def test_first_marks_far_from_the_drawing_are_said_once(bench) -> None:
    for k in range(5):
        bench.now = 100.0 + 0.1 * k
        marks = mark("M1", -204.0 + k, -192.0), mark("M3", k, -384.0), mark("M4", 204.0, -192.0 + k)
        bench.send(5.0 + 0.1 * k, ", ".join(marks))
    (event,) = bench.marks.take_events()
    assert event.kind is EventKind.ASIDE
    assert "with y mirrored: (x, -y) for (x, y)" in event.text
    assert len(bench.marks.next(0.0).marks) == 3  # as they came
