"""Faults of the loop's other input, a tracked needle, and of the filter itself."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dynamics import NeedlePose
from estimators import Insertion, TissueFilter
from experiments.pipeline.live.session import Session
from experiments.studies.faults.judge import FOREVER, LASTS_S
from experiments.studies.faults.scripted import ScriptedFault, TrackedNeedle

OUTSIDE_M = 0.02
"""From the tip of a needle that waits to its entry [m]."""
GOES_IN_S = 0.5
"""Before the onset, a needle that was given GO begins to [s]."""
INSIDE_M = 0.005
"""Depth of a needle that is held there [m]."""
BEND_RAD = np.deg2rad(90.0)
"""By so much it bends: it would pass the target by 25 mm, twice the lesion's radius, wherever a breath moves it."""
BESIDE_M = 0.025
"""From a needle's line to the one on which it would be given GO [m]."""
DENT_M, DENT_N = 0.005, 2.0
"""How far a needle presses into the skin that does not give way yet [m], and by what force [N]."""
THROWN_M = 0.08
"""By how much the filter takes all nodes to be displaced, along each axis [m]."""


def _at(plan: Insertion, depth_m: float, beside_m: float = 0.0, turned_rad: float = 0.0) -> NeedlePose:
    """A needle that stands still, its last part turned about its tip."""
    along = plan.axis
    across = np.array([-along[1], along[0]])
    direction = np.cos(turned_rad) * along + np.sin(turned_rad) * across
    return NeedlePose(plan.entry + beside_m * across + depth_m * along, direction, 0.0, max(depth_m, 0.0))


def _bends(since_s: float, plan: Insertion) -> NeedlePose:
    """Outside until it was given GO; inside it bends, and is drawn out."""
    if since_s < -GOES_IN_S or since_s >= LASTS_S:
        return _at(plan, -OUTSIDE_M)
    if since_s < 0.0:
        return _at(plan, INSIDE_M * (1.0 + since_s / GOES_IN_S))
    return _at(plan, INSIDE_M, turned_rad=BEND_RAD)


def _touches(since_s: float, plan: Insertion) -> NeedlePose:
    """Beside its line, where it is not given GO, it presses on the skin; then it is drawn out and aligned."""
    if since_s < 0.0:
        return _at(plan, -OUTSIDE_M, BESIDE_M)
    return _at(plan, DENT_M, BESIDE_M) if since_s < LASTS_S else _at(plan, -OUTSIDE_M)


def _displaced(by_m: float) -> Callable[[Session], None]:
    """Displaces all nodes in the mean of every mode of the filter [m], which stays as sure of them as it was."""

    def upsets(session: Session) -> None:
        tissue = session.line.filter
        assert isinstance(tissue, TissueFilter)
        tissue.filter.means[:, tissue.process.parts["position"]] += by_m

    return upsets


LOOP: tuple[ScriptedFault, ...] = (
    ScriptedFault("needle bent", "after GO the needle bends by 90 degrees inside", needle=TrackedNeedle(_bends)),
    ScriptedFault(
        "needle unseen",
        "the same, and the tracker loses it or sends NaN",
        needle=TrackedNeedle(_bends, seen=lambda since_s: not 0.0 <= since_s < LASTS_S),
    ),
    ScriptedFault(
        "touched early",
        "without GO a needle presses 5 mm into the skin",
        needle=TrackedNeedle(_touches, push_N=DENT_N),
    ),
    ScriptedFault(
        "filter diverges", "the filter's nodes are displaced by 110 mm", FOREVER, upsets=_displaced(THROWN_M)
    ),
    ScriptedFault("filter NaN", "the filter's state is NaN", FOREVER, upsets=_displaced(np.nan)),
)
