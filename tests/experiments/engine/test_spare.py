"""Calls that are shared out among processes where they take long."""

import os
import signal
import time

import pytest

from experiments.engine.spare import WORTH_S, spare_cores
from tests.experiments.waiting import SOON_S


@pytest.fixture(autouse=True)
def _quickly(monkeypatch):
    """Processes begin without what they would import ahead."""
    monkeypatch.setattr("experiments.engine.spare.NEEDED", "json")


def own_process(_item):
    return os.getpid()


def met(folder, n_processes=2):
    """The own process, and whether it ignores an interrupt, once so many take part."""
    (folder / str(os.getpid())).touch()
    until_s = time.monotonic() + SOON_S
    while len(list(folder.iterdir())) < n_processes and time.monotonic() < until_s:
        time.sleep(0.005)
    return os.getpid(), signal.getsignal(signal.SIGINT) is signal.SIG_IGN


def test_quick_calls_stay_in_this_process():
    with spare_cores(2) as shared:
        assert [list(shared(own_process, range(3))) for _ in range(2)] == [[os.getpid()] * 3] * 2


def test_calls_after_long_ones_go_to_other_processes(tmp_path, monkeypatch):
    monkeypatch.setattr("experiments.engine.spare.WORTH_S", 0.05)
    with spare_cores(2) as shared:
        assert list(shared(time.sleep, [0.1])) == [None]
        assert len(set(shared(met, [tmp_path] * 8))) == 2
        assert list(shared(abs, range(-9, 0))) == list(range(9, 0, -1))


def test_one_core_is_this_process(monkeypatch):
    monkeypatch.setattr("experiments.engine.spare.WORTH_S", 0.0)
    with spare_cores(1) as shared:
        assert list(shared(own_process, [0])) == [os.getpid()]
    assert WORTH_S > 1.0


def test_processes_begun_ahead_take_part_from_the_first_call_on_and_leave_an_interrupt_to_who_asked(tmp_path):
    with spare_cores(2, ahead=True) as shared:
        ignored = dict(shared(met, [tmp_path] * 8))
    assert ignored.pop(os.getpid()) is False
    assert list(ignored.values()) == [True]


def end_unless(process):
    if os.getpid() != process:
        os._exit(1)
    return process


def test_what_a_killed_process_leaves_undone_is_done_here():
    own = os.getpid()
    with spare_cores(2, ahead=True) as shared:
        assert [list(shared(end_unless, [own] * 3)) for _ in range(2)] == [[own] * 3] * 2


def test_an_error_of_a_call_is_not_taken_for_a_killed_process():
    with spare_cores(2, ahead=True) as shared, pytest.raises(ZeroDivisionError):
        list(shared(divmod_by, [0]))


def divmod_by(item):
    return divmod(1, item)
