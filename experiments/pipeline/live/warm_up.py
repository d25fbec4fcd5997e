"""Rehearsal before the first frame: it compiles or loads all code that frames of a scene may need.

Kernels are compiled for the types of their arguments. Therefore the rehearsal runs the pipeline on synthetic input.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np

import vision
from estimators import CovarianceError, MarkMeasurement
from experiments.arrays import Floats
from experiments.formats.scene.scene import Scene
from experiments.pipeline.line import Line
from experiments.simulation.film import draw_in_space
from vision.detection.rim_search import detect_by_rim
from vision.tracking.appearance import AppearanceModel

INTERVAL_S = 1.0 / 30.0
"""Frame interval of the rehearsal [s], equal to that of a usual camera."""


def warm_up(scene: Scene) -> None:
    """Process synthetic frames of a scene, so that all code is compiled; the estimates are discarded."""
    rest = scene.network.positions[[scene.network.index(mark.node) for mark in scene.marks]]
    _rehearse_marks(scene, rest)
    if scene.cameras:
        _rehearse_pictures(scene, rest)
        _rehearse_search()
    if scene.space_cameras:
        _rehearse_exposures(scene)
        _rehearse_search()


def _rehearse_marks(scene: Scene, places: Floats) -> None:
    """Process frames with all marks at `places` [m], (n_marks, dim), with one far away, without marks; then a fix."""
    line, plain = Line(scene, baseline=False), 1e-6 * np.eye(scene.network.dim)
    given = zip(scene.marks, places, strict=True)
    marks = [MarkMeasurement(mark.node, place, plain) for mark, place in given if mark.measured]
    far = replace(marks[0], position=marks[0].position + np.ptp(scene.network.positions, axis=0))
    for k, seen in enumerate([marks, marks, [far, *marks[1:]], []]):
        _tried(partial(line.take, k * INTERVAL_S, seen))
    _tried(lambda: line.identity.fix(line.filter.predict_at(3.0 * INTERVAL_S).mean, plain))


def _rehearse_pictures(scene: Scene, places: Floats) -> None:
    """Process synthetic pictures, which show the whole marks, only their left halves, or no mark."""
    camera, rng = scene.cameras[0], np.random.default_rng(0)
    centers_px = camera.project(places)
    shapes_px = [mark.shape_px(camera, x) for x, mark in zip(places, scene.marks, strict=True)]
    axes_px = [tuple(np.maximum(np.linalg.norm(shape, axis=1), 2.0)) for shape in shapes_px]
    discs = [
        vision.Disc(center, axes, mark.hue_deg)
        for center, axes, mark in zip(centers_px, axes_px, scene.marks, strict=True)
    ]
    whole = vision.draw_frame(camera.size_px, discs, vision.Lighting(), rng)
    none = vision.draw_frame(camera.size_px, [], vision.Lighting(), rng)
    halves = whole.copy()
    for center, (wide, high) in zip(centers_px, axes_px, strict=True):
        left, right = (int(np.clip(center[0] + far, 0, camera.size_px[0])) for far in (0.0, 1.5 * wide))
        top, bottom = (int(np.clip(center[1] + far, 0, camera.size_px[1])) for far in (-1.5 * high, 1.5 * high))
        halves[top:bottom, left:right] = none[top:bottom, left:right]
    line = Line(scene, baseline=False, explain=True)
    for k, picture in enumerate([whole, whole, whole, halves, whole, none, whole]):
        _tried(partial(line.see, k * INTERVAL_S, picture))


def _rehearse_exposures(scene: Scene) -> None:
    """Process synthetic pictures of all cameras in space, of one camera only, and of all cameras with hidden marks."""
    rng, light = np.random.default_rng(0), vision.Lighting()
    x, hidden = scene.network.positions, [mark.node for mark in scene.marks]
    whole = {c.name: draw_in_space(scene, c, x, light, rng) for c in scene.space_cameras}
    none = {c.name: draw_in_space(scene, c, x, light, rng, covered=hidden) for c in scene.space_cameras}
    one = dict([next(iter(whole.items()))])
    line = Line(scene, baseline=False, explain=True)
    for k, images in enumerate([whole, whole, one, none, whole]):
        _tried(partial(line.see_all, vision.Exposure(k * INTERVAL_S, images)))


def _rehearse_search() -> None:
    """Search for a mark by its outline and its learnt appearance, as a run does if a search by colour fails."""
    disc = vision.Disc(np.array([60.0, 60.0]), (8.0, 8.0), 0.0)
    image = vision.draw_frame((120, 120), [disc], vision.Lighting(), np.random.default_rng(0))
    outline = vision.Outline(8.0 * np.eye(2), 0.05)
    one = vision.Expected("", disc.center_px, np.eye(2), disc.hue_deg, outline)
    appearance = AppearanceModel(disc.hue_deg)
    appearance.remember(image, one.center_px, outline)
    for another in (False, True):
        appearance.place(image, one, another=another)
    detect_by_rim(image, one)


def _tried(frame: Callable[[], object]) -> None:
    """Process a frame. Ignore a CovarianceError: the filter may refuse marks in a run, too."""
    with suppress(CovarianceError):
        frame()
