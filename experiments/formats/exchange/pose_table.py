"""Tables of animal pose trackers: CSV files of DeepLabCut, and analysis CSV files of SLEAP.

The trackers and this program have the same pixel coordinates: the centre of the first pixel is (0, 0).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from experiments.arrays import Floats
from experiments.errors import InputError, shown
from experiments.formats.tables import open_table, read_rows

KINDS = "a table of DeepLabCut (rows scorer, bodyparts, coords) or of SLEAP (columns track, frame_idx)"
DLC_HEADS = ("scorer", "bodyparts", "coords")
INDIVIDUALS = "individuals"
HDF5 = b"\x89HDF\r\n\x1a\n"
"""First bytes of an HDF5 file."""
COORDS = ("x", "y", "likelihood")
MOST_FRAMES = 10**7
"""Largest number of frames in a film; choice: four days at 30 frames/s."""
SLEAP_HEADS = ("track", "frame_idx", "instance.score")


@dataclass(frozen=True, slots=True, eq=False)
class PoseTable:
    """Positions of body parts from a pose tracker.

    frames: indices of the film's frames, increasing, (n_rows,)
    parts: names of body parts; places_px: positions [px], (n_rows, n_parts, 2), NaN for missing parts
    likelihood: the tracker's confidence in each position [1], (n_rows, n_parts), NaN if a person set it
    """

    path: Path
    frames: NDArray[np.int64]
    parts: tuple[str, ...]
    places_px: Floats
    likelihood: Floats


def read_poses(path: Path, individual: str | None = None) -> PoseTable:
    """The table of a pose tracker; raises InputError.

    individual: name of the animal in a table of several animals, or of the track in a table of SLEAP
    """
    _check_text(path)
    rows = list(read_rows(path, KINDS))
    if rows[0][0] == DLC_HEADS[0]:
        return _deeplabcut(path, rows, individual)
    if {"track", "frame_idx"} <= set(rows[0]):
        return _sleap(path, rows, individual)
    raise InputError.at(f"{path}: row 1", KINDS, shown(",".join(rows[0])))


def _check_text(path: Path) -> None:
    """Raise InputError for an HDF5 file, which pose trackers also write."""
    try:
        with path.open("rb") as file:
            first = file.read(len(HDF5))
    except OSError:
        return  # the reader of the table reports this fault
    if first == HDF5:
        raise InputError.at(path, f"{KINDS}, from an export to CSV", "an HDF5 file")


def _deeplabcut(path: Path, rows: list[list[str]], individual: str | None) -> PoseTable:
    several = len(rows) > 1 and rows[1][0] == INDIVIDUALS
    animals = rows[1][1:] if several else []
    heads = rows[: len(DLC_HEADS) + several]
    wanted = [DLC_HEADS[0], INDIVIDUALS, *DLC_HEADS[1:]] if several else DLC_HEADS
    for k, head in enumerate(wanted):
        if k >= len(heads) or heads[k][0] != head:
            found = shown(heads[k][0]) if k < len(heads) else "none"
            raise InputError.at(f"{path}: row {k + 1}", f"the row {head} of DeepLabCut", found)
    if len(heads[-1]) > 1 and not heads[-1][1].strip():
        raise InputError.at(f"{path}: row {len(heads)}", "x, y, likelihood of analyze_videos", "a table of labels")
    chosen = _chosen(animals, individual)
    columns = [k for k in range(1, len(rows[0])) if not several or animals[k - 1] == chosen]
    parts, coords = ([row[k] for k in columns] for row in heads[-2:])
    names, last = parts[::3], len(heads)
    for k, (part, coord) in enumerate(zip(parts, coords, strict=True)):
        expected = (names[k // 3], COORDS[k % 3])
        if (part, coord) != expected:
            place = f"column {columns[k] + 1}"
            raise InputError.at(f"{path}: row {last}", f"{' '.join(expected)} in {place}", shown(f"{part} {coord}"))
    if len(columns) % 3:
        raise InputError.at(f"{path}: row {last}", f"{', '.join(COORDS)} of each body part", f"{len(columns)} columns")
    header = ["coords", *(f"{name}.{coord}" for name in names for coord in ("x", "y", "score"))]
    kept = [[row[k] for k in (0, *columns)] for row in rows[last:]]
    return _poses(path, header, kept, names, frame="coords", first_row=last + 1)


def _chosen(animals: Sequence[str], individual: str | None) -> str | None:
    """The name of the requested animal or of the only animal; raises InputError if there are several."""
    names = list(dict.fromkeys(animals))
    if individual is None and len(names) <= 1:
        return names[0] if names else None
    if individual not in names:
        expected = f"one of {', '.join(map(shown, names))}" if names else "no name for a table of one animal"
        raise InputError.at("--individual", expected, "none" if individual is None else shown(individual))
    return individual


def _sleap(path: Path, rows: list[list[str]], individual: str | None) -> PoseTable:
    header = rows[0]
    names = [column.removesuffix(".x") for column in header if column.endswith(".x")]
    known = {*SLEAP_HEADS, *(f"{name}.{key}" for name in names for key in ("x", "y", "score"))}
    for column in header:
        if column not in known:
            raise InputError.at(f"{path}: row 1", "columns NODE.x, NODE.y, NODE.score of SLEAP", shown(column))
    for column in sorted(known - set(header) - {"instance.score"}):
        raise InputError.at(f"{path}: row 1", f"a column {column}", "none")
    track, frame = header.index("track"), header.index("frame_idx")
    kept = rows[1:]
    tracks = [row[track] for row in kept if row[track]]
    if individual is not None or (len(set(tracks)) > 1 and len({row[frame] for row in kept}) < len(kept)):
        chosen = _chosen(tracks, individual)
        kept = [row for row in kept if row[track] == chosen]
    return _poses(path, header, kept, names, frame="frame_idx", first_row=2)


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
    likelihood[np.isinf(likelihood)] = np.nan
    return PoseTable(path, frames[first], tuple(names), places[first], likelihood[first])
