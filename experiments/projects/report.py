"""Output of `softaim check`: lines on the shape at rest, motion, time steps, marks and target, and on missing parts."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dynamics import spring_lengths
from estimators import GaussianMixture, Hit, Lesion, Needle, hit_probability
from experiments.formats.camera_yaml import POSE
from experiments.pipeline.events import SAGS, pose_line, rest_is_known, steps_left_out
from experiments.pipeline.integrity import USUAL, shares_words
from experiments.pipeline.scores.marks import LOOK_AT, NO_ROW, lost_words
from experiments.plain import amount, counted
from experiments.projects.check import SceneCheck
from vision import Reason

N_NAMED = 6
"""Largest number of marks or nodes that are named; the others are only counted."""

N_LOWEST = 3
"""Number of frequencies that are listed, lowest first."""

SURE = 0.9
"""If the hit probability of the best aim is below this [1], there is a warning; it is the default threshold of GO."""

SURER = 0.95
"""If the filter's sd of the target at rest, divided by the bound `quiet_m`, is below this [1], there is a warning."""


@dataclass(frozen=True, slots=True)
class Missing:
    """A missing part of a scene, and the user's next step."""

    what: str
    next: str


def check_report(done: SceneCheck) -> dict[str, object]:
    """The output of `softaim check --json`, also in check.json."""
    network, offsets = done.scene.network, 1e3 * done.offsets_m
    target = done.scene.target
    return {
        "scene": str(done.path),
        "nodes": network.n_nodes,
        "anchors": int(network.fixed.sum()),
        "springs": len(network.springs),
        "dimension": network.dim,
        "target": {"node": target.node, "radius_mm": 1e3 * target.radius_m},
        "marks": {
            "measured": list(done.scene.measured_nodes),
            "not_found": list(done.unfound),
            "by_one_camera": [mark.node for mark in done.seen if mark.node in done.single],
        },
        "rest": {
            "offset_mm": float(offsets.max()),
            "node": network.names[int(offsets.argmax())],
            "target_offset_mm": float(offsets[network.index(target.node)]),
            "drawn": bool(offsets.max() <= 1e3 * _drawn_to(done)),
        },
        "motion": {
            "frequencies_hz": done.motion.frequencies_hz[:N_LOWEST].tolist(),
            "damping_ratios": done.motion.damping_ratios[:N_LOWEST].tolist(),
            "slowest_decay_s": float(done.motion.decays_s[0]) if len(done.motion.decays_s) else None,
        },
        "steps": {"stable_ms": 1e3 * done.stable_s, "filter_ms": 1e3 * done.step_s},
        "information_share": dict(done.shares),
        "target_sigma_mm": {
            "bound_quiet": 1e3 * done.quiet_m,
            "bound_pushed": 1e3 * done.pushed_m,
            "filter_quiet": 1e3 * done.sigma_m,
            "frames_per_s": 1.0 / done.interval_s,
            "marks_mm": 1e3 * done.mark_sd_m,
        },
        "variance_shares": dict(done.variance_shares),
        "best_hit_probability": best_hit(done),
        "missing": [{"what": one.what, "next": one.next} for one in missing(done)],
    }


def check_lines(done: SceneCheck) -> list[tuple[str, str]]:
    """Lines of the report, each with its subject and its text; lines on missing parts are last."""
    lines = [
        ("scene", _scene(done)),
        ("rest", _rest(done)),
        ("motion", _motion(done)),
        ("steps", _steps(done)),
        ("marks", _marks(done)),
        ("target", _target(done)),
        ("errors", f"shares of the target's variance for advice: {shares_words(done.variance_shares)}"),
    ]
    lacks = [("missing", f"{one.what}. Next: {one.next}") for one in missing(done)]
    return lines + (lacks or [("missing", "nothing")])


def _scene(done: SceneCheck) -> str:
    network, target = done.scene.network, done.scene.target
    where = "in the plane" if network.dim == 2 else "in space"
    measured = done.scene.measured_nodes
    masses, anchors = counted(len(network.free), "mass", "masses"), counted(int(network.fixed.sum()), "anchor")
    marks = counted(len(measured), "measured mark")
    body = f"{masses}, {anchors} and {counted(len(network.springs), 'spring')} {where}"
    if network.continuum is not None:
        points, tissues = (
            counted(len(of), what) for of, what in ((network.free, "point"), (network.continuum.tissues, "tissue"))
        )
        body = f"{points} of a mesh of {tissues}, {amount(1e3 * network.continuum.mass, 'g', 'kg')}"
    return f"{body}; target {target.node}, a ball of {1e3 * target.radius_m:g} mm; {marks} on {_names(measured)}"


def _rest(done: SceneCheck) -> str:
    offsets, network = 1e3 * done.offsets_m, done.scene.network
    if offsets.max() <= 1e3 * _drawn_to(done):
        return f"the body rests as drawn, within {offsets.max():.2f} mm"
    node, target = network.names[int(offsets.argmax())], done.scene.target.node
    return (
        f"the body rests up to {offsets.max():.1f} mm from its drawing (node {node});"
        f" the target {target} {offsets[network.index(target)]:.1f} mm"
    )


def _motion(done: SceneCheck) -> str:
    motion = done.motion
    lowest = zip(motion.frequencies_hz[:N_LOWEST], motion.damping_ratios[:N_LOWEST], strict=True)
    named = [f"{hz:.2f} Hz (damping ratio {abs(ratio):.3f})" for hz, ratio in lowest]
    parts = [f"lowest frequencies {', '.join(named)}"] if named else ["no oscillations"]
    if len(motion.decays_s):
        parts.append(f"non-oscillating motions decay to 1/e within {motion.decays_s[0]:.2g} s")
    if not done.scene.network.is_held:
        loose = "with its wall" if done.scene.network.fixed.any() else "without anchors"
        parts.append(f"{loose} the body can drift and turn as a whole")
    if _has_friction(done):
        parts.append("dry friction is neglected")
    return "; ".join(parts)


def _steps(done: SceneCheck) -> str:
    own = f"the filter takes implicit steps of at most {1e3 * done.step_s:.2g} ms"
    return f"explicit steps are stable up to {1e3 * done.stable_s:.2g} ms; {own}"


def _marks(done: SceneCheck) -> str:
    shares = list(done.shares.items())
    named = [f"{node} {share:.0%}" for node, share in shares[:N_NAMED]]
    others = sum(share for _, share in shares[N_NAMED:])
    if len(shares) > N_NAMED:
        named.append(f"{counted(len(shares) - N_NAMED, 'other')} {others:.0%}")
    return f"shares of a frame's information on the target: {', '.join(named)}"


def _target(done: SceneCheck) -> str:
    quiet, pushed, own = (f"{1e3 * sigma:.2g} mm" for sigma in (done.quiet_m, done.pushed_m, done.sigma_m))
    if done.sigma_m < SURER * done.quiet_m and not _has_friction(done):
        own += ", because the filter also assumes that neighbouring nodes move alike, unlike the bound"
    return (
        f"with marks accurate to {_accuracy(done)} at {1.0 / done.interval_s:.3g} frames/s and exact constants, its"
        f" sigma on each axis is at least {quiet} without pushes, {pushed} if all marks are always pushed;"
        f" the filter reports {own} at rest"
    )


def _accuracy(done: SceneCheck) -> str:
    """Text on the accuracy of the marks, and the number of marks that only one camera sees."""
    own, n_single = f"{1e3 * done.mark_sd_m:.2g} mm", len(done.single)
    if not n_single:
        return own
    if n_single == len(done.seen):
        return f"{own} across the ray of the one camera that sees each"
    return f"{own} by several cameras, {counted(n_single, 'other')} by one camera, without depth,"


def missing(done: SceneCheck) -> list[Missing]:
    """Missing parts of the scene, the most important first."""
    return [*_of_target(done), *_of_rest(done), *_of_marks(done), *_of_tables(done)]


def _of_target(done: SceneCheck) -> Iterator[Missing]:
    scene = done.scene
    node = scene.target.node
    if node in scene.measured_nodes and not scene.target.offset_m:
        yield Missing(
            f"the target {node} has a measured mark: the filter uses the target's mark",
            f"measured = false in the [[mark]] of {node}, if the target will be hidden",
        )
    elif node not in {mark.node for mark in scene.marks}:
        yield Missing(
            f"the target {node} has no mark, so nothing can be identified or scored",
            "a [[mark]] with measured = false, visible only in the calibration recording",
        )
    if scene.target.position_sd_m is None:
        yield Missing(
            f"the accuracy of the target's position in the tissue is not stated: advice assumes"
            f" {1e3 * USUAL.position_m:g} mm on each axis, and marks cannot show it",
            "position_sd_mm in [target], registration included; a fix of the target reduces it",
        )
    if done.estimate.model_only:
        yield Missing(
            "the marks are too few or too far for an estimate of the target: the model dominates",
            f"measured marks on nodes nearer to {node} along springs",
        )
    if done.sigma_m < SURER * done.quiet_m and _has_friction(done):
        yield Missing(
            f"the filter's sigma, {1e3 * done.sigma_m:.2g} mm, is below the lower bound,"
            f" {1e3 * done.quiet_m:.2g} mm: at rest it treats dry friction as drag",
            "softaim track --check, which increases the covariance accordingly",
        )
    if (probability := best_hit(done)) < SURE:
        yield Missing(
            f"the target's accuracy is too low: even without pushes, the best aim lies within"
            f" {1e3 * scene.target.radius_m:g} mm of it with a probability of {probability:.0%} at most",
            "more or nearer marks, a finer camera, or a larger radius_mm",
        )


def _of_rest(done: SceneCheck) -> Iterator[Missing]:
    if done.offsets_m.max() <= _drawn_to(done) or rest_is_known(done.scene):
        return
    network = done.scene.network
    as_drawn = np.allclose(spring_lengths(network.positions, network.springs), network.rest_lengths, rtol=1e-6)
    yield Missing(
        "rest lengths equal the drawn distances, but gravity stretches springs, so the network does not rest as drawn"
        if as_drawn
        else "rest lengths do not fit the drawing, so the network does not rest as drawn",
        "softaim identify RECORDING --at-rest --out rest.toml, on a recording of the body at rest",
    )


def _of_marks(done: SceneCheck) -> Iterator[Missing]:
    scene = done.scene
    if done.unfound:
        why, look_at = _why_unfound(done)
        yield Missing(
            f"{counted(len(done.unfound), 'mark')} not found in the picture or table: {_names([*done.unfound])}{why}",
            f"check {look_at}{_view(done)}",
        )
    marked = {mark.node for mark in scene.marks}
    bare = [scene.network.names[i] for i in scene.network.free if scene.network.names[i] not in marked]
    if bare and scene.target.node in marked:
        yield Missing(
            f"{counted(len(bare), 'free node')} without a mark, {_names(bare)}: rest lengths cannot be found there",
            "a [[mark]] with measured = false on each node visible in the recording at rest",
        )


def _view(done: SceneCheck) -> str:
    """Text on the area that a flat scene's camera sees; empty if all marks are in its picture."""
    outside = any(one is not None and one.reason is Reason.OUTSIDE for one in done.unfound.values())
    view = done.scene.cameras[0].view_m if outside and done.scene.cameras else None
    if view is None:
        return ""
    (x0, y0), (x1, y1) = 1e3 * view.min(axis=0), 1e3 * view.max(axis=0)
    seen = f"x {x0:.0f} to {x1:.0f} mm, y {y0:.0f} to {y1:.0f} mm"
    return f"; the camera sees at most {seen}; softaim register moves the body"


def _why_unfound(done: SceneCheck) -> tuple[str, str]:
    """Text on a mark that was not found, and on what to check; the mark's reason is the most frequent one."""
    lost = [one for one in done.unfound.values() if one is not None]
    if not lost:
        return "", LOOK_AT[NO_ROW]
    most = Counter(one.reason for one in lost).most_common(1)[0][0]
    first = next(one for one in lost if one.reason is most)
    return f"; {first.name}: {lost_words(done.scene, first.name, first)}", LOOK_AT[most]


def _of_tables(done: SceneCheck) -> Iterator[Missing]:
    scene = done.scene
    for lens in scene.lenses:
        yield Missing(f"camera {lens.name} has a lens but no pose, so its pictures cannot be used", POSE)
    if not scene.cameras and not scene.lenses and scene.network.dim == 2:
        yield Missing(
            "no camera: films cannot be simulated or read",
            "softaim calibrate, or marks of another tracker in marks.csv",
        )
    if (unnoticed := pose_line(scene)) is not None:
        yield Missing(unnoticed, "three or more [[reference.mark]] on anchors or on the rig")
    left_out = steps_left_out(scene, "track")
    if "identify" in left_out:
        yield Missing(left_out["identify"], "softaim identify, on a recording in which the target is visible")
    if "tune" in left_out:
        yield Missing(left_out["tune"], "softaim tune, on a recording with typical motion")


def best_hit(done: SceneCheck) -> float:
    """Hit probability of an aim at the target's mean; the target's sd on each axis is the lower bound `quiet_m`."""
    dim = done.scene.network.dim
    middle, still = np.zeros(dim), np.zeros((dim, dim))
    target = GaussianMixture.gaussian(middle, done.quiet_m**2 * np.eye(dim))
    axis = np.eye(dim)[0]
    return hit_probability(
        target,
        GaussianMixture.gaussian(middle, still),
        axis,
        Lesion.ball(done.scene.target.radius_m, dim),
        needle=Needle(hit=Hit.TIP),
    )


def _has_friction(done: SceneCheck) -> bool:
    network = done.scene.network
    return bool(network.friction[network.free].any())


def _drawn_to(done: SceneCheck) -> float:
    """The report states how far a node at rest is from its position in the scene if the distance exceeds this [m]."""
    return SAGS * float(np.ptp(done.scene.network.positions, axis=0).max())


def _names(names: tuple[str, ...] | list[str]) -> str:
    named = ", ".join(names[:N_NAMED])
    return named if len(names) <= N_NAMED else f"{named} and {counted(len(names) - N_NAMED, 'other')}"
