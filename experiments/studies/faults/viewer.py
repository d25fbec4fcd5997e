"""A viewer of a live run: a client of its stream that stores what the page would show."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from experiments.studies.faults.judge import STALE_S, Moment, is_wrong
from experiments.studies.faults.world import Motion

POLL_S = 0.02
"""Interval at which a viewer checks its clock [s]."""
OPENS_S = 30.0
"""Timeout of a viewer's connection [s]: longer than any run needs."""
STREAM = "ws://127.0.0.1:{port}/stream?pace=1"


class Viewer:
    """A client of the stream. After it has shown a state, it requests the newest state.

    Like the page, it shows STALE in two cases: if nothing has arrived for STALE_S, and if the delay of a state exceeds
    the smallest delay so far by more than STALE_S.

    motion: true motion of all nodes; target: index of the target node
    n_measured: number of marks that the filter may use; pause_s: time for which each state is shown [s]
    moments: what was displayed so far
    known_s: for each displayed frame, the time of its display and its exposure time, both since the film's start [s]
    """

    def __init__(self, port: int, motion: Motion, target: int, n_measured: int, *, pause_s: float = 0.0) -> None:
        self.moments: list[Moment] = []
        self.known_s: list[tuple[float, float]] = []
        self._port, self._pause_s = port, pause_s
        self._motion, self._target, self._n_measured = motion, target, n_measured
        self._origin_s: float | None = None
        self._used_s, self._fastest_s = -np.inf, np.inf
        self._events: set[str] | None = None
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="viewer", daemon=True)
        self._thread.start()

    @property
    def now_s(self) -> float:
        """Time since the start of the film [s]; -inf before the first state."""
        return -np.inf if self._origin_s is None else time.time() - self._origin_s

    def tell(self, text: str) -> None:
        """Add to `moments` a message that another viewer received."""
        self.moments.append(Moment(self.now_s, 0.0, "TRACKING", None, "", 0.0, wrong=False, well=True, reported=text))

    def close(self) -> None:
        """Stop watching."""
        self._ended.set()
        self._thread.join()

    def _watch(self) -> None:
        from websockets.exceptions import WebSocketException
        from websockets.sync.client import connect

        try:
            with connect(STREAM.format(port=self._port), open_timeout=OPENS_S, close_timeout=0.1) as stream:
                came_s = time.monotonic()
                while not self._ended.is_set():
                    try:
                        message = json.loads(stream.recv(timeout=POLL_S))
                    except TimeoutError:
                        if time.monotonic() - came_s > STALE_S and self._origin_s is not None:
                            self._silent("STALE")
                        continue
                    if message["type"] == "state":
                        self._show(message)
                        self._ended.wait(self._pause_s)
                        stream.send("next")
                    came_s = time.monotonic()
        except (WebSocketException, OSError):
            while not self._ended.wait(POLL_S):
                self._silent("NO CONNECTION")

    def _silent(self, word: str) -> None:
        age_s = self.now_s - self._used_s
        self.moments.append(Moment(self.now_s, age_s, word, None, "", np.inf, wrong=False, well=False))

    def _show(self, state: Mapping[str, Any]) -> None:
        self._origin_s = state["utc_s"] - state["time_s"]
        now_s, time_s = self.now_s, state["time_s"]
        self._fastest_s = min(self._fastest_s, now_s - time_s)
        if state["from_frame"]:
            self._used_s = time_s
            self.known_s.append((now_s, time_s))
        if now_s - time_s - self._fastest_s > STALE_S:
            self._silent("STALE")
            return
        mean = np.array(state["target_mm"] or [np.nan]) * 1e-3
        cov = None if state["cov_mm2"] is None else 1e-6 * np.array(state["cov_mm2"])
        advice = state["advice"]
        word = None if advice is None else advice["advice"]
        lacking = state["from_frame"] and state["marks_used"] < self._n_measured
        why = state["fault"] or ("marks lost or refused" if lacking else "")
        why = advice["reason"] if word == "ABORT" else why
        self.moments.append(
            Moment(
                now_s,
                now_s - self._used_s,
                state["status"],
                word,
                why,
                np.inf if state["sigma_mm"] is None else 1e-3 * state["sigma_mm"],
                wrong=is_wrong(mean, cov, self._motion.at(time_s)[self._target]),
                well=state["status"] == "TRACKING" and not why,
                reported=self._new(state["events"]),
            )
        )

    def _new(self, events: list[Mapping[str, Any]]) -> str:
        """Text of the events that no earlier state contained. For the first state, the text is empty."""
        texts = {str(one["text"]) for one in events}
        before, self._events = self._events, texts if self._events is None else self._events | texts
        return "" if before is None else "; ".join(sorted(one for one in texts - before if "RESUMED" not in one))
