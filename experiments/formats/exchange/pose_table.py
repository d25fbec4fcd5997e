"""Tables of pose trackers, of one animal: DeepLabCut's CSV files and SLEAP's analysis CSV files.

Both count pixels as this program does: the centre of the first pixel is (0, 0).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from experiments.arrays import Floats
from experiments.errors import InputError, shown
from experiments.formats.exchange.open_table import open_table
from experiments.formats.tables import read_rows

KINDS = "a table of DeepLabCut (rows scorer, bodyparts, coords) or of SLEAP (columns track, frame_idx)"
DLC_HEADS = ("scorer", "bodyparts", "coords")
COORDS = ("x", "y", "likelihood")
MOST_FRAMES = 10**7
"""No film of marks is longer: four days at 30 frames a second; chosen."""
SLEAP_HEADS = ("track", "frame_idx", "instance.score")


@dataclass(frozen=True, slots=True, eq=False)
class PoseTable:
    """Body parts as a tracker found them.

    frames: numbers of the film's frames, increasing, (n_rows,)
    parts: names; places_px: where each was seen [px], (n_rows, n_parts, 2), NaN where it was not
    likelihood: of each, (n_rows, n_parts), NaN where there is none
    """

    path: Path
    frames: NDArray[np.int64]
    parts: tuple[str, ...]
    places_px: Floats
    likelihood: Floats


def read_poses(path: Path) -> PoseTable:
    """The table of a pose tracker; raises InputError."""
    rows = list(read_rows(path, KINDS))
    if rows[0][0] == DLC_HEADS[0]:
        return _deeplabcut(path, rows)
    if {"track", "frame_idx"} <= set(rows[0]):
        return _sleap(path, rows)
    raise InputError.at(f"{path}: row 1", KINDS, shown(",".join(rows[0])))


def _deeplabcut(path: Path, rows: list[list[str]]) -> PoseTable:
    heads = [row[0] for row in rows[:3]]
    if "individuals" in heads:
        raise InputError.at(f"{path}: row {heads.index('individuals') + 1}", "a table of one animal", "individuals")
    for k, head in enumerate(DLC_HEADS):
        if k >= len(heads) or heads[k] != head:
            found = shown(heads[k]) if k < len(heads) else "none"
            raise InputError.at(f"{path}: row {k + 1}", f"the row {head} of DeepLabCut", found)
    names = rows[1][1::3]
    for k, (part, coord) in enumerate(zip(rows[1][1:], rows[2][1:], strict=True)):
        expected = (names[k // 3], COORDS[k % 3])
        if (part, coord) != expected:
            raise InputError.at(f"{path}: row 3", f"{' '.join(expected)} in column {k + 2}", shown(f"{part} {coord}"))
    if len(rows[1]) % 3 != 1:
        raise InputError.at(f"{path}: row 3", f"{', '.join(COORDS)} of each body part", f"{len(rows[1]) - 1} columns")
    header = ["coords", *(f"{name}.{coord}" for name in names for coord in ("x", "y", "score"))]
    return _poses(path, header, rows[3:], names, frame="coords", first_row=4)


def _sleap(path: Path, rows: list[list[str]]) -> PoseTable:
    header = rows[0]
    names = [column.removesuffix(".x") for column in header if column.endswith(".x")]
    known = {*SLEAP_HEADS, *(f"{name}.{key}" for name in names for key in ("x", "y", "score"))}
    for column in header:
        if column not in known:
            raise InputError.at(f"{path}: row 1", "columns NODE.x, NODE.y, NODE.score of SLEAP", shown(column))
    for column in sorted(known - set(header) - {"instance.score"}):
        raise InputError.at(f"{path}: row 1", f"a column {column}", "none")
    return _poses(path, header, rows[1:], names, frame="frame_idx", first_row=2)


def _poses(
    path: Path, header: list[str], rows: list[list[str]], names: list[str], *, frame: str, first_row: int
) -> PoseTable:
    if twice := [name for name in header if header.count(name) > 1]:
        raise InputError.at(f"{path}: row {first_row - 1}", "columns of different names", f"{shown(twice[0])} twice")
    if not names or not rows:
        raise InputError.at(path, "a row for each frame, and body parts", "none")
    table = open_table(path, header, rows, ("track",), first_row=first_row)
    numbers = table.numbers[frame]
    whole = (numbers >= 0) & (numbers < MOST_FRAMES) & (numbers == np.round(numbers))
    table.check(frame, whole, "a frame's number, from 0 on")
    frames = numbers.astype(np.int64)
    _, first = np.unique(frames, return_index=True)
    table.check(frame, np.isin(np.arange(table.n_rows), first), "each frame once: a table of one animal")
    places = np.stack([np.stack([table.numbers[f"{name}.{axis}"] for name in names], axis=1) for axis in "xy"], axis=2)
    likelihood = np.stack([table.numbers[f"{name}.score"] for name in names], axis=1)
    return PoseTable(path, frames[first], tuple(names), places[first], likelihood[first])
