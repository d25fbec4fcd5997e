"""The settings records of the project and the figures that each serves, for `experiments.studies.sensitivity`."""

from __future__ import annotations

from experiments.studies.sensitivity import Family

FAMILIES: dict[str, Family] = {}
