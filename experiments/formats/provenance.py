"""Provenance file beside the output of each command: program, arguments, time and inputs."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from experiments.errors import InputError
from experiments.formats.scene.scene import Scene, scene_digest
from experiments.formats.scene.steps import step_keys
from experiments.version import version

PROVENANCE, LOG_FILE = "provenance.json", "softaim.log"
FORMAT = 1


@dataclass(frozen=True, slots=True)
class Input:
    """An input file or folder: its path as given, and the SHA-256 of its content."""

    path: Path
    sha256: str


@dataclass(frozen=True, slots=True, eq=False)
class Provenance:
    """Origin of an output.

    arguments: of the command line; program: digest of its source; inputs: files and folders that were read
    scene: the scene used, None without one; left_out: steps that were not done on it
    """

    command: str
    arguments: tuple[str, ...]
    program: str
    began: datetime
    ended: datetime
    inputs: tuple[Input, ...] = ()
    scene: Scene | None = None
    left_out: tuple[str, ...] = ()


def now() -> datetime:
    """The present time, UTC."""
    return datetime.now(UTC)


def input_of(path: Path) -> Input:
    """A file, or a folder with all its files, and its digest; this program's records of runs are ignored."""
    return Input(path, content_digest(path))


def content_digest(path: Path) -> str:
    """SHA-256 of a file; for a folder, the SHA-256 of its files' digests and names, in the order of names.

    Raises InputError for an unreadable file.
    """
    if path.is_dir():
        files = sorted(file for file in path.rglob("*") if file.is_file() and file.name not in (PROVENANCE, LOG_FILE))
        lines = (f"{content_digest(file)}  {file.relative_to(path).as_posix()}\n" for file in files)
        return hashlib.sha256("".join(lines).encode("utf-8", "surrogateescape")).hexdigest()
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise InputError.refused(path, "a file that can be read", error) from error


def provenance_text(of: Provenance) -> str:
    """Text of a provenance file."""
    table: dict[str, Any] = {
        "version": FORMAT,
        "program": {"name": "softaim", "version": version(), "source_sha256": of.program},
        "command": of.command,
        "arguments": list(of.arguments),
        "began": _utc(of.began),
        "ended": _utc(of.ended),
        "inputs": [{"path": str(one.path), "sha256": one.sha256} for one in of.inputs],
    }
    if of.scene is not None:
        steps = [step_keys(step) for step in of.scene.steps]
        table["scene"] = {"sha256": scene_digest(of.scene), "steps": steps, "left_out": list(of.left_out)}
    return json.dumps(table, indent=2, ensure_ascii=False) + "\n"


def _utc(time: datetime) -> str:
    return time.astimezone(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def beside(path: Path) -> Path:
    """The path of a single file's provenance: my.provenance.json beside my.toml."""
    return path.with_name(f"{path.stem}.{PROVENANCE}")
