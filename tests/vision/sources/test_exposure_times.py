"""Exposure times against devices and containers whose truth the test made."""

import cv2
import numpy as np
import pytest

from vision import DeviceTimes, FilmTimes

INTERVAL = 1 / 30


class Device:
    """A capture that says what the test lets it say."""

    def __init__(self, fps: float = 0.0) -> None:
        self.stated_s, self.fps = 0.0, fps

    def get(self, prop: int) -> float:
        return {cv2.CAP_PROP_POS_MSEC: 1e3 * self.stated_s, cv2.CAP_PROP_FPS: self.fps}[prop]


def exposures(complete_s: np.ndarray, stated_s: np.ndarray, late_s: np.ndarray) -> tuple[np.ndarray, list, list]:
    """What the rule says of frames complete, stated by the device and grabbed so late [s], each (n,).

    After each: whether it trusts the device, and how late frames may be [s].
    """
    rule, device, said, trusted, may_be_s = DeviceTimes(), Device(), [], [], []
    for complete, reported, late in zip(complete_s, stated_s, late_s, strict=True):
        device.stated_s = reported
        said.append(rule(device, complete + late))
        trusted.append(rule.trusts_device)
        may_be_s.append(rule.late_s)
    return np.array(said), trusted, may_be_s


COMPLETE = 50.0 + INTERVAL * np.arange(120)
LATE = np.random.default_rng(0).uniform(0.002, 0.02, 120)


@pytest.mark.parametrize("start_s", [0.0, 50.0])
def test_a_sane_device_is_trusted_and_its_frames_are_evenly_spaced(start_s: float) -> None:
    """Whether its clock is ours (V4L2) or begins with the device: half an interval before complete, to 3 ms."""
    said, trusted, _ = exposures(COMPLETE, COMPLETE - 50.0 + start_s, LATE)
    assert trusted[-1]
    np.testing.assert_allclose(np.diff(said[40:]), INTERVAL, atol=1.5e-3)
    np.testing.assert_allclose(said[40:], COMPLETE[40:] - INTERVAL / 2, atol=4e-3)
    # before it has proved sane, the clock at grab()
    np.testing.assert_allclose(said[2:29], (COMPLETE + LATE)[2:29] - INTERVAL / 2, atol=5e-3)


@pytest.mark.parametrize(
    "reported",
    [np.zeros(120), np.full(120, np.nan), -COMPLETE, 2.0 * COMPLETE, np.where(np.arange(120) % 7 == 0, 0.0, COMPLETE)],
    ids=["none", "nan", "backward", "twice as fast", "sometimes 0"],
)
def test_a_device_that_is_not_sane_is_not_adopted(reported: np.ndarray) -> None:
    said, trusted, _ = exposures(COMPLETE, reported, LATE)
    assert not trusted[-1]
    np.testing.assert_allclose(said[2:], (COMPLETE + LATE)[2:] - INTERVAL / 2, atol=5e-3)


def test_frames_from_a_queue_after_a_pause_keep_their_times() -> None:
    """Four buffered frames come 5 s late: they were exposed when the device says, not now."""
    late = LATE.copy()
    late[60:64] = 5.0
    said, trusted, _ = exposures(COMPLETE, COMPLETE, late)
    assert trusted[-1]
    np.testing.assert_allclose(said[60:64], COMPLETE[60:64] - INTERVAL / 2, atol=4e-3)


def test_a_clock_that_falls_behind_for_good_is_given_up() -> None:
    reported = COMPLETE.copy()
    reported[60:] -= 0.6 + 0.1 * INTERVAL * np.arange(60)
    reported = np.maximum.accumulate(reported) + 1e-5 * np.arange(120)
    said, *_ = exposures(COMPLETE, reported, LATE)
    assert np.abs(said[95:115] - COMPLETE[95:115]).max() < 0.05


@pytest.mark.parametrize("stated_s", [np.nan, 0.0, 1e6])
def test_a_clock_that_failed_once_is_trusted_again(stated_s: float) -> None:
    """From the 31st sane frame after it on; the times of arrival meanwhile."""
    reported = COMPLETE.copy()
    reported[60] = stated_s
    said, trusted, _ = exposures(COMPLETE, reported, np.full(120, 0.005))
    np.testing.assert_allclose(said[1:], (COMPLETE + 0.005 - INTERVAL / 2)[1:], rtol=0, atol=1e-9)
    assert trusted[40:60] == [True] * 20
    assert trusted[60:90] == [False] * 30
    assert trusted[93:] == [True] * 27


def test_frames_that_stay_late_may_be_as_late_until_they_come_as_early_as_before() -> None:
    """From the 60th on 1 s late, from the 180th on no more: by its own times, then by arrival, from 31 on."""
    late, reported = np.concatenate([LATE, LATE]), 50.0 + INTERVAL * np.arange(240)
    late[60:180] += 1.0
    said, trusted, may_be_s = exposures(reported, reported, late)
    assert (reported - INTERVAL / 2 - 0.01 < said).all()
    assert (said < reported + 0.03 + may_be_s).all()
    assert may_be_s[:90] == [0.0] * 90
    assert trusted[-1]
    np.testing.assert_allclose(may_be_s[90:180], 1.0, atol=0.05)  # though its clock is trusted again
    assert may_be_s[181:] == [0.0] * 59


def test_a_clock_that_drifts_is_followed() -> None:
    """1000 parts in a million over 40 s would be 0.04 s off."""
    complete = 50.0 + INTERVAL * np.arange(1200)
    said, trusted, _ = exposures(complete, complete * (1 - 1e-3), np.full(1200, 0.005))
    assert trusted[-1]
    assert np.abs(said[40:] - (complete[40:] + 0.005 - INTERVAL / 2)).max() < 0.012


def test_the_first_frame_goes_by_the_rate_that_the_device_says() -> None:
    assert DeviceTimes()(Device(fps=25.0), 7.0) == pytest.approx(7.0 - 0.02)
    assert DeviceTimes()(Device(fps=0.0), 7.0) == 7.0


def film(rate: float, container_s: list[float]) -> list[float]:
    rule = FilmTimes(rate)
    return [rule(t) for t in container_s]


def test_an_even_film_goes_by_its_rate_finer_than_its_container() -> None:
    rounded = [round(k / 30, 3) for k in range(90)]
    assert film(30.0, rounded) == [k / 30 for k in range(90)]
    assert film(30.0, [t + 1.4 for t in rounded]) == pytest.approx([k / 30 for k in range(90)])


def test_a_film_of_varying_rate_goes_by_its_container() -> None:
    times = [0.0, 0.033, 0.067, 0.167, 0.2, 0.4]
    assert film(15.0, times) == [0.0, *times[1:3], times[3], times[4], times[5]]
    assert film(np.nan, times) == times


@pytest.mark.parametrize("bad", [0.0, np.nan])
def test_a_container_without_times_leaves_the_rate(bad: float) -> None:
    assert film(25.0, [bad] * 4) == [0.0, 0.04, 0.08, 0.12]


def test_times_that_cannot_be_had_are_an_error() -> None:
    with pytest.raises(ValueError, match="frame 1: expected a frame rate or increasing times in the film"):
        film(0.0, [0.0, 0.0])
    with pytest.raises(ValueError, match=r"frame 3: expected a time after 0.5 s, found 0.4 s"):
        film(25.0, [0.0, 0.04, 0.5, 0.4])
