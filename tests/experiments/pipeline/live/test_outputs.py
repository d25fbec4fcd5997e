"""What a live run writes, when nobody reads it, nothing can be written any more, or it ends in the middle."""

import io
from pathlib import Path

import numpy as np
import pytest

from estimators import CovarianceError
from experiments.formats.outputs import growing_folder
from experiments.pipeline.line import Line
from experiments.pipeline.live.outputs import FINEST_MS, Latencies, LiveTable, StatusLine
from tests.experiments.pipeline.live.test_recording import rows
from tests.experiments.pipeline.live.test_session import INTERVAL, Clocked, frames_at, image, run
from tests.experiments.test_log import Unread

__all__ = ["image"]


def test_rows_are_there_when_the_run_ends_in_the_middle(tmp_path):
    def run():
        with growing_folder(tmp_path / "live") as folder:
            table = LiveTable(folder / "rows.csv", ["a", "b"])
            assert not (folder / "rows.csv").exists()
            table.write([1, 2])
            # as it is found by somebody who looks, or after a kill
            assert rows(tmp_path / "live" / "rows.csv") == [{"a": "1", "b": "2"}]
            table.close()
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        run()
    assert rows(tmp_path / "live" / "rows.csv") == [{"a": "1", "b": "2"}]


def test_a_table_that_cannot_be_written_is_said_once_and_the_rest_left_out(caplog):
    """/dev/full takes nothing, as a full disk."""
    full = LiveTable(Path("/dev/full"), ["a"])
    for k in range(3):
        full.write([k])
    full.close()
    assert str(full.fault) == "/dev/full: expected a table that can be written, found no space left on device"
    assert [record.message for record in caplog.records] == [f"{full.fault}; the run continues without it"]


def test_a_status_line_that_nobody_reads_stops_nothing():
    """A thousand texts, then the newest: written are the one that waited for its reader and the last."""
    unread = Unread()
    unread.isatty = lambda: True
    with StatusLine(unread) as line:
        for k in range(1000):
            line.show(f"text {k}")
        unread.goes_on.set()
    written = [one.strip().removesuffix("\x1b[K") for one in unread.getvalue().split("\r") if one]
    assert written[-1] == "text 999"
    assert len(written) <= 3


@pytest.mark.parametrize("fault", [BrokenPipeError(), ValueError("I/O operation on closed file")])
def test_a_status_line_without_a_reader_ends_and_the_run_does_not(fault):
    class Closed(io.StringIO):
        n_tried = 0

        def write(self, _text):
            self.n_tried += 1
            raise fault

    closed = Closed()
    with StatusLine(closed) as line:
        for _ in range(3):
            line.show("text")
    assert closed.n_tried == 1
    assert not line._thread.is_alive()


def test_a_program_that_was_called_without_standard_output_has_no_status_line(monkeypatch):
    monkeypatch.setattr("sys.stdout", None)
    with StatusLine() as line:
        line.show("text")
    assert not line._thread.is_alive()


def test_latencies_are_counted_to_their_share():
    """Of 10,000 by a log-normal law: the quantiles that NumPy finds, to 1.2 %; the longest exactly; 0 of none."""
    rng = np.random.default_rng(1)
    values = np.exp(rng.normal(2.0, 0.8, 10_000))
    found = Latencies()
    assert found.quantile_ms(0.99) == 0.0
    for value in values:
        found.add(float(value))
    for share in (0.01, 0.5, 0.99, 0.999):
        assert found.quantile_ms(share) == pytest.approx(np.quantile(values, share, method="inverted_cdf"), rel=0.012)
    assert found.quantile_ms(1.0) == found.worst_ms == values.max()
    below = Latencies()
    below.add(0.0)
    assert below.quantile_ms(0.5) <= FINEST_MS


def test_marks_under_which_there_is_no_covariance_are_left_out_and_said(tmp_path, image, monkeypatch, caplog):
    """Of 20 frames, three in a row: they are not used, the target is predicted meanwhile, and tracking goes on."""
    failing, see = {round(100.0 + INTERVAL * k, 6) for k in (8, 9, 10)}, Line.see

    def seen(line, time_s, picture):
        if round(time_s, 6) in failing:
            raise CovarianceError("no likelihood that is finite")
        return see(line, time_s, picture)

    monkeypatch.setattr(Line, "see", seen)
    session, found, _ = run(Clocked(frames_at(100.0 + INTERVAL * np.arange(20), image), [], 100.7), tmp_path)
    assert session.counters.frames == 17
    assert session.counters.not_used == 3
    (said,) = [record.message for record in caplog.records if "not used" in record.message]
    assert said == "100.27 s: marks not used: no likelihood that is finite"
    assert found[-1]["status"] == "TRACKING"
