"""Annotation of a frame: results of a step of the pipeline, projected into a camera's picture."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dynamics import MassSpringNetwork
from estimators import Advice, Guidance, MarkMeasurement, Status, TargetEstimate
from experiments.arrays import Floats
from experiments.errors import InputError
from experiments.film.overlay import Fate, MarkDrawn, NeedleDrawn, Overlay
from experiments.film.projection import View, view_of
from experiments.film.strokes import Colour
from experiments.formats.films.several import film_name
from experiments.formats.needle_file import NeedlePlan
from experiments.formats.scene.marks import Mark
from experiments.formats.scene.scene import Scene
from experiments.pipeline.line import FILTER, AnyFrame, Line, Step
from experiments.pipeline.scores.marks import lost_words
from vision import Frame, PlaneCamera, SpaceCamera, fronto_parallel_camera
from vision.arrays import Image

# Colours of Okabe and Ito for the colour-blind, BGR
GREEN: Colour = (115, 158, 0)
SKY: Colour = (233, 180, 86)
ORANGE: Colour = (0, 159, 230)
VERMILLION: Colour = (0, 94, 213)
PURPLE: Colour = (167, 121, 204)
GREY: Colour = (190, 190, 190)

STATUSES = {
    Status.INITIALISING: SKY,
    Status.TRACKING: GREEN,
    Status.COASTING: ORANGE,
    Status.LOST: VERMILLION,
    Status.DIVERGED: PURPLE,
}
ADVICE = {
    Advice.GO: GREEN,
    Advice.WAIT: ORANGE,
    Advice.REALIGN: PURPLE,
    Advice.ABORT: VERMILLION,
    Advice.NO_GUIDANCE: GREY,
}
TRUSTED = (Status.TRACKING, Status.COASTING)

GROUND = 60
"""Grey level of the plain background."""
GROUND_PX = (640, 480)
"""Size of the plain background of films that show marks without camera pictures [px]."""
GROUND_SHARE = 0.6
"""Share of the background's size that the network at rest covers [1]: motion and text need room."""
MOST_NAMED = 40
"""Largest number of nodes that are all labelled; in a larger network only the target and marks have labels."""


def ground_camera(scene: Scene) -> PlaneCamera:
    """A camera perpendicular to the plane, with the network at its centre. Raises InputError for a scene in space."""
    if scene.network.dim != 2:
        raise InputError.at("--film", "a flat scene, or cameras with lens and pose in it", "one in space without them")
    low, high = scene.network.positions.min(axis=0), scene.network.positions.max(axis=0)
    size_m = np.maximum(high - low, 1e-3)
    mm_per_px = float((1e3 * size_m / (GROUND_SHARE * np.array(GROUND_PX))).max())
    middle = 0.5 * (low + high)
    return fronto_parallel_camera("ground", GROUND_PX, (mm_per_px, mm_per_px), (float(middle[0]), float(middle[1])))


def film_cameras(scene: Scene) -> dict[str, PlaneCamera | SpaceCamera]:
    """Cameras of a scene in space, by name. A flat scene has the ground camera with the name "". Raises InputError."""
    return {film_name(one.name, i): one for i, one in enumerate(scene.space_cameras)} or {"": ground_camera(scene)}


def pictures_of(
    frame: AnyFrame,
    cameras: Mapping[str, PlaneCamera | SpaceCamera],
    line: Line,
    step: Step,
    guidance: Guidance | None = None,
    plan: NeedlePlan | None = None,
) -> dict[str, tuple[Image, Overlay]]:
    """The picture and the overlay of each camera. Frames of a tracker have no pictures, and get a plain background."""
    if isinstance(frame, Frame):
        return {"": (frame.image, overlay_of(line, step, line.camera, guidance, plan))}
    images = {name: ground(camera) for name, camera in cameras.items()} if frame is None else frame.images
    posed = {} if frame is None or line.space is None else {k: one.camera for k, one in line.space.cameras.items()}
    standing = {**cameras, **posed}
    return {name: (image, overlay_of(line, step, standing[name], guidance, plan)) for name, image in images.items()}


def ground(camera: PlaneCamera | SpaceCamera) -> Image:
    """The plain background of films that show marks without camera pictures, (height, width, 3) BGR."""
    return np.full((camera.size_px[1], camera.size_px[0], 3), GROUND, dtype=np.uint8)


def overlay_of(
    line: Line,
    step: Step,
    camera: PlaneCamera | SpaceCamera,
    guidance: Guidance | None = None,
    plan: NeedlePlan | None = None,
) -> Overlay:
    """The annotation of a step in the picture of a camera; line: the pipeline after that step.

    guidance: the advice at the time of the step; plan: the planned needle path
    """
    scene, estimate = line.scene, step.estimates[FILTER]
    view = view_of(scene, camera)
    network = scene.network
    target_px, target_cov_px2 = view.seen(estimate.mean, estimate.cov)
    return Overlay(
        status=str(estimate.status),
        status_colour=STATUSES[estimate.status],
        facts=facts(estimate, len(scene.measured_nodes), camera.name if len(scene.space_cameras) > 1 else ""),
        nodes_px=view.places(line.filter.positions),
        names=labels(network, scene.target.node),
        fixed=network.fixed,
        springs=network.springs,
        marks=_marks(scene, step, view),
        target_px=target_px,
        target_cov_px2=target_cov_px2,
        target_shape_px=view.ball_shape(estimate.mean, scene.target.radius_m),
        trusted=estimate.status in TRUSTED,
        needle=None if guidance is None or plan is None else _needle(view, guidance, plan),
        advice="" if guidance is None else advice_words(guidance),
        advice_colour=GREY if guidance is None else ADVICE[guidance.advice],
        notes=_notes(target_cov_px2, camera.size_px),
    )


def labels(network: MassSpringNetwork, target: str) -> tuple[str, ...]:
    """Names of the nodes, "" for those not labelled: names of a mesh's wall points would cover those of the marks."""
    named = ~network.fixed if network.continuum is not None else np.full(network.n_nodes, True)
    named &= network.n_nodes <= MOST_NAMED
    return tuple(name if shown or name == target else "" for name, shown in zip(network.names, named, strict=True))


def facts(estimate: TargetEstimate, n_measured: int, camera: str = "") -> str:
    """Text beside the status: time, number of marks used, and the target's standard deviation.

    camera: name of one of several cameras, all of whose marks are counted; otherwise ""
    """
    sigma = ""
    if estimate.cov is not None and np.isfinite(estimate.cov).all():
        sigma = f", sigma {1e3 * float(np.sqrt(np.linalg.eigvalsh(estimate.cov)[-1].clip(0.0))):.1f} mm"
    of, by = (f"{camera}: ", " by all cameras") if camera else ("", "")
    return f"{of}{estimate.time_s:.2f} s, {estimate.marks_used} of {n_measured} marks{by}{sigma}"


def advice_words(guidance: Guidance) -> str:
    """The advice in one line: its name, the probability of a hit, the reason."""
    what = str(guidance.advice).replace("_", " ")
    hit = "" if guidance.probability is None else f" {int(100.0 * guidance.probability)} %"
    return f"{what}{hit}: {guidance.reason}"


def _notes(target_cov_px2: Floats | None, size_px: tuple[int, int]) -> tuple[str, ...]:
    if target_cov_px2 is None or not np.isfinite(target_cov_px2).all():
        return ()
    wide = float(np.sqrt(np.linalg.eigvalsh(target_cov_px2)[0].clip(0.0))) > max(size_px)
    return ("the target's uncertainty is larger than the picture",) if wide else ()


def _marks(scene: Scene, step: Step, view: View) -> tuple[MarkDrawn, ...]:
    """The marks that may be visible to the camera."""
    seen = {mark.node: mark for mark in step.marks}
    expected = {} if step.sight is None else step.sight.expected
    places = {node: place for node, (place, _) in expected.items()} | {node: one.position for node, one in seen.items()}
    return tuple(
        _mark(scene, mark, seen.get(mark.node), step, view)
        for mark in scene.marks
        if view.faces(mark.node, places.get(mark.node))
    )


def _mark(scene: Scene, mark: Mark, seen: MarkMeasurement | None, step: Step, view: View) -> MarkDrawn:
    expected = None if step.sight is None else step.sight.expected.get(mark.node)
    lost = None if step.sight is None else step.sight.lost.get(mark.node)
    expected_px, expected_cov_px2 = (None, None) if expected is None else view.seen(*expected)
    center_px, cov_px2 = (None, None) if seen is None else view.seen(seen.position, seen.total_cov)
    if seen is None:
        fate, why, place = Fate.LOST, lost_words(scene, mark.node, lost), None if expected is None else expected[0]
    elif mark.node in step.refused:
        fate, why, place = Fate.REFUSED, "" if expected is None else refused_words(seen, *expected), seen.position
    else:
        fate, why, place = Fate.FOUND, "", seen.position
    return MarkDrawn(
        mark.node,
        mark.hue_deg,
        fate,
        np.zeros((2, 2)) if place is None else view.mark_shape(mark, place),
        center_px,
        cov_px2,
        expected_px,
        expected_cov_px2,
        candidate_px=lost.candidate_px if seen is None and lost is not None else None,
        why=why,
        measured=mark.measured,
    )


def refused_words(seen: MarkMeasurement, mean: Floats, cov: Floats) -> str:
    """Text that states the distance of a rejected mark from its predicted position."""
    away = seen.position - mean
    sigmas = float(np.sqrt(away @ np.linalg.solve(cov + seen.total_cov, away)))
    return f"{1e3 * float(np.linalg.norm(away)):.1f} mm, {sigmas:.1f} sigma, from where it was expected"


def _needle(view: View, guidance: Guidance, plan: NeedlePlan) -> NeedleDrawn:
    insertion = plan.insertion
    tip = insertion.entry + insertion.depth_m * insertion.axis
    left_m = guidance.depth_m if guidance.depth_m is not None else plan.needle.reach_m
    ahead = tip + max(left_m, 0.0) * insertion.axis
    behind = insertion.entry - max(left_m, plan.needle.reach_m) * insertion.axis
    aim = (None, None) if guidance.aim is None else view.seen(guidance.aim, guidance.cov)
    return NeedleDrawn(view.line(np.array([behind, tip])), view.line(np.array([tip, ahead])), *aim)
