"""The settings records of the project, and the figures that each serves: what `experiments.studies.sensitivity` varies."""

from __future__ import annotations

from experiments.studies.sensitivity import Family

FAMILIES: dict[str, Family] = {}
