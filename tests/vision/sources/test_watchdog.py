"""The watch by a clock of the test's own."""

from dataclasses import fields

import numpy as np
import pytest

from vision import EventKind, FrozenValues, SourceEvent, SourceSettings, SourceWatchdog
from vision.sources.watchdog import SparsePictures

SIZE = (64, 48)


def fed(n: int, interval_s: float, *, blocked_s: float = 0.5, may_repeat: bool = False) -> tuple[SourceWatchdog, float]:
    """A watchdog that saw n pictures, and when the last came [s]."""
    watch = SourceWatchdog(0.0, SourceSettings(blocked_s=blocked_s), may_repeat=may_repeat)
    for k in range(n):
        assert watch.saw_new(k * interval_s, SIZE) == []
    return watch, (n - 1) * interval_s


def kinds(events: list) -> list[EventKind]:
    return [event.kind for event in events]


def test_silence_is_reported_once_when_its_time_is_over_and_then_its_end() -> None:
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


def test_silence_before_the_first_frame_is_reported() -> None:
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


def test_a_slow_camera_is_not_blocked_between_its_frames() -> None:
    watch, last = fed(4, 1.09)
    watch.saw_repeat(last + 1.09)
    assert watch.check(last + 3.2) == []
    assert kinds(watch.check(last + 4.4)) == [EventKind.BLOCKED]


def test_another_size_is_reported_even_after_a_fault() -> None:
    watch, last = fed(3, 0.03)
    (resized,) = watch.saw_new(last + 0.03, (32, 24))
    assert (resized.kind, resized.text) == (EventKind.RESIZED, "from 64 x 48 to 32 x 24 px")
    watch.saw_failure(last + 0.05, "a read failed")
    assert kinds(watch.saw_new(last + 0.06, SIZE)) == [EventKind.RESUMED, EventKind.RESIZED]


@pytest.mark.parametrize("name", [field.name for field in fields(SourceSettings)])
def test_settings_are_checked(name: str) -> None:
    with pytest.raises(ValueError, match=f"{name}: expected more than 0, found 0"):
        SourceSettings(**{name: 0})


INTERVAL_S = 1.0 / 30.0
DUE_S = INTERVAL_S * np.arange(360)


def sparse(exposures_s: np.ndarray, brightness: int = 200) -> list[SourceEvent]:
    """What is said of even pictures that were exposed at these times [s]."""
    watch, image = SparsePictures(), np.full((4, 6, 3), brightness, dtype=np.uint8)
    return [event for exposure_s in exposures_s for event in watch.saw(float(exposure_s), image)]


@pytest.mark.parametrize(("brightness", "dark"), [(5, True), (50, True), (70, False), (195, False)])
def test_darkness_is_named_where_the_picture_is_dark_and_the_load_always(brightness: int, dark: bool) -> None:
    lost, *_ = sparse(DUE_S[np.r_[0:120, 120:200:2]], brightness)
    assert lost.kind is EventKind.SPARSE
    assert ("dark" in lost.text, "light" in lost.text, "load" in lost.text) == (dark, dark, True)


@pytest.mark.parametrize("until", [180, 360], ids=["for 2 s", "from now on"])
@pytest.mark.parametrize("every", [2, 3])
def test_pictures_of_which_every_other_is_lost_are_reported_within_three_and_once(until: int, every: int) -> None:
    """Lost are the pictures from 4 s on but each second or third: a camera that halves its rate in the dark, too."""
    k = np.arange(len(DUE_S))
    came = DUE_S[(k < 120) | (k >= until) | ((k - 120) % every == every - 1)]
    reported = sparse(came)
    assert kinds(reported) == [EventKind.SPARSE, EventKind.RESUMED]
    assert reported[0].time_s - 4.0 <= 3 * every * INTERVAL_S
    assert reported[0].text.startswith(f"3 pictures came in the time of {6 if every == 2 else 7}: ")
    if until == 360:
        assert reported[1].text == f"every picture comes, {30 // every} a second"


@pytest.mark.parametrize(
    "exposures_s",
    [
        np.cumsum(INTERVAL_S * (1.0 + 0.4 * np.sin(np.arange(900) / 60.0))),
        np.cumsum(INTERVAL_S * np.linspace(1.0, 2.5, 600)),
        np.cumsum(INTERVAL_S * (1.0 + 0.3 * np.random.default_rng(0).normal(size=900)).clip(0.1)),
        DUE_S[np.random.default_rng(1).random(360) > 0.02],
        DUE_S[(np.arange(360) < 120) | (np.arange(360) >= 126)],
        # a reader that was late by four intervals, read one that waited, and was late again; then the others
        np.maximum.accumulate(DUE_S + INTERVAL_S * np.where(np.isin(np.arange(360) % 15, (7, 9)), 4.0, 0.0))
        + 1e-5 * np.arange(360),
        # a queue of 60
        np.where((np.arange(360) >= 120) & (np.arange(360) < 180), 5.9 + 1e-3 * np.arange(-120, 240), DUE_S),
    ],
    ids=["wanders", "slows", "trembles", "one in fifty", "one gap", "late reader", "long queue"],
)
def test_a_rate_that_wanders_a_gap_and_a_late_reader_are_no_lost_pictures(exposures_s: np.ndarray) -> None:
    assert sparse(exposures_s) == []


def test_a_pause_says_nothing_of_the_rate() -> None:
    watch, image = SparsePictures(), np.zeros((4, 6, 3), dtype=np.uint8)
    for exposure_s in DUE_S[:60]:
        assert watch.saw(exposure_s, image) == []
    for exposure_s in (3.0, 4.0, 5.0, 6.0):
        watch.began_again()
        assert watch.saw(exposure_s, image) == []


REPEATS = {
    "abcdefgh": ("abcdefgh", {}),
    "abbbbbcd": ("ab....cd", {3: EventKind.FROZEN, 6: EventKind.RESUMED}),
    "aaaaaaaa": ("a.......", {2: EventKind.FROZEN}),
    "abbcdefg": ("ab.cdefg", {}),
    "abcdabcd": ("abcd....", {5: EventKind.FROZEN}),
    "abcdefghiajk": ("abcdefghiajk", {}),
    "abcdefghajk": ("abcdefgh.jk", {}),
    "aabbccddee": ("a.b.c.d.e.", {}),
    "ab-b-b-c-": ("ab-.-.-c-", {5: EventKind.FROZEN, 7: EventKind.RESUMED}),
    "------": ("------", {}),
    "abBBBc": ("ab...c", {3: EventKind.FROZEN, 5: EventKind.RESUMED}),
}
"""A frame a letter: - has no values, a capital one of the two values of the small letter. Used: . is withheld."""


def values(letter: str) -> dict[str, tuple[float, ...]]:
    if letter == "-":
        return {}
    number = float(ord(letter.lower()))
    return {"M1": (number, 0.5)} if letter.isupper() else {"M1": (number, 0.5), "M2": (1.0, number)}


@pytest.mark.parametrize("frames", REPEATS)
def test_values_that_repeat_are_withheld_and_frozen_within_three_frames(frames: str) -> None:
    watch, used, reported = FrozenValues(), "", {}
    for k, letter in enumerate(frames):
        repeats, events = watch.saw(0.1 * k, values(letter))
        used += "." if repeats else letter
        for event in events:
            reported[k] = event.kind
    assert (used, reported) == REPEATS[frames]


def test_one_value_that_repeats_beside_another_that_does_not_is_no_repeat() -> None:
    watch = FrozenValues()
    for k in range(20):
        assert watch.saw(0.1 * k, {"M1": (1.0, 2.0), "M2": (float(k), 0.0)}) == (False, [])


def test_a_sender_that_states_each_value_four_times_is_not_frozen_but_at_first() -> None:
    """What is usual is known after three values; a freeze is then noticed two frames beyond it."""
    watch, events = FrozenValues(), []
    for k in range(120):
        events += watch.saw(k / 120.0, {"M1": (float(k // 4), 0.0)})[1]
    assert max(event.time_s for event in events) < 12 / 120.0
    for k in range(120, 140):
        events += watch.saw(k / 120.0, {"M1": (30.0, 0.0)})[1]
    assert (events[-1].kind, events[-1].time_s) == (EventKind.FROZEN, pytest.approx(125 / 120.0))


def test_what_is_said_of_frozen_values() -> None:
    watch, events = FrozenValues(), []
    for k in range(31):
        events += watch.saw(0.1 * k, {"M1": (float(min(k, 1) if k < 30 else 2), 0.0)})[1]
    assert [str(event) for event in events] == [
        "FROZEN 2 times the same values, to the last digit, in 0.20 s: they are not used",
        "RESUMED new values after 2.90 s",
    ]
