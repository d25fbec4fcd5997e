"""Marks of a recording at their own pace, by a clock of the test's own."""

import numpy as np

from experiments.formats.recording import MarkRow
from experiments.pipeline.live.marks.replay import MarksReplay
from vision import EventKind


class Hand:
    """A clock that moves as it is waited for."""

    def __init__(self) -> None:
        self.now = 50.0

    def sleep(self, seconds: float) -> None:
        assert seconds >= 0.0
        self.now += seconds


def replay(hand: Hand, times: list[float]) -> MarksReplay:
    marks = [[MarkRow("M1", np.array([k, 0.0]), 1e-3)] if k % 2 else [] for k in range(len(times))]
    return MarksReplay(np.array(times), marks, clock=lambda: hand.now, sleep=hand.sleep)


def test_frames_come_when_they_are_due_then_it_ends() -> None:
    hand = Hand()
    source, found = replay(hand, [3.0, 3.1, 3.5, 3.6]), []
    while not source.ended:
        frame = source.next(0.25)
        if frame is not None:
            found.append((round(hand.now, 9), round(frame.exposure_s, 9), frame.index, len(frame.marks)))
    assert found == [(50.0, 50.0, 0, 0), (50.1, 50.1, 1, 1), (50.5, 50.5, 2, 0), (50.6, 50.6, 3, 1)]
    assert source.origin_s == 47.0  # its own 3 s came at 50
    assert source.frames_dropped == 0
    assert [event.kind for event in source.take_events()] == [EventKind.ENDED]
    assert source.next(1.0) is None


def test_no_frame_within_the_wait_is_none_nor_after_it_is_closed() -> None:
    hand = Hand()
    with replay(hand, [0.0, 1.0]) as source:
        assert source.next(0.1).index == 0
        assert source.next(0.1) is None
        assert hand.now == 50.1
    assert source.ended
    assert source.next(1.0) is None


def test_where_it_falls_behind_the_newest_comes() -> None:
    hand = Hand()
    source = replay(hand, [0.0, 0.1, 0.2, 0.3, 5.0])
    source.next(0.1)
    hand.now += 0.35
    assert source.next(0.1).index == 3
    assert source.frames_dropped == 2


def test_values_that_freeze_bring_no_marks_and_events_come_when_they_are_due() -> None:
    hand, found, reported = Hand(), [], {}
    marks = [[MarkRow("M1", np.array([min(k, 2) + max(k - 6, 0), 0.0]), 1e-3)] for k in range(9)]
    source = MarksReplay(3.0 + 0.1 * np.arange(9), marks, clock=lambda: hand.now, sleep=hand.sleep)
    while not source.ended:
        frame = source.next(1.0)
        if frame is not None:
            found.append(len(frame.marks))
        reported |= {len(found): (event.kind, round(event.time_s, 9)) for event in source.take_events()}
    assert found == [1, 1, 1, 0, 0, 0, 0, 1, 1]
    assert reported[5] == (EventKind.FROZEN, 50.4)
    assert reported[8] == (EventKind.RESUMED, 50.7)
