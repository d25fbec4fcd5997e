"""The bodies of the study: the scene that a user writes of each, and a needle before its target."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from dynamics import HIDDEN, OUTER, Phantom, breast_phantom, four_mass_phantom, planar_phantom
from estimators import AdviceSettings, FilterSettings, Insertion, Lesion, Needle
from experiments.formats.needle_file import NeedlePlan
from experiments.formats.scene.reference import Reference
from experiments.formats.scene.scene import Scene
from experiments.projects.template import scene_with_marks
from experiments.studies.faults.scripted import ABOVE_M, LESION_M

WAYS = {2: (0.0, 1.0), 3: (0.4, 0.3, 1.0)}
"""From the target to where the needle comes from, by dimension."""


@dataclass(frozen=True, slots=True)
class Body:
    """A body, and how long a run of it lasts [s]."""

    name: str
    phantom: Callable[[], Phantom]
    duration_s: float


def _four_masses() -> Phantom:
    network = four_mass_phantom()
    return Phantom(network, HIDDEN, OUTER, ("springs",) * len(network.springs))


BODIES = {
    one.name: one
    for one in (
        Body("four masses", _four_masses, 12.0),
        Body("light phantom", lambda: planar_phantom(5), 12.0),
        Body("breast", lambda: breast_phantom(10), 8.0),
    )
}


@lru_cache(maxsize=8)
def scene_of_body(name: str) -> Scene:
    """The body of this name with a colour for each mark, as a user writes it who states nothing of how well."""
    scene = scene_with_marks(BODIES[name].phantom(), {})
    target = replace(scene.target, position_sd_m=None)
    return replace(scene, target=target, reference=Reference(), settings=FilterSettings())


def plan_of(scene: Scene) -> NeedlePlan:
    """A needle that is almost there: whatever the breath, GO is shown while all is well."""
    target = scene.network.positions[scene.network.index(scene.target.node)]
    way = np.array(WAYS[scene.network.dim])
    way /= np.linalg.norm(way)
    return NeedlePlan(
        insertion=Insertion(entry=target + ABOVE_M * way, axis=-way, speed_m_s=0.5),
        lesion=Lesion.ball(LESION_M, scene.network.dim),
        needle=Needle(),
        settings=AdviceSettings(go=0.5, worth=1.0),
    )
