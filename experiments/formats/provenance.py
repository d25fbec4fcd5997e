"""Provenance file beside the output of each command: program, arguments, time and inputs."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from experiments.errors import InputError
from experiments.formats.scene.scene import Scene, scene_digest
from experiments.formats.scene.steps import step_keys
from experiments.version import version

PROVENANCE, LOG_FILE = "provenance.json", "softaim.log"
FORMAT = 1


@dataclass(frozen=True, slots=True, eq=False)
class Provenance:
    """Origin of an output.

    arguments: of the command line; program: digest of its source; inputs: digests of what was read, by path
    scene: the scene used, None without one; left_out: steps that were not done on it
    """

    command: str
    arguments: tuple[str, ...]
    program: str
    began: datetime
    ended: datetime
    inputs: Mapping[Path, str] = field(default_factory=dict)
    scene: Scene | None = None
    left_out: tuple[str, ...] = ()


def content_digest(path: Path) -> str:
    """SHA-256 of a file; for a folder, the SHA-256 of its files' digests and names, in the order of names.

    This program's records of runs are ignored. Raises InputError for an unreadable file.
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
        "inputs": [{"path": str(path), "sha256": sha256} for path, sha256 in of.inputs.items()],
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
