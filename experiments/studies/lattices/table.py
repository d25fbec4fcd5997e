"""Tables of lattices: their moduli, errors by method, and properties that springs cannot reproduce."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from dynamics.lattices import STRUCTURES
from experiments.formats.page import markdown_table
from experiments.studies.lattices.boxes import AXES, MATERIAL, PLANES

WORDS = {
    "van_gelder": "Van Gelder",
    "lloyd": "Lloyd",
    "fitted": "fitted to other boxes",
}
"""Methods in words, by name; factors fitted to the box itself have no error."""

YOUNG = [f"young_{name}_pa" for name in AXES + PLANES]
"""Columns of Young's moduli along axes and diagonals."""

PARTS = {
    "Poisson's ratio": [f"poisson_{name}" for name in PLANES],
    "shear modulus [kPa]": [f"shear_{name}_pa" for name in PLANES],
    "bulk modulus [kPa]": ["bulk_pa"],
}
"""Columns of the properties that springs cannot reproduce."""


def summary(rows: pd.DataFrame) -> pd.DataFrame:
    """Means over boxes, by structure and method, with the errors of Young's modulus.

    `largest_mean_error`: largest mean error of any direction; `largest_error`: largest error of any box and direction
    """
    by = ["structure", "method"]
    true = rows[rows.method == MATERIAL].set_index(["structure", "seed"])[YOUNG]
    errors = rows.set_index(["structure", "seed", "method"])[YOUNG].div(true) - 1.0
    means = rows.drop(columns="seed").groupby(by, sort=False).mean()
    means["largest_mean_error"] = errors.groupby(by, sort=False).mean().abs().max(axis=1)
    means["largest_error"] = errors.abs().groupby(by, sort=False).max().max(axis=1)
    return means


def tables(means: pd.DataFrame) -> dict[str, str]:
    """The tables of a page, by name, from a `summary`."""
    kinds = list(means.index.unique("structure"))
    heads = ("structure", "tissues", "alignment", "E [kPa]", "springs")
    entries, errors, limits = [], [], []
    for kind in kinds:
        true, found = means.loc[(kind, MATERIAL)], means.loc[(kind, "fitted")]
        ground, *others = STRUCTURES[kind][1]
        tissues = f"{ground}, {100 * true.share:.0f} % {' and '.join(others)}" if true.share else ground
        alignment = f"{true.alignment:.2f}" if true.share else ""
        young = [_listed(one, YOUNG[:3]) for one in (true, found)]
        entries.append((kind, tissues, alignment, *young))
        own = [means.loc[(kind, name)] for name in WORDS]
        errors.append((kind, *(f"{100 * one.largest_mean_error:.1f}, {100 * one.largest_error:.1f}" for one in own)))
        limits.append((kind, *(_listed(one, part) for part in PARTS.values() for one in (true, found))))
    return {
        "moduli": markdown_table(heads, entries, left=(0, 1)),
        "errors": markdown_table(("structure", *(f"{word} [%]" for word in WORDS.values())), errors),
        "limits": markdown_table(("structure", *(head for part in PARTS for head in (part, "springs"))), limits),
    }


def _listed(row: pd.Series, columns: Sequence[str]) -> str:
    """Text with the values of these columns; moduli are in kPa."""
    return ", ".join(
        f"{1e-3 * row[key]:#.3g}".rstrip(".") if key.endswith("_pa") else f"{row[key]:.2f}" for key in columns
    )
