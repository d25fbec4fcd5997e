"""The needle as a load on the tissue: contact, cutting, friction, and the tissue's motion under it.

What may enter: mechanics of the needle. What it hits is `estimators.guidance`.
"""

from dynamics.needle.insertion import Insertion, force_on_free, insert_needle, pushed_states
from dynamics.needle.loads import (
    GAUGES_MM,
    SHAFT,
    Needle,
    NeedleLoad,
    Pose,
    dent,
    needle_load,
    shared_force,
    shares,
    straight_insertion,
)
from dynamics.needle.steered import Drive, Knots, sliding_forces, steered

__all__ = [
    "GAUGES_MM",
    "SHAFT",
    "Drive",
    "Insertion",
    "Knots",
    "Needle",
    "NeedleLoad",
    "Pose",
    "dent",
    "force_on_free",
    "insert_needle",
    "needle_load",
    "pushed_states",
    "shared_force",
    "shares",
    "sliding_forces",
    "steered",
    "straight_insertion",
]
