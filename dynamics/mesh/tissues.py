"""Constants of the tissues of a breast, from measurements.

Measured stiffness depends on the compression and rate of the test, and on whether the sample was inside a body.
Sources therefore differ by a factor of ten. `YOUNG_RANGE_PA` states the reported range.
"""

from __future__ import annotations

from dynamics.mesh.tissue import Tissue

POISSON = 0.49
"""Poisson's ratio [1]; choice: tissue is mostly water, which keeps its volume. With 0.495, the bulk modulus doubles."""

DAMPING_S = 0.01
"""Ratio of damping to stiffness [s]; choice, as for the phantoms: no source reports this ratio below 1 Hz."""

YOUNG_RANGE_PA = {
    "fat": (2.3e3, 22e3),  # samani2007, mean minus standard deviation; krouskop1998
    "gland": (2.6e3, 66e3),  # as for fat; krouskop1998 reports stiffening with compression
    "fibrous": (96e3, 244e3),  # krouskop1998
    "skin": (35e3, 480e3),  # paillermattei2008 by indentation, sutradhar2013 by suction
    "fascia": (96e3, 244e3),  # as fibrous tissue
    "muscle": (80e3, 80e3),  # paillermattei2008
}
"""Smallest and largest Young's modulus in the sources [Pa]."""

TISSUES = {
    name: Tissue(name, young_pa, POISSON, density_kg_m3, DAMPING_S)
    for name, young_pa, density_kg_m3 in (
        ("fat", 3.25e3, 911.0),  # samani2007, hasgall2022
        ("gland", 3.24e3, 1041.0),  # samani2007, hasgall2022
        ("fibrous", 96e3, 1142.0),  # krouskop1998, little compressed; hasgall2022, as ligament
        ("skin", 35e3, 1109.0),  # paillermattei2008, hasgall2022
        ("fascia", 96e3, 1142.0),  # choice: as fibrous tissue
        ("muscle", 80e3, 1090.0),  # paillermattei2008, hasgall2022
    )
}
"""Tissues by name."""
