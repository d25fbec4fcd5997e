"""Tables of lattices: their moduli, errors by method, and what springs cannot follow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from dynamics.lattices import STRUCTURES
from experiments.arrays import Floats
from experiments.studies.grid import markdown_table
from experiments.studies.lattices.boxes import MATERIAL, METHODS, Box, Found

AXES = ("x", "y", "z", "yz", "xz", "xy")
"""Of Young's moduli; pairs are diagonals, and planes of shear moduli and Poisson's ratios."""

WORDS = {
    "van_gelder": "Van Gelder",
    "lloyd": "Lloyd",
    "fitted": "fitted to other boxes",
    "own": "fitted to the box",
}
"""Methods in words."""


def summary(boxes: Sequence[Box], factors: Mapping[str, Floats]) -> list[dict[str, Any]]:
    """A row for each structure: means over its boxes, by method, and its fitted factors."""
    rows = []
    for kind, own in factors.items():
        these = [box for box in boxes if box.kind == kind]
        alignments = [box.alignment for box in these if box.alignment is not None]
        rows.append(
            {
                "structure": kind,
                "factors": own.tolist(),
                "shares": np.mean([box.shares for box in these], axis=0).tolist(),
                "alignment": float(np.mean(alignments)) if alignments else None,
                "crossing": float(np.mean([box.crossing for box in these])),
                "methods": {name: _means(these, name) for name in (MATERIAL, *METHODS)},
            }
        )
    return rows


def _means(boxes: Sequence[Box], method: str) -> dict[str, Any]:
    found, material = ([box.found[name] for box in boxes] for name in (method, MATERIAL))
    errors = np.array([one.along / true.along - 1.0 for one, true in zip(found, material, strict=True)])
    free = np.array([one.free / true.free - 1.0 for one, true in zip(found, material, strict=True)])
    return {
        "young_pa": np.mean([one.along for one in found], axis=0).tolist(),
        "shear_pa": np.mean([one.moduli.shear for one in found], axis=0).tolist(),
        "poisson": np.mean([one.moduli.poisson for one in found], axis=0).tolist(),
        "bulk_pa": float(np.mean([one.moduli.bulk for one in found])),
        "anisotropy": float(np.mean([one.moduli.anisotropy for one in found])),
        "free_sided_pa": np.mean([one.free for one in found], axis=0).tolist(),
        "mean_error": errors.mean(axis=0).tolist(),
        "largest_mean_error": float(np.abs(errors.mean(axis=0)).max()),
        "largest_error": float(np.abs(errors).max()),
        "largest_free_sided_error": float(np.abs(free).max()),
    }


def flat(boxes: Sequence[Box]) -> pd.DataFrame:
    """One line for each box and method."""
    return pd.DataFrame([_line(box, name, found) for box in boxes for name, found in box.found.items()])


def _line(box: Box, method: str, found: Found) -> dict[str, Any]:
    moduli = found.moduli
    named = {"young": found.along, "shear": moduli.shear, "poisson": moduli.poisson, "free_sided": found.free}
    units = {"young": "_pa", "shear": "_pa", "poisson": "", "free_sided": "_pa"}
    values = {
        f"{key}_{axis}{units[key]}": float(value)
        for key, each in named.items()
        for axis, value in zip(
            AXES if len(each) == 6 else AXES[:3] if key == "free_sided" else AXES[3:], each, strict=True
        )
    }
    head = {"structure": box.kind, "seed": box.seed, "method": method}
    return head | values | {"bulk_pa": moduli.bulk, "anisotropy": moduli.anisotropy}


def tables(rows: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """The tables of a page, by name."""
    return {"moduli": _moduli(rows), "errors": _errors(rows), "limits": _limits(rows)}


def _moduli(rows: Sequence[Mapping[str, Any]]) -> str:
    heads = ("structure", "tissues [%]", "alignment", "crossing [%]", "E [kPa]", "springs", "anisotropy", "springs")
    entries = []
    for row in rows:
        named = zip(STRUCTURES[row["structure"]][1], row["shares"], strict=True)
        shares = ", ".join(f"{name} {100 * share:.0f}" for name, share in named if share > 0.0)
        alignment = "" if row["alignment"] is None else f"{row['alignment']:.2f}"
        both = [row["methods"][name] for name in (MATERIAL, "fitted")]
        young, anisotropy = [_kpa(one["young_pa"][:3]) for one in both], [f"{one['anisotropy']:.2f}" for one in both]
        entries.append((row["structure"], shares, alignment, f"{100 * row['crossing']:.1f}", *young, *anisotropy))
    return markdown_table(heads, entries, left=(0, 1))


def _kpa(values: Sequence[float]) -> str:
    return ", ".join(f"{1e-3 * one:#.3g}".rstrip(".") for one in values)


def _errors(rows: Sequence[Mapping[str, Any]]) -> str:
    entries = []
    for row in rows:
        found = [row["methods"][name] for name in METHODS]
        errors = [f"{100 * one['largest_mean_error']:.1f}, {100 * one['largest_error']:.1f}" for one in found]
        entries.append((row["structure"], *errors))
    return markdown_table(("structure", *(f"{word} [%]" for word in WORDS.values())), entries)


def _limits(rows: Sequence[Mapping[str, Any]]) -> str:
    parts = {
        "Poisson's ratio": lambda one: ", ".join(f"{nu:.2f}" for nu in one["poisson"]),
        "shear modulus [kPa]": lambda one: _kpa(one["shear_pa"]),
        "bulk modulus [kPa]": lambda one: _kpa([one["bulk_pa"]]),
        "E, free sides [kPa]": lambda one: _kpa(one["free_sided_pa"]),
    }
    both = [[row["methods"][name] for name in (MATERIAL, "fitted")] for row in rows]
    entries = [
        (row["structure"], *(part(one) for part in parts.values() for one in pair))
        for row, pair in zip(rows, both, strict=True)
    ]
    return markdown_table(("structure", *(head for part in parts for head in (part, "springs"))), entries)
