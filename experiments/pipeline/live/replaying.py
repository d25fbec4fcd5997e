"""Replay of a recorded live run: the same frames, requests and times give the same estimates."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import vision
from experiments.errors import InputError, accepted, placed
from experiments.formats.needle_file import read_needle
from experiments.formats.recording import read_recording
from experiments.formats.scene.scene import read_scene
from experiments.pipeline.live.journal import JOURNAL, Act, Done, marks_of, read_journal
from experiments.pipeline.live.marks.receiver import MarksFrame
from experiments.pipeline.live.session import ADVICE, ESTIMATES, LiveFrame, Session


@dataclass(frozen=True, slots=True)
class Replayed:
    """Result of a replay.

    rows: number of compared rows, by table; different: number of the first row that differs, by table, if one differs
    begun: whether the recording began when the run began; if not, estimates differ until the filter has converged
    frames: number of replayed frames
    lacking: number of frames in the journal that have no picture, because the recorded run was killed
    """

    frames: int
    lacking: int
    rows: dict[str, int]
    different: dict[str, int]
    begun: bool


def replay(folder: Path, out: Path, advance: Callable[[float], None] = lambda _share: None) -> Replayed:
    """Replay a recording of a live run, and compare the replay's tables with the recorded tables. Raises InputError.

    out: existing folder for the tables of the replay; advance: called with the share of the recording that is replayed
    """
    scene = read_scene(folder / "scene.toml")
    needle = folder / "needle.toml"
    plan = read_needle(needle, scene.target.radius_m, scene.network.dim) if needle.exists() else None
    journal = list(read_journal(folder / JOURNAL))
    begun = bool(journal) and journal[0].act is Act.BEGIN and journal[0].values[-1] is True
    now_s = 0.0  # the time on the run's clock
    session = Session(scene, out / ESTIMATES, lambda _text: None, needle=plan, clock=lambda: now_s)
    n_frames = lacking = 0
    with ExitStack() as opened, placed(folder / JOURNAL, ValueError, TypeError, IndexError, KeyError):
        opened.callback(session.close)
        pictures = _pictures(folder, journal, opened)
        for k, done in enumerate(journal):
            advance(k / len(journal))
            now_s = done.now_s
            if done.act in (Act.FRAME, Act.MARKS):
                frame = _frame(done, pictures, n_frames)
                if frame is None:
                    lacking = sum(one.act is Act.FRAME for one in journal) - n_frames
                    break
                session.take(frame)
                n_frames += 1
            else:
                _again(done, session, folder)
    advance(1.0)
    rows, different = {}, {}
    for name in [ESTIMATES] if plan is None else [ESTIMATES, ADVICE]:
        rows[name], first = compared(folder / name, out / name)
        if first is not None:
            different[name] = first
    return Replayed(n_frames, lacking, rows, different, begun)


def _pictures(folder: Path, journal: list[Done], opened: ExitStack) -> dict[str, Iterator[vision.Frame]]:
    """Pictures of a recording, by camera; a single camera has the name "". The map is empty if there are only marks."""
    if not any(done.act is Act.FRAME for done in journal):
        return {}
    films = read_recording(folder).open_films()
    return {name: iter(opened.enter_context(film)) for name, film in films.items()}


def _frame(done: Done, pictures: Mapping[str, Iterator[vision.Frame]], index: int) -> LiveFrame | None:
    if done.act is Act.MARKS:
        return MarksFrame(index, done.time_s, marks_of(done.values))
    frames = {name: next(pictures[name], None) for name in done.values or [""]}
    images = {name: frame.image for name, frame in frames.items() if frame is not None}
    if len(images) < len(frames):
        return None
    return vision.Exposure(done.time_s, images) if done.values else vision.Frame(index, done.time_s, images[""])


def _again(done: Done, session: Session, folder: Path) -> None:
    """Repeat an action other than a frame."""
    values = done.values
    match done.act:
        case Act.ORIGIN:
            session.count_from(done.time_s)
        case Act.UNFIT:
            session.unfit(done.time_s)
        case Act.COAST:
            session.coast(done.time_s)
        case Act.PAUSE:
            session.pause(bool(values[0]))
        case Act.RESET:
            session.reset()
        case Act.FIX:
            session.fix(np.array(values[:-1]), values[-1])
        case Act.HUE:
            session.colour(values[0], vision.MarkHue(*values[1:]))
        case Act.DATED:
            session.dated(values[0], uneven=values[1])
        case Act.NEEDLE if not values:
            session.needle_unseen()
        case Act.NEEDLE:
            half = len(values) // 2
            session.needle_at(np.array(values[:half]), np.array(values[half:]))
        case Act.BEGIN:
            pass
        case _:
            raise InputError.at(folder / JOURNAL, "an action that this version knows", str(done.act))


def compared(recorded: Path, replayed: Path) -> tuple[int, int | None]:
    """Number of compared rows of two tables, and number of the first different row; None if all rows are equal.

    The first row of data has the number 1. If the recorded run was killed, an incomplete last row is ignored.
    """
    mine, theirs = (_rows(path) for path in (replayed, recorded))
    n = min(len(mine), len(theirs))
    return n, next((k + 1 for k in range(n) if mine[k] != theirs[k]), None)


def _rows(path: Path) -> list[str]:
    with accepted(path, "the table of a live run"):
        text = path.read_text(encoding="utf-8")
    return text[: text.rfind("\n") + 1].splitlines()[1:]
