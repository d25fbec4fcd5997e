"""What is reported on standard error: nobody has to read it during a live run, or to be there at all."""

import io
import threading

import pytest

from experiments.log import LOG, MOST_WAITING, SHOWN


class Unread(io.StringIO):
    """Standard error whose reader has stopped: a write waits until the test goes on."""

    def __init__(self):
        super().__init__()
        self.goes_on = threading.Event()

    def write(self, text):
        assert self.goes_on.wait(60.0)
        return super().write(text)


def test_lines_that_nobody_reads_stop_nothing_and_wait(monkeypatch):
    """More than may wait: reported is all the same, and the first ones are there when somebody reads again."""
    unread = Unread()
    monkeypatch.setattr("sys.stderr", unread)
    with SHOWN.unwaited():
        for k in range(MOST_WAITING + 10):
            LOG.warning("line %d", k)
        unread.goes_on.set()
    written = unread.getvalue().splitlines()
    assert written[:2] == ["softaim: line 0", "softaim: line 1"]
    assert MOST_WAITING <= len(written) <= MOST_WAITING + 1


def test_afterwards_a_line_is_there_at_once(capfd):
    with SHOWN.unwaited():
        LOG.warning("in between")
    LOG.warning("after")
    assert capfd.readouterr().err == "softaim: in between\nsoftaim: after\n"


@pytest.mark.parametrize("fault", [BrokenPipeError(), ValueError("I/O operation on closed file"), None])
def test_a_line_without_a_reader_is_no_fault(monkeypatch, capfd, fault):
    """It is lost; nothing is raised, and a new reader gets new lines."""

    class Closed(io.StringIO):
        def write(self, _text):
            raise fault

    with monkeypatch.context() as closed:
        closed.setattr("sys.stderr", None if fault is None else Closed())
        LOG.warning("to nobody")
    LOG.warning("to somebody")
    assert capfd.readouterr().err == "softaim: to somebody\n"
