"""The live loop while frames come, stop and come back; by a clock of the test's own."""

import csv
from collections import deque
from collections.abc import Callable, Sequence
from itertools import count, pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import vision
from experiments.formats.needle_file import NeedlePlan
from experiments.formats.scene.scene import Scene
from experiments.pipeline.live.following import follow
from experiments.pipeline.live.session import WAIT_S, Session
from experiments.simulation.film import draw
from experiments.simulation.simulate import scene_of
from tests.experiments.webcam import coarse_webcam
from vision import EventKind, Frame, SourceEvent

INTERVAL = 1 / 30


@pytest.fixture(scope="module")
def image() -> np.ndarray:
    """The phantom at rest."""
    scene = scene_of(coarse_webcam())
    return draw(scene, scene.network.positions, vision.Lighting(), np.random.default_rng(0), strays=[])


class Clocked(vision.EveryFrame):
    """A source that gives frames when the test's clock reaches their arrival, and moves that clock while it waits."""

    def __init__(self, frames: list, events: Sequence[SourceEvent] = (), end_s: float | None = None) -> None:
        """Frames, or exposures, by their arrivals; the source ends with the last, or at this time [s]."""
        self.now, self.end_s = 100.0, frames[-1][0] if end_s is None else end_s
        self._arrivals, self._reported = deque(frames), deque(events)

    @property
    def ended(self) -> bool:
        return self.now >= self.end_s

    def next(self, timeout_s: float = 0.0) -> Frame | None:
        if self._arrivals and self._arrivals[0][0] <= self.now + timeout_s:
            arrival, frame = self._arrivals.popleft()
            self.now = max(self.now, arrival)
            return frame
        self.now += timeout_s
        return None

    def take_events(self) -> tuple[SourceEvent, ...]:
        due = []
        while self._reported and self._reported[0].time_s <= self.now:
            due.append(self._reported.popleft())
        return tuple(due)


def frames_at(times_s: np.ndarray, image: np.ndarray) -> list[tuple[float, Frame]]:
    """Frames that arrive 20 ms after their exposure."""
    return [(t + 0.02, Frame(k, t, image)) for k, t in enumerate(times_s)]


def run(
    source: Clocked,
    folder: Path,
    attend: Callable[[Session], None] = lambda _session: None,
    scene: Scene | None = None,
    plan: NeedlePlan | None = None,
    tested_s: float | None = None,
) -> tuple[Session, list[dict[str, str]], list[tuple[float, str]]]:
    """The session, its rows, and what was shown when; attend: at each turn; tested_s: when forces were tested."""
    shown: list[tuple[float, str]] = []
    scene, rows = scene or scene_of(coarse_webcam()), folder / "estimates.csv"
    session = Session(scene, rows, lambda text: shown.append((source.now, text)), needle=plan, clock=lambda: source.now)
    session.integrity.tested_s = tested_s
    follow(session, source, np.inf, clock=lambda: source.now, attend=lambda: attend(session))
    session.close()
    return session, list(csv.DictReader(rows.read_text(encoding="utf-8").splitlines())) if rows.exists() else [], shown


def test_frames_dropped_before_the_loop_began_are_no_deadlines_missed(tmp_path, image):
    class Dropping(Clocked):
        @property
        def frames_dropped(self) -> int:
            return 7 + 2 * (self.now > 100.3)

    times = np.round(100.0 + INTERVAL * np.arange(15), 9)
    session, _, _ = run(Dropping(frames_at(times, image), [], 100.5), tmp_path)
    assert session.counters.dropped == 2


def test_while_nothing_comes_the_target_is_predicted_and_said_to_coast_then_to_be_lost(tmp_path, image, capfd):
    """Half a second of frames, 2 s of none, half a second again."""
    before, after = (np.round(at + INTERVAL * np.arange(15), 9) for at in (100.0, 102.5))
    gap = before[-1], after[0]
    blocked = SourceEvent(gap[0] + 0.5, EventKind.BLOCKED, "no answer for 0.50 s")
    source = Clocked(frames_at(before, image) + frames_at(after, image), [blocked], 103.0)
    session, rows, shown = run(source, tmp_path)
    times = np.array([float(row["time_s"]) for row in rows])
    status = np.array([row["status"] for row in rows])
    assert (np.diff(times) > 0).all()
    assert session.counters.frames == 30
    assert session.counters.not_used == 0
    assert len(rows) == 30 + session.counters.without_frame
    assert {row["marks_used"] for row in rows if gap[0] < float(row["time_s"]) < gap[1]} == {"0"}
    within = (times > gap[0]) & (times < gap[1])
    assert set(status[within & (times < gap[0] + 1.0)]) == {"COASTING"}
    assert set(status[within & (times > gap[0] + 1.01)]) == {"LOST"}
    assert status[-1] == "TRACKING"
    # what is shown is of now: within two waits of the last frame, and all along
    coasting = [t for t, text in shown if "COASTING" in text]
    lost = [t for t, text in shown if "LOST" in text]
    assert coasting[0] - (gap[0] + 0.02) <= 2 * WAIT_S
    assert lost[0] == pytest.approx(gap[0] + 1.0, abs=2 * WAIT_S)
    assert np.diff(coasting + lost).max() < 2 * WAIT_S
    # sigma grows while nothing comes
    widths = [float(row["xx"]) for row in rows if gap[0] < float(row["time_s"]) < gap[0] + 1.0]
    assert widths[-1] > 2.0 * widths[0]
    assert capfd.readouterr().err == f"softaim: {blocked.time_s:.2f} s: BLOCKED: no answer for 0.50 s\n"


@pytest.mark.slow
@pytest.mark.parametrize(("interval_s", "late_s", "unused"), [(1.09, 0.55, 0), (1.5, 2.5, 1)])
def test_a_slow_camera_loses_no_frame_though_the_target_coasts_between(tmp_path, image, interval_s, late_s, unused):
    """The paper's, a frame each 1.09 s, half an interval after its exposure; of a slower one the second is too late."""
    times = 100.0 + interval_s * np.arange(2)
    frames = [(t + late_s, Frame(k, t, image)) for k, t in enumerate(times)]
    session, rows, _ = run(Clocked(frames, [], frames[-1][0] + 0.05), tmp_path)
    assert session.counters.not_used == unused
    assert session.counters.frames == 2 - unused
    assert sum(row["marks_used"] != "0" for row in rows) == 2 - unused


def test_a_frame_older_than_what_was_reported_and_one_of_another_size_are_not_used(tmp_path, image):
    times = 100.0 + INTERVAL * np.arange(15)
    stale = (101.5, Frame(15, times[-1] + 0.01, image))
    other = (101.6, Frame(16, 101.59, image[:-2]))
    session, rows, _ = run(Clocked([*frames_at(times, image), stale, other], [], 102.0), tmp_path)
    assert session.counters.frames == 15
    assert session.counters.not_used == 2
    assert (np.diff([float(row["time_s"]) for row in rows]) > 0).all()


def test_before_the_first_frame_nothing_is_reported_of_the_target(tmp_path):
    session, _, shown = run(Clocked([], [], 100.3), tmp_path)
    assert list(tmp_path.iterdir()) == []  # what an earlier run may have left there stays
    assert {text for _, text in shown} == {"no frame yet"}
    assert session.counters.frames == 0


def test_a_film_is_reported_in_its_own_times(tmp_path, image, capfd):
    """A film that began at 100 on the clock, its own time 40 then: rows, the status line and events have the film's."""
    times = 100.0 + INTERVAL * np.arange(10)
    blocked = SourceEvent(100.1, EventKind.BLOCKED, "no answer for 0.50 s")
    source = Clocked(frames_at(times, image), [blocked], 100.4)
    source.origin_s = 60.0
    session, rows, shown = run(source, tmp_path)
    assert session.counters.frames == 10
    own = [float(row["time_s"]) for row in rows][:10]
    np.testing.assert_allclose(own, 40.0 + INTERVAL * np.arange(10), rtol=0, atol=1e-9)
    assert shown[0][1].split(" s ")[0].strip() == "40.00"
    assert capfd.readouterr().err == "softaim: 40.10 s: BLOCKED: no answer for 0.50 s\n"


def test_frames_that_may_be_late_or_come_unevenly_get_no_guidance_until_somebody_looked(tmp_path, image):
    shown: list[str] = []
    seen = SimpleNamespace(publish=lambda moment, _line: shown.append(moment.fault or ""))
    clock, scene = iter(np.arange(1.0, 9.0, 0.001)), scene_of(coarse_webcam())
    session = Session(scene, tmp_path / "e.csv", lambda _: None, publisher=seen, clock=lambda: next(clock))
    for k, known in enumerate([(0.0, True), (1.0, False), None, (1.5, False)]):
        session.reset() if known is None else session.dated(known[0], uneven=known[1])
        session.take(Frame(k, 1.0 + 0.033 * k, image))
    session.close()
    found = ["unevenly" in shown[0], "1.0 s late" in shown[1], "late" in shown[2], "1.5 s late" in shown[3]]
    assert found == [True, True, False, True]


@pytest.mark.parametrize("at", [10, 20])
def test_a_filter_whose_state_is_no_number_restarts_and_says_so(tmp_path, image, caplog, at):
    """Before a frame, and before a moment without one; a contradiction of the marks stays in mind."""
    frames = frames_at(100.0 + INTERVAL * np.array([*range(15), *range(24, 36)]), image)
    turns = count(1)

    def attend(session: Session) -> None:
        if (turn := next(turns)) == 1:
            session.integrity.contradiction.reason = "made up"
        if turn == at:
            session.line.filter.filter.covs[:] = np.nan

    session, rows, _ = run(Clocked(frames, [], 101.3), tmp_path, attend=attend)
    assert sum("the state is not finite" in record.message for record in caplog.records) == 1
    assert session.counters.frames == len(frames)
    assert session.integrity.contradiction.reason == "made up"
    status = [row["status"] for row in rows]
    assert status[-1] == "TRACKING"
    assert sum(one != "INITIALISING" == then for one, then in pairwise(status)) == 1
