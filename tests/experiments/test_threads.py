"""Items made by a thread ahead of who takes them."""

import signal
import sys
import threading
from collections.abc import Iterator

import pytest

from experiments.threads import AHEAD, ahead, start_helper
from tests.experiments.waiting import SOON_S


def threads() -> set[threading.Thread]:
    return {thread for thread in threading.enumerate() if thread.name.startswith("ahead")}


def test_items_come_in_order_and_are_made_meanwhile():
    made = [threading.Event() for _ in range(3)]

    def items() -> Iterator[int]:
        for k, one in enumerate(made):
            one.set()
            yield k

    with ahead(items()) as found:
        first = next(found)
        assert made[2].wait(SOON_S)
        assert [first, *found] == [0, 1, 2]
    assert not threads()


def test_a_fault_is_raised_after_the_items_before_it():
    def items() -> Iterator[int]:
        yield 1
        raise ValueError("torn film")

    found = []
    with pytest.raises(ValueError, match="torn film"), ahead(items()) as taken:
        found.extend(iter(lambda: next(taken), None))
    assert found == [1]
    assert not threads()


def test_who_takes_no_more_leaves_no_thread_and_no_more_than_a_few_items_are_made():
    n_made = 0

    def items() -> Iterator[int]:
        nonlocal n_made
        while True:
            n_made += 1
            yield n_made

    with ahead(items()) as taken:
        assert next(taken) == 1
    assert not threads()
    assert n_made <= 2 * AHEAD + 3


@pytest.mark.skipif(sys.platform == "win32", reason="signals cannot be blocked")
def test_a_helper_is_started_with_ctrl_c_blocked():
    """It imports for seconds before it can ignore Ctrl-C itself."""
    masks = []

    class Helper:
        def start(self) -> None:
            masks.append(signal.pthread_sigmask(signal.SIG_BLOCK, ()))

    start_helper(Helper())
    assert signal.SIGINT in masks[0]
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())
