"""Bodies of the study and their scenes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

from dynamics import HIDDEN, OUTER, Phantom, breast_phantom, four_mass_phantom, planar_phantom
from estimators import FilterSettings
from experiments.formats.scene.reference import Reference
from experiments.formats.scene.scene import Scene
from experiments.projects.template import scene_with_marks


@dataclass(frozen=True, slots=True)
class Body:
    """A body, and the duration of its runs [s]."""

    phantom: Callable[[], Phantom]
    duration_s: float


def _four_masses() -> Phantom:
    network = four_mass_phantom()
    return Phantom(network, HIDDEN, OUTER, ("springs",) * len(network.springs))


BODIES = {
    "four masses": Body(_four_masses, 12.0),
    "light phantom": Body(lambda: planar_phantom(5), 12.0),
    "breast": Body(lambda: breast_phantom(10), 8.0),
}


@lru_cache(maxsize=8)
def scene_of_body(name: str) -> Scene:
    """Scene of a body, with a colour for each mark and without stated uncertainties."""
    scene = scene_with_marks(BODIES[name].phantom(), {})
    target = replace(scene.target, position_sd_m=None)
    return replace(scene, target=target, reference=Reference(), settings=FilterSettings())
