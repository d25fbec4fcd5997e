"""Provenance file beside the output of each command: program, arguments, time and inputs."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from experiments.errors import InputError, accepted, placed, read_text
from experiments.formats.scene.scene import Scene, scene_digest
from experiments.version import version

PROVENANCE, LOG_FILE = "provenance.json", "softaim.log"
FORMAT = 1


def content_digest(path: Path) -> str:
    """SHA-256 of a file; for a folder, SHA-256 of a list with the name and digest of each file. Raises InputError.

    Provenance files and logs of this program are ignored.
    """
    if path.is_dir():
        files = sorted(file for file in path.rglob("*") if file.is_file() and file.name not in (PROVENANCE, LOG_FILE))
        lines = (f"{content_digest(file)}  {file.relative_to(path).as_posix()}\n" for file in files)
        return hashlib.sha256("".join(lines).encode("utf-8", "surrogateescape")).hexdigest()
    with accepted(path, "a file that can be read"), path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def check_made_from(folder: Path, source: Path) -> None:
    """Raise InputError if a result's provenance file states that it was made from other files than those in `source`.

    Accepted are a folder without provenance, that of a live run, whose frames may come from any source, and that of a
    recording of the same name, because the user may have edited its scene since.
    """
    path = folder / PROVENANCE
    if not path.is_file():
        return
    with placed(path, ValueError, LookupError, TypeError):
        made = json.loads(read_text(path))
        read = {one["sha256"]: one["path"] for one in made["inputs"]}
        from_any = made["command"] == "live"
    is_named = any(Path(made_from).name == source.resolve().name for made_from in read.values())
    if not from_any and not is_named and content_digest(source) not in read:
        raise InputError.at(folder, f"results of the files in {source}", f"results of {', '.join(read.values())}")


def provenance_text(
    command: str,
    arguments: Sequence[str],
    program: str,
    times: tuple[datetime, datetime],
    inputs: Mapping[Path, str],
    scene: Scene | None = None,
    left_out: Sequence[str] = (),
) -> str:
    """Text of a provenance file.

    program: digest of the program's source
    times: begin and end of the run
    inputs: digests of files and folders that were read, by path
    left_out: recommended processing steps that the scene lacks
    """
    table: dict[str, Any] = {
        "version": FORMAT,
        "program": {"name": "softaim", "version": version(), "source_sha256": program},
        "command": command,
        "arguments": list(arguments),
        "began": _utc(times[0]),
        "ended": _utc(times[1]),
        "inputs": [{"path": str(path), "sha256": sha256} for path, sha256 in inputs.items()],
    }
    if scene is not None:
        steps = [step.model_dump(exclude={"kept"}, exclude_none=True) for step in scene.steps]
        table["scene"] = {"sha256": scene_digest(scene), "steps": steps, "left_out": list(left_out)}
    return json.dumps(table, indent=2, ensure_ascii=False) + "\n"


def _utc(time: datetime) -> str:
    return time.astimezone(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def beside(path: Path) -> Path:
    """The path of the provenance file of a single output file: my.provenance.json for my.toml."""
    return path.with_name(f"{path.stem}.{PROVENANCE}")
