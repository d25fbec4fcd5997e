"""Tissues of a mesh: one tissue, a tissue for each label in a file, or mixtures of fat and glandular tissue."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dynamics.mesh import Tissue
from dynamics.mesh.tissues import DAMPING_S, POISSON, TISSUES
from dynamics.phantoms.breast import YOUNG_PA
from experiments.arrays import Floats
from experiments.errors import InputError, shown
from experiments.formats.mesh.body import Body

CLASSES = 4
"""Number of tissues that approximate all mixtures of fat and glandular tissue in a mesh; choice: identification
estimates the stiffness of each tissue, but marks on the surface determine only a few stiffnesses."""

GROUPS = "gmsh:physical"
"""Name of the field that has Gmsh's labels."""


Tissues = tuple[tuple[Tissue, ...], NDArray[np.int64]]
"""Tissues, and the index of each element's tissue, (m,) int."""


def check_tissues(field: str | None, regions: Sequence[str], young_pa: float | None) -> None:
    """Raise InputError for tissue options that are invalid for every body."""
    if young_pa is not None and (regions or field is not None):
        raise InputError.at("--young-kpa", "no --region and no --field with it", "one of them")
    labels = [text.partition("=")[0] for text in regions]
    for i, text in enumerate(regions):
        if text.partition("=")[2] not in TISSUES:
            raise InputError.at("--region", f"LABEL=TISSUE with one of {', '.join(TISSUES)}", shown(text))
        if labels[i] in labels[:i]:
            raise InputError.at("--region", "each label once", shown(text))


def assigned(body: Body, path: Path, field: str | None, regions: Sequence[str], young_pa: float | None) -> Tissues:
    """Assign the tissues of a body; the options have passed `check_tissues`. Raises InputError.

    regions: LABEL=TISSUE for each label of the field; if empty, the field is the share of glandular tissue
    young_pa: Young's modulus of a body of one tissue [Pa]
    """
    if regions or field is not None:
        return _labelled(body, path, field, regions) if regions else _mixed(body, path, field or "")
    density = 0.5 * (TISSUES["fat"].density_kg_m3 + TISSUES["gland"].density_kg_m3)
    one = Tissue("tissue", YOUNG_PA if young_pa is None else young_pa, POISSON, density, DAMPING_S)
    return (one,), np.zeros(len(body.mesh.elements), dtype=np.int64)


def _labelled(body: Body, path: Path, field: str | None, regions: Sequence[str]) -> Tissues:
    whole = {name: np.isfinite(values) & (values == np.round(values)) for name, values in body.cell_fields.items()}
    names = [name for name, each in whole.items() if each.all()]
    chosen = field or (GROUPS if GROUPS in names else names[0] if len(names) == 1 else None)
    if chosen not in names:
        faults = [
            f"{name} with {body.cell_fields[name][each.argmin()]:g} in element {each.argmin()}"
            for name, each in whole.items()
            if not each.all()
        ]
        has = ", ".join([*names, *faults]) or "none"
        raise InputError.at(
            "--field",
            f"a field of whole numbers of the elements of {path.name}",
            f"{shown(field) if field else 'none'}; it has {has}",
        )
    labels = body.cell_fields[chosen].astype(np.int64)
    has = np.unique(labels).tolist()
    tissues: dict[str, Tissue] = {}
    found = np.full(len(labels), -1)
    for text in regions:
        label, _, name = text.partition("=")
        if label not in map(str, has):
            raise InputError.at("--region", f"a label of {chosen}, {', '.join(map(str, has))}", shown(text))
        tissues.setdefault(name, TISSUES[name])
        found[labels == int(label)] = list(tissues).index(name)
    if (found < 0).any():
        raise InputError.at("--region", f"a tissue for label {labels[found.argmin()]} of {chosen}", "none")
    return tuple(tissues.values()), found


def _mixed(body: Body, path: Path, field: str) -> Tissues:
    """Mixtures of fat and glandular tissue with interpolated constants; field: share of glandular tissue."""
    share = _share(body, path, field)
    number = np.minimum((share * CLASSES).astype(np.int64), CLASSES - 1)
    kept, regions = np.unique(number, return_inverse=True)
    fat, gland = TISSUES["fat"], TISSUES["gland"]
    tissues = []
    for k in kept.tolist():
        part = (k + 0.5) / CLASSES
        tissues.append(
            Tissue(
                f"gland {100 * k // CLASSES}-{100 * (k + 1) // CLASSES}",
                (1.0 - part) * fat.young_pa + part * gland.young_pa,
                POISSON,
                (1.0 - part) * fat.density_kg_m3 + part * gland.density_kg_m3,
                DAMPING_S,
            )
        )
    return tuple(tissues), regions.ravel()


def _share(body: Body, path: Path, field: str) -> Floats:
    """The share of glandular tissue in each element, (m,)."""
    if field in body.cell_fields:
        share = body.cell_fields[field]
    elif field in body.fields:
        share = body.fields[field][body.mesh.elements].mean(axis=1)
    else:
        has = ", ".join([*body.fields, *body.cell_fields])
        expected = f"a field of {path.name}, {has}" if has else f"no --field, because {path.name} has no fields"
        raise InputError.at("--field", expected, shown(field))
    if not (np.isfinite(share).all() and share.min() >= -1e-6 and share.max() <= 1.0 + 1e-6):
        raise InputError.at("--field", f"{field} from 0 (fat) to 1 (gland)", f"{share.min():g} to {share.max():g}")
    return np.clip(share, 0.0, 1.0)
