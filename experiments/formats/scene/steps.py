"""Lines of `[[provenance]]`, the list of processing steps in a scene file.

The list has no times, so that the same steps give the same file. The provenance file beside the scene has the times.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence

from experiments.formats.scene.schema import Step
from experiments.formats.toml_file import key_lines, long_list


def digest(lines: Sequence[str]) -> str:
    """SHA-256 of lines of a scene file; their numbers are rounded to twelve digits, to ignore rounding errors."""
    text = re.sub(r"(?<![\w.])-?\d+\.\d+(?:e[-+]?\d+)?", lambda found: f"{float(found[0]):.12g}", "\n".join(lines))
    return hashlib.sha256(text.encode("utf-8")).hexdigest()


def step_lines(steps: Sequence[Step]) -> list[str]:
    """The lines of `[[provenance]]`, one table for each step."""
    lines = []
    for step in steps:
        lines += ["", "[[provenance]]", *key_lines(step.model_dump(exclude={"kept"}))]
        if step.kept:
            lines += long_list("kept", step.kept, why="not determined by the recording: unchanged")
    return lines
