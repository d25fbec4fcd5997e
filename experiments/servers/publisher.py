"""An `Attendant` of a live run: it publishes the state to viewers, and handles their requests."""

from __future__ import annotations

import logging
import time
from collections import deque
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any, Self

import numpy as np

from estimators import Advice, Guidance
from experiments.errors import InputError
from experiments.film.views import ground_camera, overlay_of
from experiments.formats.needle_file import NeedlePlan
from experiments.formats.scene.scene import Scene
from experiments.log import LOG
from experiments.pipeline.line import Line
from experiments.pipeline.live.advice import nowhere
from experiments.pipeline.live.control import Control
from experiments.pipeline.live.preparing import PREPARING
from experiments.pipeline.live.shown import Counters, Shown, memory_mb
from experiments.servers.commands import (
    Command,
    Fix,
    Hue,
    NeedleAt,
    NeedleUnseen,
    Pause,
    Record,
    Reset,
    is_needle,
    read_command,
)
from experiments.servers.link import Link
from experiments.servers.message import scene_message, state_message
from vision import Frame, SourceError
from vision.arrays import Image

LAST_EVENTS = 8
"""Number of events in a state; choice."""

TELLS_S = 2.0
"""The servers' addresses are printed after this time [s], or at the first frame if it comes before; choice: a wrong
source fails sooner."""

ATTENDS_S = 0.005
"""Longest time for requests between two frames [s]; choice."""


class LastEvents(logging.Handler):
    """Log handler that stores the last reported lines."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.lines: deque[dict[str, Any]] = deque(maxlen=LAST_EVENTS)

    def emit(self, record: logging.LogRecord) -> None:
        """Store a line."""
        self.lines.append({"utc_s": record.created, "text": record.getMessage()})


class Shows:
    """`Attendant` that shows a run to viewers through a link."""

    def __init__(self, link: Link, scene: Scene, plan: NeedlePlan | None, source: str) -> None:
        self.link = link
        flat = scene.network.dim == 2
        self._camera = scene.cameras[0] if scene.cameras else ground_camera(scene) if flat else None
        self._events = LastEvents()
        self._memory_mb = memory_mb()
        self._recording: Mapping[str, Any] | None = None
        self._paused = False
        self._began_s = time.monotonic()
        self._dim, self._plan = scene.network.dim, plan
        link.begin(scene_message(scene, source, None if self._camera is None else self._camera.size_px, plan))

    def prepare(self, frame: Frame | None, n_shown: int, time_s: float) -> None:
        """Show a frame while there is no estimate yet; frame: None while there is no frame either."""
        if n_shown or time.monotonic() - self._began_s > TELLS_S:
            self.link.tell()
        at_s = time.monotonic() if frame is None else frame.exposure_s
        guidance = None if self._plan is None else Guidance(Advice.NO_GUIDANCE, PREPARING)
        counters = Counters(not_used=n_shown)
        shown = Shown(nowhere(time_s, self._dim), at_s, frame, None, guidance, None, PREPARING, None, counters, "")
        self._send(shown, frame.image if frame is not None and self.link.wants_picture else None)

    def publish(self, shown: Shown, line: Line) -> None:
        """Publish the present state."""
        camera = self._camera if shown.frame is None else line.camera
        overlay = image = None
        if self.link.wants_picture and camera is not None and shown.step is not None:
            overlay = overlay_of(line, shown.step, camera, shown.guidance, shown.plan)
            image = None if shown.frame is None else shown.frame.image
        if not shown.counters.frames % 64:
            self._memory_mb = memory_mb()
        self._send(shown, image, overlay=overlay, nodes_m=line.filter.positions if camera is None else None)

    def _send(self, shown: Shown, image: Image | None, **of_picture: Any) -> None:
        message = partial(
            state_message,
            replace(shown, counters=replace(shown.counters)),  # a copy: another thread makes the message later
            utc_s=shown.at_s + time.time() - time.monotonic(),
            memory_mb=self._memory_mb,
            events=list(self._events.lines),
            recording=self._recording,
            paused=self._paused,
            **of_picture,
        )
        self.link.publish(message, image)

    def attend(self, control: Control) -> None:
        """Handle the requests since the previous cycle of the loop, and report failed requests.

        It returns after `ATTENDS_S`, so that many requests do not delay a frame; the next cycle handles the rest.
        """
        if control.session.counters.frames or time.monotonic() - self._began_s > TELLS_S:
            self.link.tell()
        until_s = time.monotonic() + ATTENDS_S
        for request in self.link.requests():
            try:
                command = read_command(request)
                do(command, control)
                LOG.info("request: %s", command)
            except (ValueError, InputError, SourceError) as error:
                LOG.warning("not done: %s", error)
                if is_needle(request) and control.session.advice is not None:
                    control.session.needle_unseen()
            if time.monotonic() > until_s:
                break
        recording = control.recording
        self._recording = None if recording is None else {"folder": str(recording.folder), "frames": recording.n_frames}
        self._paused = control.session.paused

    def __enter__(self) -> Self:
        """Store events from now until the context ends."""
        LOG.addHandler(self._events)
        return self

    def __exit__(self, *_: object) -> None:
        LOG.removeHandler(self._events)


def do(command: Command, control: Control) -> None:
    """Handle a client's request. If the request fails, raises ValueError or InputError."""
    match command:
        case Pause():
            control.session.pause(command.on)
        case Record():
            control.record(command.on)
        case Reset():
            control.session.reset()
        case Fix() if command.place_px is not None:
            control.fix_at(np.array(command.place_px), 1e-3 * command.sd_mm)
        case Fix() if command.place_mm is not None:
            control.session.fix(1e-3 * np.array(command.place_mm), 1e-3 * command.sd_mm)
        case Hue():
            control.colour_at(command.node, np.array(command.place_px))
        case NeedleAt():
            control.session.needle_at(1e-3 * np.array(command.tip_mm), np.array(command.direction))
        case NeedleUnseen():
            control.session.needle_unseen()
        case _:
            raise ValueError("fix: expected place_mm or place_px, found neither")
