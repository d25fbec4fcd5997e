"""A soft breast with marks of three hues before two cameras."""

from dataclasses import replace
from functools import lru_cache

import numpy as np

from experiments.formats.scene.marks import Mark
from experiments.formats.scene.scene import Scene
from experiments.formats.scene.target import Target
from experiments.projects.project import Kind, project
from tests.networks import build_network
from tests.vision.cameras.test_space_camera import camera_at
from vision import Lens, SpaceCamera

MATRIX = np.array([[1100.0, 0.0, 319.5], [0.0, 1100.0, 239.5], [0.0, 0.0, 1.0]])
LENS = Lens(MATRIX, np.array([-0.2, 0.05, 0.0, 0.0, 0.0]))
HUES_DEG = (0.0, 120.0, 240.0)


def two_cameras() -> tuple[SpaceCamera, SpaceCamera]:
    """One from the left and one from the right, 0.5 m away."""
    left, right = (camera_at(np.array([x, 0.05, 0.5]), np.array([0.0, 0.0, 0.02]), LENS) for x in (-0.15, 0.15))
    return replace(left, name="left"), replace(right, name="right")


@lru_cache
def breast(masses: int = 10, diameter_m: float = 0.004) -> Scene:
    """The assumed scene of `softaim new --kind breast`, with marks of three hues and two cameras."""
    made = project(Kind("breast"), masses=masses, young_kpa=None, nodes=None, springs=None, seed=0)
    marks = tuple(
        replace(mark, hue_deg=HUES_DEG[k % 3], diameter_m=diameter_m) for k, mark in enumerate(made.assumed.marks)
    )
    return replace(made.assumed, marks=marks, space_cameras=two_cameras())


def dome(n_marks: int = 60, radius_m: float = 0.07) -> Scene:
    """A half ball whose skin is full of marks of three hues in turn, each on a spring from an anchor in the middle."""
    k = np.arange(n_marks)
    z = 0.2 + 0.78 * (k + 0.5) / n_marks
    turn, r = np.pi * (3.0 - np.sqrt(5.0)) * k, np.sqrt(1.0 - z**2)
    skin = radius_m * np.column_stack([r * np.cos(turn), r * np.sin(turn), z])
    names = tuple(f"S{i}" for i in k)
    springs, constants = [(i, n_marks) for i in k], {"masses": 0.01, "stiffness": 100.0, "damping": 0.1}
    network = build_network(np.vstack([skin, np.zeros(3)]), springs, [n_marks], (*names, "A"), **constants)
    marks = tuple(Mark(name, HUES_DEG[i % 3], 0.005) for i, name in enumerate(names))
    return Scene(network, marks, Target("S0", 0.005), (), space_cameras=two_cameras())
