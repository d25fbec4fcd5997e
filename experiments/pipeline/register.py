"""Registration of a scene to a tracker's coordinates by points measured on the body: what `softaim register` does."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from estimators import Registration, RegistrationError, register_points, weighted_mean, without_each
from experiments.arrays import Floats
from experiments.errors import InputError, placed
from experiments.formats.films.pictures import MARKS
from experiments.formats.marks.drawing import LENGTHS_MM, fits
from experiments.formats.marks.rows import MarkRow
from experiments.formats.recording import SAME_TIME_S, read_points
from experiments.formats.scene.moved import moved_scene
from experiments.formats.scene.reference import reference_places
from experiments.formats.scene.scene import Scene
from experiments.formats.scene.schema import SceneError
from experiments.pipeline.integrity import USUAL

CONTRADICTED = 1e-3
"""Least p-value [1] at which residuals still agree with the stated errors of the points; choice."""


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """Points on a body, measured in a tracker's coordinates.

    drawn: positions in the scene [m], (k, dim); measured: positions in the tracker's coordinates [m], (k, dim)
    covs: covariances of the measured positions [m²], (k, dim, dim)
    """

    names: tuple[str, ...]
    drawn: Floats
    measured: Floats
    covs: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Registered:
    """A registered scene.

    left_out: observed and expected distance [m] of each point from the position that the other points predict
    suspect: the point whose omission gives the best fit; None if no point can be omitted
    target_sd_m: standard deviation of the registration at the target on each axis [m]
    stated: whether the scene stated `position_sd_mm`, the error of the target's position, before the registration
    """

    scene: Scene
    points: Points
    found: Registration
    left_out: tuple[tuple[float, float] | None, ...]
    suspect: str | None
    target_sd_m: float
    stated: bool

    @property
    def contradicted(self) -> bool:
        """Whether the residuals are larger than the stated errors of the points allow."""
        return self.found.p_value < CONTRADICTED


def registered(scene: Scene, table: Path, seconds: float, mesh_file: Path) -> Registered:
    """Move a scene so that it fits points that a tracker measured on the body. Raises InputError.

    table: a file of points, or a folder with marks.csv; seconds: duration of the table's first part, which is used [s]
    mesh_file: file for the moved mesh
    """
    path = table / MARKS if table.is_dir() else table
    points = _points(scene, path, seconds)
    with placed(path, RegistrationError), placed(f"{path}: the moved scene", SceneError):
        found = register_points(points.drawn, points.measured, points.covs)
        if found.p_value < CONTRADICTED:
            _check_reading(path, points, found.rms_m)
        moved = moved_scene(scene, found.motion, mesh_file)
    others = without_each(points.drawn, points.measured, points.covs)
    left = {one.chi_square: name for name, one in zip(points.names, others, strict=True) if one is not None}
    sd_m, before_m = _target_sd(scene, found), scene.target.position_sd_m
    place_m = float(np.hypot(USUAL.position_m if before_m is None else before_m, sd_m))
    return Registered(
        scene=replace(moved, target=replace(moved.target, position_sd_m=place_m)),
        points=points,
        found=found,
        left_out=tuple(_left_out(points, k, one) for k, one in enumerate(others)),
        suspect=left[min(left)] if left else None,
        target_sd_m=sd_m,
        stated=before_m is not None,
    )


def _points(scene: Scene, path: Path, seconds: float) -> Points:
    """The points of a table at their mean positions in its first part; seconds: duration of that part [s]."""
    times_s, rows = read_points(path, scene)
    last_s = times_s.min(initial=np.inf) + seconds + SAME_TIME_S
    used: dict[str, list[MarkRow]] = {}
    for time_s, row in zip(times_s, rows, strict=True):
        if time_s <= last_s:
            used.setdefault(row.node, []).append(row)
    means = [
        weighted_mean(np.array([row.position_m for row in own]), np.array([row.cov for row in own]))
        for own in used.values()
    ]
    network, dim = scene.network, scene.network.dim
    places = dict(zip(network.names, network.positions, strict=True)) | reference_places(scene.reference, network)
    return Points(
        tuple(used),
        np.array([places[name] for name in used]).reshape(-1, dim),
        np.array([mean for mean, _ in means]).reshape(-1, dim),
        np.array([cov for _, cov in means]).reshape(-1, dim, dim),
    )


def _check_reading(path: Path, points: Points, plain_m: float) -> None:
    """Raise InputError if the points fit much better when mirrored, or with lengths in another unit."""
    size, signs = float(np.ptp(points.drawn, axis=0).max()), np.ones(points.drawn.shape[1])
    for unit, length_mm in {"": 1.0, **LENGTHS_MM}.items():
        for mirrored in (1.0, -1.0):
            signs[0] = mirrored
            rms_m = register_points(signs * points.drawn, length_mm * points.measured, points.covs).rms_m
            if fits(rms_m, plain_m, size):
                words = [
                    *(["the body mirrored"] if mirrored < 0.0 else []),
                    *([f"lengths in {unit} instead of mm"] if unit else []),
                ]
                found = f"points off by {1e3 * plain_m:.3g} mm; with {' and '.join(words)} only by {1e3 * rms_m:.3g} mm"
                raise InputError.at(path, "points on the body as drawn", found)


def _target_sd(scene: Scene, found: Registration) -> float:
    """Registration error at the target on each axis [m]. Residuals larger than the stated errors increase it."""
    target = scene.target
    place = scene.network.positions[[scene.network.index(target.node)]] + np.array(target.offset_m or 0.0)
    larger = max(1.0, np.sqrt(found.chi_square / found.degrees))
    return float(larger * np.sqrt(np.trace(found.error_cov(place)[0]) / scene.network.dim))


def _left_out(points: Points, k: int, others: Registration | None) -> tuple[float, float] | None:
    """Observed and expected distance of a point from the position that the other points predict [m]."""
    if others is None:
        return None
    drawn = points.drawn[[k]]
    expected = np.trace(points.covs[k] + others.error_cov(drawn)[0])
    return float(np.linalg.norm(points.measured[k] - others.motion.moved(drawn)[0])), float(np.sqrt(expected))


def registration_report(done: Registered) -> dict[str, Any]:
    """The registration as `--json` prints it."""
    found, dim = done.found, done.scene.network.dim
    R, distances_m = found.motion.rotation, np.linalg.norm(found.residuals, axis=1).tolist()
    return {
        "points": [
            {
                "name": name,
                "residual_mm": 1e3 * distance_m,
                "left_out_mm": None if off is None else 1e3 * off[0],
                "left_out_expected_mm": None if off is None else 1e3 * off[1],
            }
            for name, distance_m, off in zip(done.points.names, distances_m, done.left_out, strict=True)
        ],
        "rms_mm": 1e3 * found.rms_m,
        "expected_rms_mm": 1e3 * found.expected_rms_m,
        "chi_square": found.chi_square,
        "degrees": found.degrees,
        "p_value": found.p_value,
        "suspect": done.suspect if done.contradicted else None,
        "target_error_mm": 1e3 * done.target_sd_m,
        "position_sd_mm": 1e3 * (done.scene.target.position_sd_m or 0.0),
        "angle_deg": float(np.degrees(np.arccos(np.clip(0.5 * (np.trace(R) - dim) + 1.0, -1.0, 1.0)))),
        "rotation": R.tolist(),
        "translation_mm": (1e3 * found.motion.moved(np.zeros((1, dim)))[0]).tolist(),
    }


def registration_lines(done: Registered) -> Iterator[str]:
    """The registration in words."""
    report = registration_report(done)
    yield f"Rms residual {report['rms_mm']:.3g} mm; expected from stated errors {report['expected_rms_mm']:.3g} mm"
    if done.contradicted:
        better = f"; the fit improves most without {done.suspect}" if done.suspect else ""
        yield f"The residuals contradict the stated errors (p = {report['p_value']:.1g}){better}"
    moved = ", ".join(f"{x:.2f}" for x in report["translation_mm"])
    yield f"Turned by {report['angle_deg']:.2f} degrees about the origin, then moved by ({moved}) mm"
    with_default = "" if done.stated else f", with {1e3 * USUAL.position_m:g} mm for the position, which was not stated"
    yield (
        f"Registration error at the target {report['target_error_mm']:.3g} mm per axis; "
        f"position_sd_mm is now {report['position_sd_mm']:.3g}{with_default}"
    )
