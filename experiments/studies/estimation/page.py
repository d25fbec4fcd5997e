"""Tables of docs/estimation-study.md, from the figures of `experiments.studies.estimation.study`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from experiments.formats.page import markdown_table

Rows = Mapping[str, Mapping[str, Any]]

USUAL = {
    "filter [mm]": "{filter_mm:.2f}",
    "ratio": "{ratio:.3f}",
    "coverage": "{coverage95:.1%}",
    "NEES": "{nees:.2f}",
}
BOUND = {
    "filter RMSE [mm]": "{rmse_mm:.3f}",
    "bound [mm]": "{bound_mm:.3f}",
    "ratio": "{ratio:.3f}",
}
HARD = {
    "diverged": "{runs_diverged}/{runs}",
    "over 40 mm": "{runs_ever_far}/{runs}",
    "coverage": "{coverage95:.1%}",
}
"""Columns of the tables: heading, and format of an entry from a row."""


def table(columns: Mapping[str, str], rows: Rows, *, last: str = "") -> str:
    """A table with these columns and the rows that have runs and a label that ends with `last`."""
    shown = {label: row for label, row in rows.items() if "runs" in row and label.endswith(last)}
    cells = [[label, *(cell.format(**row) for cell in columns.values())] for label, row in shown.items()]
    return markdown_table(["", *columns], cells)


TABLES: Mapping[str, Callable[[Rows], str]] = {
    "identified": partial(table, USUAL),
    "unidentified": partial(table, USUAL, last=", all"),
    "bound": partial(table, BOUND),
    "hard": partial(table, HARD),
}
"""Tables of the page, by the parts of the study that it shows."""
