"""Calls that are shared out among processes where they take long."""

import os
import time

from experiments.engine.spare import WORTH_S, spare_cores


def own_process(_item):
    return os.getpid()


def late(seconds):
    time.sleep(seconds)
    return os.getpid()


def test_quick_calls_stay_in_this_process():
    with spare_cores(2) as shared:
        assert [list(shared(own_process, range(3))) for _ in range(2)] == [[os.getpid()] * 3] * 2


def test_calls_after_long_ones_go_to_other_processes(monkeypatch):
    monkeypatch.setattr("experiments.engine.spare.WORTH_S", 0.05)
    with spare_cores(2) as shared:
        assert list(shared(late, [0.1])) == [os.getpid()]
        assert os.getpid() not in list(shared(own_process, range(4)))
        assert list(shared(abs, [-1, 2, -3])) == [1, 2, 3]


def test_one_core_is_this_process(monkeypatch):
    monkeypatch.setattr("experiments.engine.spare.WORTH_S", 0.0)
    with spare_cores(1) as shared:
        assert list(shared(own_process, [0])) == [os.getpid()]
    assert WORTH_S > 1.0
