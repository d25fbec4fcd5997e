"""The watch by a clock of the test's own."""

from dataclasses import fields

import pytest

from vision import EventKind, SourceSettings, SourceWatchdog

SIZE = (64, 48)


def fed(n: int, interval_s: float, *, blocked_s: float = 0.5, may_repeat: bool = False) -> tuple[SourceWatchdog, float]:
    """A watchdog that saw n pictures, and when the last came [s]."""
    watch = SourceWatchdog(0.0, SourceSettings(blocked_s=blocked_s), may_repeat=may_repeat)
    for k in range(n):
        assert watch.saw_new(k * interval_s, SIZE) == []
    return watch, (n - 1) * interval_s


def kinds(events: list) -> list[EventKind]:
    return [event.kind for event in events]


def test_silence_is_told_once_when_its_time_is_over_and_then_its_end() -> None:
    watch, last = fed(2, 0.03)
    assert watch.check(last + 0.5) == []
    (blocked,) = watch.check(last + 0.51)
    assert (blocked.kind, blocked.time_s, blocked.text) == (EventKind.BLOCKED, last + 0.51, "no answer for 0.51 s")
    assert watch.check(last + 9.0) == []
    (resumed,) = watch.saw_new(last + 10.0, SIZE)
    assert (resumed.kind, resumed.text) == (EventKind.RESUMED, "after 10.00 s without a frame")
    assert watch.interval_s == pytest.approx(0.03)  # the gap is no interval
    assert watch.check(last + 10.4) == []
    assert kinds(watch.check(last + 10.6)) == [EventKind.BLOCKED]


def test_silence_before_the_first_frame_is_told() -> None:
    assert kinds(SourceWatchdog(100.0, may_repeat=True).check(100.6)) == [EventKind.BLOCKED]


def test_the_same_picture_for_too_long_is_frozen() -> None:
    watch, last = fed(10, 0.03)
    for k in range(1, 17):
        watch.saw_repeat(last + 0.03 * k)
        assert watch.check(last + 0.03 * k) == []
    watch.saw_repeat(last + 0.51)
    (frozen,) = watch.check(last + 0.51)
    assert (frozen.kind, frozen.text) == (EventKind.FROZEN, "the same picture for 0.51 s")
    assert kinds(watch.check(last + 1.02)) == [EventKind.BLOCKED]  # then it gives nothing at all
    watch.saw_repeat(last + 1.1)
    assert kinds(watch.check(last + 1.1)) == [EventKind.FROZEN]


def test_pictures_may_repeat_where_that_is_said() -> None:
    watch, last = fed(3, 0.03, may_repeat=True)
    watch.saw_repeat(last + 0.6)
    assert watch.check(last + 0.7) == []


def test_silence_is_no_frozen_picture() -> None:
    watch, last = fed(3, 0.03, blocked_s=2.0)
    assert watch.check(last + 1.9) == []
    assert kinds(watch.check(last + 2.1)) == [EventKind.BLOCKED]


def test_a_slow_camera_is_not_blocked_between_its_frames() -> None:
    watch, last = fed(4, 1.09)
    watch.saw_repeat(last + 1.09)
    assert watch.check(last + 3.2) == []
    assert kinds(watch.check(last + 4.4)) == [EventKind.BLOCKED]


def test_a_failed_read_is_told_at_once_and_only_once() -> None:
    watch, last = fed(3, 0.03)
    (dropped,) = watch.saw_failure(last + 0.01, "a read failed")
    assert (dropped.kind, dropped.text) == (EventKind.DROPPED, "a read failed")
    assert watch.saw_failure(last + 0.02, "a read failed") == []
    assert watch.check(last + 5.0) == []
    assert kinds(watch.saw_new(last + 6.0, SIZE)) == [EventKind.RESUMED]


def test_another_size_is_told_even_after_a_fault() -> None:
    watch, last = fed(3, 0.03)
    (resized,) = watch.saw_new(last + 0.03, (32, 24))
    assert (resized.kind, resized.text) == (EventKind.RESIZED, "from 64 x 48 to 32 x 24 px")
    watch.saw_failure(last + 0.05, "a read failed")
    assert kinds(watch.saw_new(last + 0.06, SIZE)) == [EventKind.RESUMED, EventKind.RESIZED]


@pytest.mark.parametrize("name", [field.name for field in fields(SourceSettings)])
def test_settings_are_checked(name: str) -> None:
    with pytest.raises(ValueError, match=f"{name}: expected more than 0, found 0"):
        SourceSettings(**{name: 0})
