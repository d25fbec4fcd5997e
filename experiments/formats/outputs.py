"""Output folders and files that appear complete or not at all."""

from __future__ import annotations

import errno
import os
import secrets
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from experiments.errors import InputError, accepted

if TYPE_CHECKING:
    import pandas as pd

TIMES = ("time_s", "arrival_s")
"""Columns with times, which may be large, for example seconds since 1970."""

FULL = (errno.ENOSPC, errno.EDQUOT)
"""Error numbers of the operating system for a full disk and for an exhausted quota."""


@contextmanager
def output_folder(path: Path, force: bool = False, *, inputs: Sequence[Path] = ()) -> Iterator[Path]:
    """A temporary folder. At the end its files move to `path`; after an exception they are deleted instead.

    force: write into a folder that is not empty; files with the same names are replaced, all others stay
    inputs: folders that are read; a `path` that equals, contains or lies in one of them is rejected even with force

    If `path` cannot be written, InputError is raised before the `with` block.
    """
    final = _folder(path, force, inputs)
    work: Path | None = None
    try:
        with accepted(path, "room to write", FULL):
            work = _fresh_folder(path, final)
            yield work
            _check_free(path, final, force, work)  # tested again: other programs may have written there meanwhile
            with accepted(path, "a folder that can be written"):
                if final.is_dir():
                    _merge(path, work, final)
                else:
                    final.parent.mkdir(parents=True, exist_ok=True)
                    work.rename(final)
    finally:
        if work is not None:
            shutil.rmtree(work, ignore_errors=True)


def _probe(final: Path, folder: Path) -> None:
    """Test whether a folder is writable, with a temporary file."""
    part = _part_of(final, folder)
    part.touch(exist_ok=False)
    part.unlink()


@contextmanager
def growing_folder(path: Path, force: bool = False, *, inputs: Sequence[Path] = ()) -> Iterator[Path]:
    """The folder `path`. Files are written directly into it and stay after an exception.

    Use this for output that cannot be repeated, such as that of a live run. A new folder that stays empty is removed.
    If `path` cannot be written, InputError is raised before the `with` block.
    force, inputs: as in `output_folder`
    """
    final = _folder(path, force, inputs)
    made = not final.is_dir()
    with accepted(path, "a folder that can be written"):
        final.mkdir(parents=True, exist_ok=True)
        _probe(final, final)
    try:
        yield final
    finally:
        if made and not any(final.iterdir()):
            final.rmdir()


def table_text(table: pd.DataFrame) -> str:
    """A table as CSV: times to the nanosecond, other numbers to nine digits."""
    exact = {name: table[name].map(lambda t: repr(round(t, 9)), na_action="ignore") for name in TIMES if name in table}
    return str(table.assign(**exact).to_csv(index=False, float_format="%.9g", lineterminator="\n"))


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file atomically: at any time the file has its old or its complete new content. Raises InputError."""
    write_together({path: content})


def write_together(contents: Mapping[Path, str | bytes], written: Mapping[Path, Path] | None = None) -> None:
    """Write several files together: all of them or, after any fault, none. Raises InputError.

    contents: content of each file to write, by path
    written: complete temporary files to move, by final path; they are moved last
    """
    paths = [*contents, *(written or {})]
    finals = {path: _final(path) for path in paths}
    for path, final in finals.items():
        if list(finals.values()).count(final) > 1:
            raise InputError.at(path, "a different file for each output", "the same")
    parts = {path: _part_of(final, final.parent) for path, final in finals.items()} | dict(written or {})
    old: dict[Path, bytes | None] = {}
    path = Path()
    try:
        try:
            for path, content in contents.items():
                with parts[path].open("xb") as file:
                    file.write(content.encode("utf-8") if isinstance(content, str) else content)
                    file.flush()
                    os.fsync(file.fileno())
            for path, final in finals.items():
                if path != paths[-1]:  # to put it back; the last file is never put back
                    old[final] = final.read_bytes() if final.exists() else None
                parts[path].replace(final)
        except BaseException:
            for final, before in old.items():
                if before is None:
                    final.unlink(missing_ok=True)
                else:
                    final.write_bytes(before)
            raise
        finally:
            for part in parts.values():
                part.unlink(missing_ok=True)
    except OSError as error:
        raise InputError.refused(path, "a file that can be written", error) from error


@contextmanager
def streamed_file(path: Path, beside: Callable[[], Mapping[Path, str | bytes]] = dict) -> Iterator[BinaryIO]:
    """A temporary file to write incrementally. At the end it replaces `path`; after an exception it is deleted instead.

    beside: called when the file is complete; returns the contents of further files, written together with it
    """
    final = _final(path)
    part = _part_of(final, final.parent)
    with accepted(path, "a file that can be written"):
        file = part.open("xb")
    try:
        with accepted(path, "room to write", FULL):
            with file:
                yield file
                file.flush()
                os.fsync(file.fileno())
            write_together(beside(), {path: part})
    finally:
        part.unlink(missing_ok=True)


def check_new(path: Path, force: bool) -> None:
    """Raise InputError if `path` is not writable, or if a file exists there and `force` is False."""
    final = _final(path)
    if final.is_file() and not force:
        raise InputError.at(path, "a new file", "an existing one; --force replaces it")
    if not final.parent.is_dir():
        raise InputError.at(path, "a file in an existing folder", "none" if not final.parent.exists() else "a file")
    with accepted(path, "a file that can be written"):
        _probe(final, final.parent)


def _final(path: Path) -> Path:
    final = Path(os.path.realpath(path))  # writes through a symbolic link, like a plain write
    if os.path.isdir(final):
        raise InputError.at(path, "a file", "a folder")
    if os.path.exists(final) and not os.path.isfile(final):
        raise InputError.at(path, "a file", "a device")
    return final


def _part_of(final: Path, folder: Path) -> Path:
    return folder / f".{final.name}.{secrets.token_hex(4)}.part"


def check_apart(path: Path, source: Path) -> None:
    """Raise InputError if an output folder equals, contains or lies in an input folder."""
    final = Path(os.path.realpath(path))
    read = Path(os.path.realpath(source))
    if final == read or read in final.parents or final in read.parents:
        found = "the same" if final == read else "one in the other"
        raise InputError.at(path, f"a folder apart from {source}, which is read", found)


def check_outside(path: Path, folder: Path) -> None:
    """Raise InputError if an output file lies in an input folder."""
    if Path(os.path.realpath(folder)) in Path(os.path.realpath(path)).parents:
        raise InputError.at(path, f"a file outside of {folder}, which is read", "one in it")


def _folder(path: Path, force: bool, inputs: Sequence[Path]) -> Path:
    """Path of an output folder, with symbolic links resolved; raises InputError if the folder must not be written."""
    for source in inputs:
        check_apart(path, source)
    final = Path(os.path.realpath(path))
    _check_free(path, final, force, work=None)
    return final


def _check_free(path: Path, final: Path, force: bool, work: Path | None) -> None:
    if not os.path.isdir(final):
        if os.path.exists(final):
            raise InputError.at(path, "a folder", "a file")
        return
    with accepted(path, "a folder that can be read"):
        taken = any(entry != work for entry in final.iterdir())
    if taken and not force:
        raise InputError.at(path, "an empty or new folder", "files in it; --force adds to them or replaces them")


def _fresh_folder(path: Path, final: Path) -> Path:
    """A new temporary folder on the file system of `final`: in its parent folder if possible, else in `final`."""
    places = [next((parent for parent in final.parents if os.path.exists(parent)), final)]
    if os.path.isdir(final):
        if not os.access(final, os.W_OK):
            raise InputError.at(path, "a folder that can be written", "permission denied")
        if final.stat().st_dev == places[0].stat().st_dev:
            places.append(final)
        else:  # a mounted volume: files cannot be moved into it atomically
            places = [final]
    faults: list[OSError] = []
    for place in places:
        work = _part_of(final, place)
        try:
            work.mkdir()
        except OSError as error:
            faults.append(error)
        else:
            return work
    raise InputError.refused(path, "a folder that can be written", faults[0])


def _merge(path: Path, work: Path, final: Path) -> None:
    """Move all files of `work` into `final`, where they replace files of the same name. A fault undoes all moves."""
    files = sorted(file.relative_to(work) for file in work.rglob("*") if not file.is_dir())
    for file in files:
        if (final / file).is_dir():
            raise InputError.at(path / file, "a file to replace", "a folder")
        for parent in file.parents[:-1]:
            if (final / parent).exists() and not (final / parent).is_dir():
                raise InputError.at(path / parent, "a folder to write into", "a file")
    kept = _part_of(work, work)
    undo: list[tuple[Path, Path]] = []
    made: list[Path] = []
    try:
        for file in files:
            for parent in [*reversed(file.parents[:-1])]:
                if not (final / parent).exists():
                    (final / parent).mkdir()
                    made.append(final / parent)
            if (final / file).exists():
                (kept / file).parent.mkdir(parents=True, exist_ok=True)
                undo.append((kept / file, final / file))
                (final / file).rename(kept / file)
            undo.append((final / file, work / file))
            (work / file).rename(final / file)
    except BaseException:
        for moved, back in reversed(undo):
            if moved.exists():
                moved.replace(back)
        for folder in reversed(made):
            folder.rmdir()
        raise
