"""Steps done on a scene: read from `[[provenance]]`, and written to it.

The scene file omits the times of steps, so that the same steps give the same file; its provenance file has them.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass

from experiments.formats.scene.schema import ProvenanceTable, StepName
from experiments.formats.toml_file import key_lines, long_list


@dataclass(frozen=True, slots=True)
class Step:
    """A step done on a scene.

    program: version of the program; recording: SHA-256 of the recording, None without one
    network, scene: SHA-256 of the network and of the whole scene after the step, by `scene_digest`
    kept: constants that the step did not change, because the recording does not determine them
    """

    name: StepName
    program: str
    recording: str | None
    network: str
    scene: str
    kept: tuple[str, ...] = ()


def digest(lines: Sequence[str]) -> str:
    """SHA-256 of lines of a scene file; their numbers are rounded to twelve digits, to ignore rounding errors."""
    text = re.sub(r"(?<![\w.])-?\d+\.\d+(?:e[-+]?\d+)?", lambda found: f"{float(found[0]):.12g}", "\n".join(lines))
    return hashlib.sha256(text.encode("utf-8")).hexdigest()


def step_of(table: ProvenanceTable) -> Step:
    """The step of a table."""
    return Step(
        table.step, table.program, table.recording_sha256, table.network_sha256, table.scene_sha256, tuple(table.kept)
    )


def step_keys(step: Step) -> dict[str, str]:
    """The keys of `[[provenance]]` that have a value."""
    keys = {
        "step": step.name,
        "program": step.program,
        "recording_sha256": step.recording,
        "network_sha256": step.network,
        "scene_sha256": step.scene,
    }
    return {key: value for key, value in keys.items() if value is not None}


def step_lines(steps: Sequence[Step]) -> list[str]:
    """The lines of `[[provenance]]`, one table for each step."""
    lines = []
    for step in steps:
        lines += ["", "[[provenance]]", *key_lines(step_keys(step))]
        if step.kept:
            lines += long_list("kept", step.kept, why="not determined by the recording: unchanged")
    return lines
