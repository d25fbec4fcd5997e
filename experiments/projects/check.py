"""Check of a scene before estimation: what `softaim check` finds.

The accuracy bound is computed for small motions of the scene's network about its rest shape.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import vision
from dynamics import SAME_STEP, Oscillations, oscillations, rest_shape, stable_step
from estimators import MarkMeasurement, TargetEstimate, resting_bound
from estimators.core.motion import network as springs
from estimators.process.target import target_map
from experiments.arrays import Floats
from experiments.formats.marks.rows import MarkRow
from experiments.formats.recording import Recording, read_recording
from experiments.formats.scenario import NEAR_SD_MM
from experiments.formats.scene.reference import reference_places
from experiments.formats.scene.scene import Scene, usable_scene
from experiments.pipeline.integrity import error_budget, variance_shares
from experiments.pipeline.line import FILTER, Line, Step, check_followed
from experiments.pipeline.sight.space import calibration_shifts
from experiments.simulation.film import draw, draw_in_space
from vision import LostMark

FRAMES_PER_S = 30.0
"""Frame rate if neither a recording nor an option states one [1/s]."""

SETTLING_S, LONGEST_S = 1.0, 4.0
"""Shortest and longest run of the filter with marks at rest [s]; the run ends when the covariance is steady."""

SETTLED = 0.01
"""The target's variance is steady if its relative change in a quarter of a second is at most this [1]."""


@dataclass(frozen=True, slots=True, eq=False)
class SceneCheck:
    """Properties of a scene near its shape at rest.

    path: path of the scene's file; rest: positions at rest [m], (n_nodes, dim)
    stable_s: longest stable step of explicit integration [s]; step_s: longest step of the filter's integration [s]
    interval_s: frame interval [s]; seen: the measured marks in a frame at rest
    single: in space, nodes of the marks that only one camera sees
    unfound: reason for each mark that was not found, by its node; None if marks.csv has no row of the mark
    estimate: the filter's estimate of the target after some seconds at rest
    variance_shares: share of each source of error in the target's variance, the largest first
    quiet_m: lower bound on the sd of an unbiased estimate of the target, per axis, without pushes [m]
    pushed_m: the same bound with pushes of all marked nodes, as strong as the scene's filter assumes [m]
    """

    path: Path
    scene: Scene
    rest: Floats
    motion: Oscillations
    stable_s: float
    step_s: float
    interval_s: float
    seen: tuple[MarkMeasurement, ...]
    single: frozenset[str]
    unfound: Mapping[str, LostMark | None]
    estimate: TargetEstimate
    quiet_m: float
    pushed_m: float
    variance_shares: Mapping[str, float]

    @property
    def offsets_m(self) -> Floats:
        """Distance of each node at rest from its position in the scene's file [m], (n_nodes,)."""
        return np.asarray(np.linalg.norm(self.rest - self.scene.network.positions, axis=1))

    @property
    def sigma_m(self) -> float:
        """Standard deviation of the target on each axis, from the scene's filter [m]."""
        return per_axis(np.asarray(self.estimate.cov))

    @property
    def mark_sd_m(self) -> float:
        """Standard deviation of a mark on each axis [m], including the error of the camera's calibration.

        Marks that only one camera in space sees are omitted. If there are no other marks, the result is the standard
        deviation perpendicular to the camera's ray.
        """
        covs = [mark.total_cov for mark in self.seen if mark.node not in self.single]
        variances = np.linalg.eigvalsh(covs or [mark.total_cov for mark in self.seen])
        return float(np.sqrt(np.mean(variances if covs else variances[:, :-1])))

    @property
    def shares(self) -> Mapping[str, float]:
        """Share of each mark in a frame's information on the target, largest first; the shares sum to 1."""
        found = self.estimate.information_share
        whole = sum(found.values()) or 1.0
        return {node: found[node] / whole for node in sorted(found, key=lambda node: -found[node])}


def checked(
    source: Path,
    *,
    frames_per_s: float | None = None,
    sd_mm: float | None = None,
    advance: Callable[[float], None] = lambda _share: None,
) -> SceneCheck:
    """Check a scene file or a recording's scene; raises InputError.

    frames_per_s: frame rate [1/s]; by default that of the recording, or `FRAMES_PER_S` without a recording
    sd_mm: standard deviation of marks [mm]; by default that in marks.csv or in a picture, or else `NEAR_SD_MM`
    """
    recording = read_recording(source) if source.is_dir() else None
    path = source / "scene.toml" if source.is_dir() else source
    scene = usable_scene(path)
    network = scene.network
    check_followed(scene, path)
    rest = rest_shape(network)
    advance(0.1)
    interval_s = _interval_s(recording) if frames_per_s is None else 1.0 / frames_per_s
    seen, single, unfound = _seen(scene, rest, recording, sd_mm)
    line = Line(scene, baseline=False)
    reference = _reference_marks(scene, [mark for mark in seen if mark.node not in single] or seen)
    estimate = _after_rest(line, (*seen, *reference), interval_s, lambda share: advance(0.1 + 0.6 * share))
    settings, prior = line.filter.settings, line.filter.process.disturbances
    covs = {mark.node: mark.cov for mark in seen}
    strengths = prior.by_mode(line.filter.process.motion.raised)[0][1], prior.short_m_s2[1]
    calm, poked = (replace(settings.poked, white=prior.white, poke=strength) for strength in strengths)
    quiet = resting_bound(network, covs, interval_s, calm)
    advance(0.8)
    pushed = resting_bound(network, covs, interval_s, poked, poked=scene.measured_nodes)
    advance(1.0)
    at = target_map(network, scene.target.point)
    return SceneCheck(
        path=path,
        scene=scene,
        rest=rest,
        motion=oscillations(network, rest),
        stable_s=stable_step(network),
        step_s=interval_s / np.ceil(interval_s / springs.LONGEST_S - SAME_STEP),
        interval_s=interval_s,
        seen=seen,
        single=single,
        unfound=unfound,
        estimate=estimate,
        quiet_m=per_axis(at.cov(quiet)),
        pushed_m=per_axis(at.cov(pushed)),
        variance_shares=variance_shares(error_budget(scene, line.filter), estimate),
    )


def per_axis(cov: Floats) -> float:
    """Standard deviation per axis [m]: root of the mean variance of a covariance [m²], (dim, dim)."""
    return float(np.sqrt(np.trace(cov) / len(cov)))


def _interval_s(recording: Recording | None) -> float:
    """Median frame interval of a recording [s]."""
    if recording is None or len(recording.exposures_s) < 2:
        return 1.0 / FRAMES_PER_S
    return float(np.median(np.diff(recording.exposures_s)))


def _seen(
    scene: Scene, rest: Floats, recording: Recording | None, sd_mm: float | None
) -> tuple[tuple[MarkMeasurement, ...], frozenset[str], dict[str, LostMark | None]]:
    """Measured marks at rest; nodes whose mark only one camera sees; reason for each mark that was not found, by node.

    The covariances come from `sd_mm`, marks.csv or a picture; by default the standard deviation is `NEAR_SD_MM`.
    """
    network = scene.network
    covs = {node: (1e-3 * (sd_mm or NEAR_SD_MM)) ** 2 * np.eye(network.dim) for node in scene.measured_nodes}
    single: frozenset[str] = frozenset()
    unfound: dict[str, LostMark | None] = {}
    if sd_mm is None and recording is not None and recording.marks is not None:
        covs, without = _in_rows(scene, [row for frame in recording.marks for row in frame], covs)
        unfound = dict.fromkeys(without)
    elif sd_mm is None and (scene.cameras or scene.space_cameras):
        line = Line(scene, baseline=False, explain=True)
        step = _step(line, recording)
        found = {mark.node: mark for mark in step.marks}
        single = frozenset() if line.space is None else line.space.single
        # in a recording, marks that the filter does not use may be covered
        due = [mark.node for mark in scene.marks if mark.measured or (recording is None and scene.cameras)]
        lost = {} if step.sight is None else step.sight.lost
        unfound = {node: lost.get(node) for node in due if node not in found}
        covs = {node: found[node].cov for node in covs if node in found} or covs
    at = {node: rest[network.index(node)] for node in covs}
    marks = tuple(
        MarkMeasurement(node, at[node], cov, _calibration_error(scene, at[node])) for node, cov in covs.items()
    )
    return marks, single, unfound


def _step(line: Line, recording: Recording | None) -> Step:
    """Detect the marks in each camera's first picture; without a recording the pictures are synthetic."""
    scene, images = line.scene, {}
    x, light, rng = scene.network.positions, vision.Lighting(), np.random.default_rng(0)
    if recording is not None:
        for name, film in recording.open_films().items():
            with film as frames:
                images[name] = next(iter(frames)).image
    elif scene.space_cameras:
        images = {one.name: draw_in_space(scene, one, x, light, rng) for one in scene.space_cameras}
    else:
        images = {"": draw(scene, x, light, rng, strays=[])}
    return line.see_all(vision.Exposure(0.0, images)) if scene.space_cameras else line.see(0.0, images[""])


def _calibration_error(scene: Scene, place: Floats) -> Floats | None:
    """Error of a mark at this position due to the camera's calibration; None if the calibration is exact."""
    if scene.space_cameras and scene.n_calibration:
        shifts = calibration_shifts(scene)(place[None])[0]
        return np.pad(shifts, ((0, 0), (0, scene.n_calibration - scene.n_pose - shifts.shape[1])))
    camera = scene.cameras[0] if scene.cameras else None
    return None if camera is None or not camera.n_calibration else camera.calibration_error(place[None])[0]


def _reference_marks(scene: Scene, seen: Sequence[MarkMeasurement]) -> tuple[MarkMeasurement, ...]:
    """The reference marks at their stated positions; each has the mean covariance of the tissue's marks in `seen`."""
    cov = np.mean([mark.cov for mark in seen], axis=0)
    places = reference_places(scene.reference, scene.network)
    return tuple(MarkMeasurement(name, place, cov, _calibration_error(scene, place)) for name, place in places.items())


def _in_rows(
    scene: Scene, rows: Sequence[MarkRow], usual: Mapping[str, Floats]
) -> tuple[dict[str, Floats], tuple[str, ...]]:
    """Covariance of each node's mark [m²], from its row of median standard deviation; nodes without a row.

    usual: covariances that are returned if no node has a row
    """
    found = {node: sorted((row for row in rows if row.node == node), key=lambda row: row.sd_m) for node in usual}
    covs = {node: own[len(own) // 2].cov for node, own in found.items() if own}
    return covs or dict(usual), tuple(node for node, own in found.items() if not own)


def _after_rest(
    line: Line, seen: tuple[MarkMeasurement, ...], interval_s: float, advance: Callable[[float], None]
) -> TargetEstimate:
    """The filter's estimate of the target after marks have been at rest until the covariance is steady."""
    recent = max(1, int(np.ceil(0.25 / interval_s)))
    n_least, n_most = (max(recent + 1, int(np.ceil(length / interval_s))) for length in (SETTLING_S, LONGEST_S))
    variances: list[float] = []
    for k in range(n_most):
        estimate = line.take(k * interval_s, seen).estimates[FILTER]
        variances.append(float(np.trace(np.asarray(estimate.cov))))
        advance(min((k + 1) / n_least, 1.0))
        if k + 1 >= n_least and abs(variances[-1] / variances[-1 - recent] - 1.0) <= SETTLED:
            break
    return estimate
