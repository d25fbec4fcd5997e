"""Line format: reads and checks a line of JSON with one frame of another tracker's marks."""

from __future__ import annotations

import json
from dataclasses import dataclass
from math import inf, isfinite
from typing import Any, Never

import numpy as np

from experiments.arrays import Floats
from experiments.errors import shown
from experiments.formats.marks.rows import AXES, MarkRow, are_definite, cov_names, cov_of
from experiments.formats.scene.scene import Scene

LONGEST_LINE = 65_536
"""Largest number of bytes in a line, equal to that of a datagram."""

FARTHEST_MM, FINEST_MM = 1e6, 1e-6
"""Largest coordinate and least standard deviation in a line [mm]: a kilometre and a nanometre."""


class LineError(ValueError):
    """Error for an invalid line; the message has the position in the line, what was expected and what was found."""


@dataclass(frozen=True, slots=True, eq=False)
class SentFrame:
    """A frame of marks, possibly none; time_s: its time by the sender's clock [s]."""

    time_s: float
    marks: tuple[MarkRow, ...]


def read_line(line: bytes, scene: Scene) -> SentFrame:
    """Read a frame from a line such as `{"time_s": 1.5, "marks": [{"node": "M1", "x_mm": 0.0, ...}]}`.

    Raises LineError.
    """
    if len(line) > LONGEST_LINE:
        raise LineError(f"expected up to {LONGEST_LINE} bytes, found more")
    try:
        stated = json.loads(line.decode("utf-8"), object_pairs_hook=_once, parse_constant=_no_number)
    except LineError:
        raise
    except (ValueError, RecursionError):
        raise LineError(f"expected a line of JSON, found {shown(line[:80].decode('utf-8', 'replace'))}") from None
    table = _table("the line", stated, ("time_s", "marks"))
    time_s = _number("time_s", table["time_s"])
    marks = table["marks"]
    if not isinstance(marks, list):
        raise LineError(f"marks: expected a list, found {shown(marks)}")
    rows = tuple(_mark(f"marks[{i}]", mark, scene) for i, mark in enumerate(marks))
    seen: set[str] = set()
    for i, row in enumerate(rows):
        if row.node in seen:
            raise LineError(f"marks[{i}].node: expected each node once, found {shown(row.node)} again")
        seen.add(row.node)
    return SentFrame(time_s, rows)


def _mark(place: str, stated: object, scene: Scene) -> MarkRow:
    axes = AXES[: scene.network.dim]
    spread = "cov_mm2" if isinstance(stated, dict) and "cov_mm2" in stated else "sd_mm"
    table = _table(place, stated, ("node", *axes, spread))
    node = table["node"]
    if not isinstance(node, str) or node not in scene.mark_names:
        raise LineError(f"{place}.node: expected a node with a mark in the scene, found {shown(node)}")
    position_mm = np.array([_number(f"{place}.{axis}", table[axis], -FARTHEST_MM) for axis in axes])
    if spread == "sd_mm":
        return MarkRow(node, 1e-3 * position_mm, 1e-3 * _number(f"{place}.sd_mm", table["sd_mm"], FINEST_MM))
    return MarkRow.of_cov(node, 1e-3 * position_mm, _cov(f"{place}.cov_mm2", table["cov_mm2"], scene.network.dim))


def _cov(place: str, stated: object, dim: int) -> Floats:
    names = cov_names(dim)
    if not isinstance(stated, list) or len(stated) != len(names):
        raise LineError(f"{place}: expected {', '.join(names)} in a list, found {shown(stated)}")
    entries = [_number(f"{place}[{k}]", entry) for k, entry in enumerate(stated)]
    if not max(map(abs, entries)) <= FARTHEST_MM**2:
        raise LineError(f"{place}: expected up to {FARTHEST_MM**2:g}, found {shown(stated)}")
    covs = cov_of([entries], dim)
    if not are_definite(covs)[0] or covs[0].diagonal().min() < (1e-3 * FINEST_MM) ** 2:
        raise LineError(f"{place}: expected a positive definite covariance, found {shown(stated)}")
    return covs[0]


def _table(place: str, stated: object, keys: tuple[str, ...]) -> dict[str, Any]:
    if not isinstance(stated, dict):
        raise LineError(f"{place}: expected a table, found {shown(stated)}")
    for key in keys:
        if key not in stated:
            raise LineError(f"{place}: expected the key {key}, found none")
    for key in stated:
        if key not in keys:
            raise LineError(f"{place}: expected {', '.join(keys)}, found the key {shown(key)}")
    return stated


def _number(place: str, stated: object, least: float | None = None) -> float:
    if isinstance(stated, bool) or not isinstance(stated, (int, float)):
        raise LineError(f"{place}: expected a number, found {shown(stated)}")
    try:
        number = float(stated)
    except OverflowError:
        number = inf
    if not isfinite(number):
        raise LineError(f"{place}: expected a finite number, found {shown(stated)}")
    if least is not None and not least <= number <= FARTHEST_MM:
        raise LineError(f"{place}: expected {least:g} to {FARTHEST_MM:g}, found {number:g}")
    return number


def _once(pairs: list[tuple[str, object]]) -> dict[str, object]:
    table = dict(pairs)
    if len(table) < len(pairs):
        raise LineError(f"expected each key once, found {shown([key for key, _ in pairs])}")
    return table


def _no_number(text: str) -> Never:
    raise LineError(f"expected finite numbers, found {text}")
