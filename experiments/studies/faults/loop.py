"""Faults of a tracked needle and of the filter's state."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dynamics import NeedlePose
from estimators import Insertion, TissueFilter
from experiments.pipeline.live.session import Session
from experiments.studies.faults.judge import FOREVER, LASTS_S
from experiments.studies.faults.scripted import ScriptedFault, TrackedNeedle

OUTSIDE_M = 0.02
"""Distance from the tip of a waiting needle to its entry [m]."""
GOES_IN_S = 0.5
"""Time before the onset at which the needle enters after GO [s]."""
INSIDE_M = 0.005
"""Depth at which the inserted needle stops [m]."""
BEND_RAD = np.deg2rad(90.0)
"""Angle by which the needle bends [rad]: it would miss by 25 mm, twice the lesion's radius, at any breath."""
BESIDE_M = 0.025
"""Distance of a needle's line from the planned line, on which the advice would be GO [m]."""
DENT_M, DENT_N = 0.005, 2.0
"""Depth by which a needle dents the skin without puncture [m], and its force [N]."""
THROWN_M = 0.08
"""Displacement of all nodes in the filter's state on each axis [m]."""


def _at(plan: Insertion, depth_m: float, beside_m: float = 0.0, turned_rad: float = 0.0) -> NeedlePose:
    """Pose of a needle at rest at this depth, shifted sideways from the planned line and rotated about its tip."""
    along = plan.axis
    across = np.array([-along[1], along[0]])
    direction = np.cos(turned_rad) * along + np.sin(turned_rad) * across
    return NeedlePose(plan.entry + beside_m * across + depth_m * along, direction, 0.0, max(depth_m, 0.0))


def _bends(since_s: float, plan: Insertion) -> NeedlePose:
    """Pose of a needle that waits outside, enters before the onset, bends, and is retracted."""
    if since_s < -GOES_IN_S or since_s >= LASTS_S:
        return _at(plan, -OUTSIDE_M)
    if since_s < 0.0:
        return _at(plan, INSIDE_M * (1.0 + since_s / GOES_IN_S))
    return _at(plan, INSIDE_M, turned_rad=BEND_RAD)


def _touches(since_s: float, plan: Insertion) -> NeedlePose:
    """Pose of a needle that dents the skin at a distance from the planned line, and is then retracted to this line."""
    if since_s < 0.0:
        return _at(plan, -OUTSIDE_M, BESIDE_M)
    return _at(plan, DENT_M, BESIDE_M) if since_s < LASTS_S else _at(plan, -OUTSIDE_M)


def _displaced(by_m: float) -> Callable[[Session], None]:
    """A function that adds `by_m` [m] to all positions in the filter's means, and leaves its covariances unchanged."""

    def upsets(session: Session) -> None:
        tissue = session.line.filter
        assert isinstance(tissue, TissueFilter)
        tissue.filter.means[:, tissue.process.parts["position"]] += by_m

    return upsets


LOOP: tuple[ScriptedFault, ...] = (
    ScriptedFault("needle bent", "after GO the needle bends by 90 degrees inside", needle=TrackedNeedle(_bends)),
    ScriptedFault(
        "needle unseen",
        "the needle bends, and its tracker loses it or sends NaN",
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
