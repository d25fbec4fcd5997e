"""A sender's times on the own clock: late by the least latency, never early; other clocks are refused, then adopted."""

import numpy as np
import pytest

from experiments.pipeline.live.marks.sender_clock import OrderError, SenderClock
from vision import SourceSettings

SETTINGS = SourceSettings()
AHEAD = 5000.0
"""By how much the sender's clock is ahead of the own one [s]."""


def test_times_are_late_by_the_least_latency_so_far() -> None:
    rng = np.random.default_rng(0)
    clock = SenderClock(SETTINGS)
    took = 0.004 + rng.exponential(0.01, 200)
    for k, latency in enumerate(took):
        exposed = 100.0 + k / 30.0
        found = clock.exposure_s(exposed + AHEAD, exposed + latency)
        assert found - exposed == pytest.approx(took[: k + 1].min(), abs=1e-9)


def test_a_clock_that_drifts_is_followed() -> None:
    """A sender whose clock is slow by 1 %: after remembered_frames the oldest of them no longer ties the clocks."""
    clock = SenderClock(SETTINGS)
    n = 3 * SETTINGS.remembered_frames
    for k in range(n):
        exposed = k / 30.0
        found = clock.exposure_s(0.99 * exposed, exposed + 0.01)
    assert abs(found - exposed - 0.01) <= 0.01 * SETTINGS.remembered_frames / 30.0 + 1e-9
    assert exposed - 0.99 * exposed > 0.29


@pytest.mark.parametrize(
    ("sent", "message"),
    [
        (1.0, "time_s: expected more than 1.000000, found 1.000000"),
        (0.9, "time_s: expected more than 1.000000, found 0.900000"),
        (34.0, "time_s: expected seconds, 0.033 s after 1.000000, found 34.000000: it seems to be milliseconds"),
        (1e300, "time_s: expected seconds, 0.033 s after 1.000000, found 1000"),
    ],
)
def test_one_time_that_does_not_follow_is_refused_and_changes_nothing(sent: float, message: str) -> None:
    clock, plain = SenderClock(SETTINGS), SenderClock(SETTINGS)
    for each in (clock, plain):
        each.exposure_s(1.0, 10.0)
    with pytest.raises(OrderError) as error:
        clock.exposure_s(sent, 10.033)
    assert str(error.value).startswith(message)
    for k in range(2, 40):
        assert clock.exposure_s(1.0 + k / 30.0, 10.0 + k / 30.0) == plain.exposure_s(1.0 + k / 30.0, 10.0 + k / 30.0)
    assert clock.restarts == 0


def test_frames_of_two_clocks_in_turn_are_those_of_the_first() -> None:
    clock, taken = SenderClock(SETTINGS), []
    for k in range(120):
        try:
            clock.exposure_s((700.0 if k % 2 else 3.0) + k / 30.0, 10.0 + k / 30.0)
            taken.append(k % 2)
        except OrderError:
            pass
    assert set(taken) == {0}
    assert len(taken) == 60


def test_milliseconds_for_seconds_are_never_taken() -> None:
    clock = SenderClock(SETTINGS)
    clock.exposure_s(0.0, 10.0)
    for k in range(1, 300):
        with pytest.raises(OrderError, match="expected seconds"):
            clock.exposure_s(5000.0 * k, 10.0 + k / 30.0)
