"""Real sockets and real pipes."""

import os
import socket

import pytest

from experiments.formats.scenario import read_scenario
from experiments.pipeline.live.marks.feeds import PipeFeed, UdpFeed, udp_feed
from experiments.pipeline.live.marks.lines import LONGEST_LINE
from experiments.pipeline.live.marks.receiver import LiveMarks
from experiments.simulation.simulate import scene_of
from tests.experiments.waiting import SOON_S, until
from vision import SourceError

SCENE = scene_of(read_scenario("webcam"))


def line(time_s: float) -> bytes:
    return f'{{"time_s": {time_s}, "marks": [{{"node": "M3", "x_mm": {time_s}, "y_mm": 390, "sd_mm": 1}}]}}\n'.encode()


@pytest.fixture
def udp():
    feed = UdpFeed(0)
    with LiveMarks(SCENE, feed) as marks, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.connect(feed.address)
        yield feed, marks, sender


def test_one_datagram_may_hold_several_lines_and_faults_stop_nothing(udp) -> None:
    _, marks, sender = udp
    sender.send(b"\x00" * 60_000)
    sender.send(b"")
    sender.send(line(1.0) + b"nonsense\n" + line(2.0))
    until(lambda: marks._n_frames == 2)
    assert marks.refused == {"malformed": 2}
    assert marks.next(SOON_S).index == 1


def test_only_this_machine_is_heard_unless_an_address_is_given(udp) -> None:
    feed, _, _ = udp
    assert feed.address[0] == "127.0.0.1"
    everywhere = UdpFeed(0, "0.0.0.0")
    assert everywhere.address[0] == "0.0.0.0"
    everywhere.close()
    given = udp_feed("udp://127.0.0.1:45871")
    assert given.address == ("127.0.0.1", 45871)
    given.close()


def test_a_second_host_is_refused_while_the_first_sends() -> None:
    """127.0.0.1 and 127.0.0.2 are two hosts of one machine."""
    feed = UdpFeed(0, "0.0.0.0")
    with (
        LiveMarks(SCENE, feed) as marks,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as first,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as second,
    ):
        first.bind(("127.0.0.1", 0))
        try:
            second.bind(("127.0.0.2", 0))
        except OSError:
            pytest.skip("this machine has one loopback address")
        to = ("127.0.0.1", feed.address[1])
        first.sendto(line(1.0), to)
        until(lambda: marks._n_frames == 1)
        second.sendto(line(2.0), to)
        until(lambda: marks.refused)
        assert marks.refused == {"of another sender": 1}
        first.sendto(line(3.0), to)
        until(lambda: marks._n_frames == 2)


def test_a_port_that_is_taken_is_an_error_at_once(udp) -> None:
    feed, _, _ = udp
    with pytest.raises(SourceError, match="expected a free port and an address of this machine, found"):
        UdpFeed(feed.address[1])


@pytest.mark.parametrize(
    "address", ["", ":0", ":70000", ":x", "127.0.0.1", ":5000/x", "[::1", "127..1:5000", f"{64 * 'a'}:5000"]
)
def test_an_address_without_a_port_is_an_error(address) -> None:
    with pytest.raises(SourceError, match="expected udp://:PORT or udp://HOST:PORT"):
        udp_feed(f"udp://{address}")


@pytest.fixture
def pipe():
    read, write = os.pipe()
    with LiveMarks(SCENE, PipeFeed(read)) as marks:
        yield marks, write
        os.close(write)
    os.close(read)


def test_lines_of_a_pipe_are_frames_however_they_are_cut(pipe) -> None:
    marks, write = pipe
    for k in range(3):
        content = line(float(k))
        for part in (content[:7], content[7:40], content[40:]):
            os.write(write, part)
        assert marks.next(SOON_S).index == k


def test_a_line_that_does_not_end_is_passed_over_and_the_next_is_read(pipe) -> None:
    marks, write = pipe
    for _ in range(5):
        os.write(write, b"7" * LONGEST_LINE)
    os.write(write, b"7\n" + line(1.0))
    assert marks.next(SOON_S).index == 0
    assert marks.refused == {"malformed": 1}
    assert f"expected up to {LONGEST_LINE} bytes" in marks.take_events()[0].text


def test_the_last_line_needs_no_break_and_then_it_ends() -> None:
    read, write = os.pipe()
    with LiveMarks(SCENE, PipeFeed(read)) as marks:
        os.write(write, line(1.0)[:-1])
        os.close(write)
        assert marks.next(SOON_S).index == 0
        assert marks.next(SOON_S) is None
        assert marks.ended
    os.close(read)
