"""Requests to a live run by its viewers; each is handled between two frames."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import vision
from experiments.arrays import Floats
from experiments.errors import InputError
from experiments.pipeline.live.recording import LiveRecording
from experiments.pipeline.live.session import Session
from experiments.pipeline.recorder import join

RECORDING = "recording"


class Control:
    """Handles requests of viewers to a live run.

    A request that fails raises ValueError or InputError with a message of one line.
    out: the run's folder, in which each recording gets a folder; needle: content of the needle's file
    """

    def __init__(self, session: Session, out: Path, *, source: str, needle: bytes | None = None) -> None:
        self.session, self._out, self._source, self._needle = session, out, source, needle
        self.recordings: list[LiveRecording] = []

    @property
    def recording(self) -> LiveRecording | None:
        """The present recording, or None."""
        return self.recordings[-1] if self.recordings and self.recordings[-1].going else None

    def record(self, on: bool) -> None:
        """Begin a recording, or end the present one."""
        session = self.session
        if on and self.recording is None:
            self._end()
            folder = self._out / f"{RECORDING}-{len(self.recordings) + 1}"
            begun, scene = not session.has_begun, session.line.scene
            one = LiveRecording(folder, scene, needle=self._needle, source=self._source, begun=begun)
            self.recordings.append(one)
            session.journals = [one]
            for table in session.tables:
                table.copied(folder / table.path.name).begin()
        elif not on:
            self._end()

    def _end(self) -> None:
        self.session.journals = []
        for table in self.session.tables:
            for copy in table.also:
                copy.close()
            table.also.clear()
        if self.recordings:
            self.recordings[-1].finish()

    def fix_at(self, place_px: Floats, sd_m: float) -> None:
        """Use a measured position of the target in the picture [px], (2,), whose standard deviation is sd_m [m]."""
        line = self.session.line
        if not line.scene.cameras:
            raise ValueError("fix: expected a camera, found none")
        self.session.fix(line.camera.to_plane(np.asarray(place_px)[None])[0], sd_m)

    def colour_at(self, node: str, place_px: Floats) -> None:
        """Set the colour of this node's mark to the colour of the newest picture at this position [px], (2,)."""
        if node not in (mark.node for mark in self.session.line.scene.marks):
            raise ValueError(f"hue: expected a node with a mark, found {node}")
        if self.session.picture is None:
            raise ValueError("hue: expected a picture, found none")
        self.session.colour(node, vision.learn_hue(self.session.picture.image, place_px))

    def finish(self) -> list[Path]:
        """End all recordings of the run and join the pieces of their films; returns the recordings' folders."""
        self._end()
        for one in self.recordings:
            if any(one.folder.glob("**/segments")):
                try:
                    join(one.folder)
                except InputError as error:
                    one.fail(error)
        return [one.folder for one in self.recordings]
