"""Recording of a live run: a folder with all its input, actions and estimates, for an exact replay.

The folder has the files of `softaim record`, or marks.csv, and the loop's journal and tables. All files are written
continuously; each camera has a thread that compresses its pictures without delaying the loop.
"""

from __future__ import annotations

from pathlib import Path

import vision
from experiments.errors import InputError, accepted
from experiments.formats.films.pictures import MARKS, growing_in
from experiments.formats.films.several import film_name
from experiments.formats.marks.rows import AXES, cov_columns, cov_entries_mm2
from experiments.formats.outputs import write_whole
from experiments.formats.scene.scene import Scene, write_scene
from experiments.log import LOG
from experiments.pipeline.live.journal import HEADER, JOURNAL, Act, Done, mark_values
from experiments.pipeline.live.marks.receiver import MarksFrame
from experiments.pipeline.live.outputs import LiveTable
from experiments.pipeline.live.recorder_thread import RecorderThread

WAITING = 64
"""Largest number of pictures of a camera that wait for compression; choice: 60 MB at 640x480, 1 s at 60 frames/s."""


class LiveRecording:
    """A recording of a live run, in a new folder.

    begun: whether the recording begins when the run begins; if it does, a replay gives bit-identical estimates
    If a thread is too slow or the disk is full, the recording ends with a message, and the run continues.
    """

    def __init__(self, folder: Path, scene: Scene, *, needle: bytes | None, source: str, begun: bool) -> None:
        self.folder, self.n_frames = folder, 0
        self.fault: Exception | None = None
        self._scene = scene
        with accepted(folder, "a new folder that can be written"):
            folder.mkdir(parents=True)
            write_scene(scene, folder / "scene.toml")
            if needle is not None:
                write_whole(folder / "needle.toml", needle)
        self._journal = LiveTable(folder / JOURNAL, HEADER)
        self._marks: LiveTable | None = None
        self._frames: LiveTable | None = None
        cameras = [film_name(one.name, i) for i, one in enumerate(scene.space_cameras)] or [""]
        self._pictures: dict[str, RecorderThread[vision.Frame]] = {
            name: RecorderThread(
                growing_in(folder, name),
                "FFV1",
                lambda frame: frame,
                n_waiting=WAITING,
                faults=(InputError, vision.SourceError, OSError),
                failed=self.fail,
            )
            for name in cameras
        }
        self.note(Done(Act.BEGIN, 0.0, 0.0, (source, begun)))

    @property
    def going(self) -> bool:
        """Whether the recording is still being written."""
        return self.fault is None and not any(thread.ends for thread in self._pictures.values())

    def note(self, done: Done) -> None:
        """Write an action other than a frame to the journal."""
        if self.going:
            self._journal.write(done.row)
            self.fault = self.fault or self._journal.fault

    def frame(
        self, frame: vision.Frame | vision.Exposure | MarksFrame, exposure_s: float, now_s: float, *, fits: bool
    ) -> None:
        """Write a frame exposed at exposure_s [s]; now_s: clock time [s]; fits: whether the run can use the frame."""
        if not self.going:
            return
        if not fits:
            self.note(Done(Act.UNFIT, exposure_s, now_s))
        elif isinstance(frame, MarksFrame):
            self._keep_marks(frame, exposure_s)
            self.note(Done(Act.MARKS, exposure_s, now_s, mark_values(frame.marks)))
            self.n_frames += 1
        else:
            images = {"": frame.image} if isinstance(frame, vision.Frame) else frame.images
            for name, image in images.items():
                if not self._pictures[name].put(vision.Frame(self.n_frames, exposure_s, image)):
                    found = f"{WAITING} frames waiting"
                    self.fail(InputError.at(self.folder, "a disk and a processor that keep up", found))
                    return
            self.note(Done(Act.FRAME, exposure_s, now_s, tuple(name for name in images if name)))
            self.n_frames += 1

    def _keep_marks(self, frame: MarksFrame, exposure_s: float) -> None:
        if self._marks is None or self._frames is None:
            dim = self._scene.network.dim
            self._marks = LiveTable(self.folder / MARKS, ("time_s", "node", *AXES[:dim], *cov_columns(dim)))
            self._frames = LiveTable(self.folder / "frames.csv", ("frame", "exposure_s"))
        self._frames.write((self.n_frames, f"{exposure_s:.9f}"))
        for mark in frame.marks:
            entries_mm2 = cov_entries_mm2(mark.total_cov)
            self._marks.write((f"{exposure_s:.9f}", mark.node, *(1e3 * mark.position).tolist(), *entries_mm2))

    def fail(self, fault: Exception) -> None:
        """End the recording because of this fault; what has been recorded is kept."""
        if self.fault is None:
            self.fault = fault
            LOG.warning("recording: %s; it ends here, the run continues", fault)

    def finish(self) -> None:
        """Write the waiting pictures, and close the tables."""
        for thread in self._pictures.values():
            thread.finish()
        for table in (self._journal, self._marks, self._frames):
            if table is not None:
                table.close()
