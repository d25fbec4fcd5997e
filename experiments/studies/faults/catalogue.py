"""All faults that `softaim faults` makes, in the order of its table."""

from __future__ import annotations

from collections.abc import Mapping

from experiments.studies.faults.camera import CAMERA
from experiments.studies.faults.judge import Fault
from experiments.studies.faults.loop import LOOP
from experiments.studies.faults.scripted import ScriptedFault
from experiments.studies.faults.system import SYSTEM
from experiments.studies.faults.tissue import TISSUE

_ALL: tuple[Fault, ...] = (ScriptedFault("none", "nothing fails", 0.0), *CAMERA, *TISSUE, *LOOP, *SYSTEM)

FAULTS: Mapping[str, Fault] = {fault.name: fault for fault in _ALL}
"""By name."""
