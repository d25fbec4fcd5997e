"""Faults of what a live run stands on: a real process each, of a short film."""

import json
import shutil
import sys
import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from experiments.errors import InputError
from experiments.pipeline.recorder import PIECE_S
from experiments.servers.faces import PAGE_PORT
from experiments.studies.faults import process, system
from experiments.studies.faults.judge import ONSET_S
from experiments.studies.faults.study import FAULTS
from experiments.studies.faults.viewer import Viewer
from experiments.studies.faults.world import Motion

pytestmark = [pytest.mark.slow, pytest.mark.skipif(sys.platform == "win32", reason="terminals and signals of POSIX")]

SEED = 7000
FULL = "expected a table that can be written"
PACES = [(3, 1.5), (24, 6.0), (60, 12.0)]
"""How much of the film may go by before the first state, and how long it goes on after the fault [s].

Where that is too little, on a busy machine, a longer film is begun.
"""


@pytest.fixture(autouse=True)
def _patient(monkeypatch):
    """Processes have all the time to start, to answer and to end that they take on a busy machine."""
    for name in ("STARTS_S", "ENDS_S", "GONE_S"):
        monkeypatch.setattr(process, name, 120.0)
    monkeypatch.setattr(system, "JITTER_S", 0.0)
    monkeypatch.setattr(system, "LASTS_S", 120.0)  # of the fifty viewers, who go with the run


def judged(name, folder, monkeypatch, enough=lambda _found: True, onset_s=0.5):
    """Half a second before the fault, or so long; after it, so long that enough comes."""
    for starts_s, after_s in PACES:
        film = process.filmed(SEED, film_s(starts_s, after_s))
        monkeypatch.setattr(system, "STARTS_S", starts_s)
        monkeypatch.setattr(system, "AFTER_S", after_s)
        monkeypatch.setattr(system, "filmed", lambda *_, film=film: film)
        last = (starts_s, after_s) == PACES[-1]
        try:
            found = FAULTS[name].judged(SEED, folder, onset_s=onset_s)
            if last or enough(found):
                return found
        except InputError as fault:
            if last or "a run that starts within" not in str(fault):
                raise
        shutil.rmtree(folder / "live", ignore_errors=True)
    return None


def film_s(starts_s, after_s):
    """How long the film is [s]: 1.5 before the fault and 2 while it lasts at most, and half until it ends."""
    return round(starts_s + after_s + 4.0)


def test_unread_and_watched_by_many_it_goes_on_and_killed_all_but_its_last_second_can_be_read(tmp_path, monkeypatch):
    """Closed outputs, 100 warnings, of which the first once ended the loop, and 18 viewers at once; killed 1 s later.

    A busy machine may show STALE for a moment meanwhile, as it should: asked for is what was said, and what came.
    """
    monkeypatch.setattr(system, "N_WARNINGS", 100)
    monkeypatch.setattr(system, "N_VIEWERS", 18)
    closed, watched = FAULTS["stdout closed"], FAULTS["50 viewers"]
    begins, killed = lambda run: (closed.begins(run), watched.begins(run)), FAULTS["KILL"].begins
    monkeypatch.setitem(FAULTS, "all", replace(watched, lasts_s=1.0, begins=begins, ends=killed))
    said, shown, moments, tell = [], [], system._moments, Viewer.tell
    monkeypatch.setattr(system, "_moments", lambda *given: shown.append(moments(*given)) or shown[-1])
    monkeypatch.setattr(Viewer, "tell", lambda viewer, text: (said.append(text), tell(viewer, text)))
    found = judged("all", tmp_path, monkeypatch, lambda _: said and shown[-1][-1].status == "NO CONNECTION", 1.5)
    assert set(said) == {"to further viewers: 16 clients are already connected"}
    before = {one.status for one in shown[-1] if 0.2 < one.time_s - ONSET_S < 0.9}
    assert before
    assert "NO CONNECTION" not in before
    assert shown[-1][-1].status == "NO CONNECTION"
    assert found.noticed_ms is not None
    assert found.go_shown_while_faulty == 0
    assert found.lacks_s <= PIECE_S + 3.0 * process.FRAME_S
    assert found.ended == "ended by SIGKILL"


def test_on_a_full_disk_it_says_so_and_goes_on_and_keeps_what_it_had(tmp_path, monkeypatch):
    """A busy machine may show STALE for longer than that: asked for is what was said."""
    said, new = [], Viewer._new
    monkeypatch.setattr(Viewer, "_new", lambda *given: said.append(new(*given)) or said[-1])
    found = judged("disk full", tmp_path, monkeypatch, lambda _: any(FULL in text for text in said), onset_s=1.5)
    assert any(FULL in text for text in said)
    assert str(tmp_path) not in found.shown
    assert found.noticed_ms is not None
    assert found.lacks_s is not None
    assert found.lacks_s <= PIECE_S + 3.0 * process.FRAME_S
    assert found.ended == "exit 2"


def test_a_port_that_is_taken_is_one_line_and_the_end(tmp_path, monkeypatch):
    assert system.USUAL_PORT == PAGE_PORT
    found = judged("port taken", tmp_path, monkeypatch)
    assert found.ended == "exit 2"
    assert found.shown.startswith("ENDED: softaim: --page 127.0.0.1:")
    assert found.lacks_s is None
    assert not (tmp_path / "live").exists()


def test_a_viewer_shows_stale_where_nothing_comes_and_where_what_comes_was_long_on_its_way():
    """Served are a state, one that is a second old, then none."""
    from websockets.sync.server import serve

    state = {"type": "state", "from_frame": True, "status": "TRACKING", "fault": None, "marks_used": 3, "events": []}
    state |= {"target_mm": [0.0, 0.0], "cov_mm2": [[1.0, 0.0], [0.0, 1.0]], "sigma_mm": 1.0}
    state |= {"advice": {"advice": "GO", "reason": ""}}

    def talk(stream):
        for time_s, late_s in ((0.0, 0.0), (0.1, 1.0)):
            stream.send(json.dumps({**state, "time_s": time_s, "utc_s": time.time() - late_s}))
            assert stream.recv() == "next"
        ended.wait(60.0)

    ended = threading.Event()
    with serve(talk, "127.0.0.1", 0) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        still = Motion(np.array([0.0, 10.0]), np.zeros((2, 1, 2)))
        viewer = Viewer(server.socket.getsockname()[1], still, 0, 3)
        try:
            for _ in range(6000):
                if len(viewer.moments) >= 4:
                    break
                ended.wait(0.01)
        finally:
            ended.set()
            viewer.close()
            server.shutdown()
    assert [one.status for one in viewer.moments[:4]] == ["TRACKING", "STALE", "STALE", "STALE"]
    assert [one.advice for one in viewer.moments[:4]] == ["GO", None, None, None]


def test_faults_are_of_the_same_film():
    """Which is made once, and is gone with the process."""
    film = process.filmed(SEED, film_s(*PACES[0]))
    assert process.filmed(SEED, film_s(*PACES[0])) is film
    assert film.folder.is_relative_to(process._films().name)
