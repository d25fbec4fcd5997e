"""Reads and checks a line of JSON with one frame of another tracker's marks."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Annotated, Any, Never

import numpy as np
from pydantic import Field

from experiments.errors import InputError, shown
from experiments.formats.marks.rows import FARTHEST_MM, FINEST_MM, Coordinate, MarkRow, are_definite, cov_names, cov_of
from experiments.formats.scene.scene import Scene
from experiments.formats.toml_file import Strict, check_axes, validated

LONGEST_LINE = 65_536
"""Largest number of bytes in a line, as many as a datagram may have."""

Entry = Annotated[float, Field(ge=-(FARTHEST_MM**2), le=FARTHEST_MM**2)]


class SentMark(Strict):
    """A mark in a line. The mark states either sd_mm or cov_mm2; in space the mark also states z_mm."""

    node: str
    x_mm: Coordinate
    y_mm: Coordinate
    z_mm: Coordinate | None = None
    sd_mm: Annotated[float, Field(ge=FINEST_MM, le=FARTHEST_MM)] | None = None
    cov_mm2: list[Entry] | None = None


class SentLine(Strict):
    """The JSON object in a line."""

    time_s: float
    marks: list[SentMark]


KEYS = (*SentLine.model_fields, *SentMark.model_fields)
"""All keys that a line with a frame of marks may have."""


@dataclass(frozen=True, slots=True, eq=False)
class SentFrame:
    """A frame with any number of marks, even none, and its time by the sender's clock [s]."""

    time_s: float
    marks: tuple[MarkRow, ...]


def read_line(line: bytes, scene: Scene) -> SentFrame:
    """Read a frame from a line such as `{"time_s": 1.5, "marks": [{"node": "M1", "x_mm": 0.0, ...}]}`.

    Raises InputError.
    """
    if len(line) > LONGEST_LINE:
        raise InputError(f"expected up to {LONGEST_LINE} bytes, found more")
    try:
        stated = json.loads(line.decode("utf-8"), object_pairs_hook=_once, parse_constant=_no_number)
    except (ValueError, RecursionError):
        raise InputError(f"expected a line of JSON, found {shown(line[:80].decode('utf-8', 'replace'))}") from None
    if not isinstance(stated, dict):
        raise InputError.at("the line", "a table", shown(stated))
    read = validated(stated, SentLine, "")
    names = [mark.node for mark in read.marks]
    for i, name in enumerate(names):
        if name in names[:i]:
            raise InputError.at(f"marks[{i}].node", "each node once", f"{shown(name)} again")
    return SentFrame(read.time_s, tuple(_row(f"marks[{i}]", mark, scene) for i, mark in enumerate(read.marks)))


def _row(place: str, mark: SentMark, scene: Scene) -> MarkRow:
    dim = scene.network.dim
    if mark.node not in scene.mark_names:
        raise InputError.at(f"{place}.node", "a node with a mark in the scene", shown(mark.node))
    if (mark.sd_mm is None) == (mark.cov_mm2 is None):
        raise InputError.at(place, "either sd_mm or cov_mm2", "neither" if mark.sd_mm is None else "both")
    place_mm = [x for x in (mark.x_mm, mark.y_mm, mark.z_mm) if x is not None]
    check_axes(place, place_mm, dim)
    position_m = 1e-3 * np.array(place_mm)
    if mark.cov_mm2 is None:
        return MarkRow(mark.node, position_m, 1e-3 * (mark.sd_mm or 0.0))
    names = cov_names(dim)
    if len(mark.cov_mm2) != len(names):
        raise InputError.at(f"{place}.cov_mm2", f"{', '.join(names)} in a list", shown(mark.cov_mm2))
    covs = cov_of([mark.cov_mm2], dim)
    if not are_definite(covs)[0]:
        raise InputError.at(f"{place}.cov_mm2", "a positive definite covariance", shown(mark.cov_mm2))
    return MarkRow.of_cov(mark.node, position_m, covs[0])


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    table = dict(pairs)
    for key in table:
        if key not in KEYS:  # before pydantic, which cannot report every text that JSON can have
            raise InputError(f"expected the keys {', '.join(KEYS)}, found {shown(key)}")
    if len(table) < len(pairs):
        raise InputError(f"expected each key once, found {shown([key for key, _ in pairs])}")
    return table


def _no_number(text: str) -> Never:
    raise InputError(f"expected finite numbers, found {text}")
