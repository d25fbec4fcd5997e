"""Arrivals tell when pictures were exposed, but after a pause, and while they come in bursts."""

import numpy as np
import pytest

from vision.sources.exposure_times import Arrivals

INTERVAL_S = 1.0 / 30.0
EVEN_S = INTERVAL_S * np.arange(40)


def after(*times_s: float, by_source: bool = False) -> Arrivals:
    arrivals = Arrivals()
    for time_s in (*EVEN_S, *times_s):
        arrivals.came(float(time_s), by_source=by_source)
    return arrivals


def test_even_arrivals_and_lost_pictures_leave_no_doubt():
    lost = EVEN_S[-1] + INTERVAL_S * np.cumsum([1, 2, 1, 3, 2, 1])
    jitter = lost[-1] + INTERVAL_S * np.arange(1, 20) + 2e-3 * np.sin(np.arange(19))
    arrivals = after(*lost, *jitter)
    assert arrivals.late_s == 0.0
    assert not arrivals.uneven(jitter[-1])


def test_after_a_pause_all_pictures_may_come_as_late():
    resumed = EVEN_S[-1] + 1.0 + INTERVAL_S * np.arange(1, 60)
    assert after(*resumed).late_s == pytest.approx(1.0)
    # a source that tells its times is known to be late
    assert after(*resumed, by_source=True).late_s == 0.0


def test_times_that_are_known_after_a_pause_alone_prove_nothing():
    resumed = EVEN_S[-1] + 1.0 + INTERVAL_S * np.arange(1, 60)
    arrivals = after(*resumed)
    arrivals.came(resumed[-1] + INTERVAL_S, by_source=True)
    assert arrivals.late_s == pytest.approx(1.0)


def test_a_queue_that_was_emptied_after_a_pause_is_late_no_more():
    emptied = EVEN_S[-1] + 1.0 + 1e-3 * np.arange(1, 31)
    assert after(*emptied[:10]).late_s > 0.5
    assert after(*emptied).late_s == 0.0


def test_where_a_read_failed_no_picture_waits():
    arrivals = after()
    arrivals.failed()
    arrivals.came(EVEN_S[-1] + 2.0)
    assert arrivals.late_s == 0.0


def test_pictures_in_bursts_are_of_unknown_time_for_a_second():
    late = [EVEN_S[-1] + 0.105, EVEN_S[-1] + 0.106, EVEN_S[-1] + 0.107]
    arrivals = after(*late)
    assert arrivals.uneven(late[-1] + 0.9)
    assert not arrivals.uneven(late[-1] + 1.1)
    assert arrivals.late_s == 0.0


def test_pictures_that_all_come_at_once_do_no_harm():
    assert after(*([EVEN_S[-1] + 0.1] * 60)).uneven(EVEN_S[-1] + 0.1)
