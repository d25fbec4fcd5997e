"""Constants, noise levels and rest shape from recordings, for `softaim identify` and `softaim tune`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from dynamics import NetworkError, fit_rest_lengths
from estimators import (
    Budget,
    IdentificationError,
    IdentificationResult,
    MarkMeasurement,
    TuningResult,
    group_label,
    group_value,
    identify_constants,
    tune_strain,
)
from estimators.identification import MAX_VARIANCE_LEFT, Workers
from estimators.identification.budget import TooShortError
from experiments.errors import InputError, placed
from experiments.formats.recording import Recording
from experiments.formats.scene.mesh import SceneMesh
from experiments.formats.scene.scene import Scene
from experiments.pipeline.events import is_identified, rest_is_known
from experiments.pipeline.line import FILTER, Line
from experiments.pipeline.track import each_frame, marks_to_use
from experiments.plain import counted

Advance = Callable[[float], None]
Frames = list[tuple[float, tuple[MarkMeasurement, ...]]]

MOST_WORSE = 1.1
"""Largest factor [1] by which identified constants may increase the target's error; choice: a minute's recording
determines this factor to 10 %. The error is that of a filter without the target's mark."""

MOST_SHARED = 0.5
"""Squared correlation above which two constants are reported as confounded [1]; choice."""

NAMED = 4
"""Largest number of constants named for one undetermined combination, and of correlated pairs named in a line."""


ONLY_BY_FAST_MOTION = "forces are unknown, so only fast motion shows the stiffness of a mesh: measure young_kpa"
"""Reason why a recording hardly determines the stiffness of a mesh's tissues."""


@contextmanager
def estimated(recording: Recording) -> Iterator[None]:
    """Convert IdentificationError in a `with` block into InputError; it names `--minutes` if that is too short."""
    try:
        yield
    except IdentificationError as error:
        at = "--minutes" if isinstance(error, TooShortError) else recording.folder
        raise InputError(f"{at}: {error}") from error


def check_shown(recording: Recording, nodes: Sequence[str]) -> None:
    """Raise InputError if the recording has films and a mark of `nodes` is inside the body, where it is not filmed."""
    measured = recording.scene.measured_nodes
    if recording.films and (inside := [node for node in nodes if node not in measured]):
        what = f"marks.csv with the marks of {', '.join(inside)} (softaim simulate --no-film)"
        raise InputError.at(recording.folder, what, "films of cameras in space, which show no inner marks")


def marks_in(recording: Recording, advance: Advance = lambda _share: None) -> Frames:
    """All marks of each frame, including marks that the filter does not use; raises InputError, SourceError."""
    if recording.marks is not None:
        return list(marks_to_use(recording))
    frames = []
    for _, step in each_frame(Line(recording.scene, baseline=False), recording):
        frames.append((step.estimates[FILTER].time_s, step.marks))
        advance(len(frames) / len(recording.exposures_s))
    return frames


def resting_scene(recording: Recording, frames: Frames) -> Scene:
    """Fit the springs' rest lengths, so that the scene rests in the mean shape of the recording; raises InputError."""
    network = recording.scene.network
    if network.continuum is not None:
        raise InputError.at("--at-rest", "a network of springs", "a mesh, which rests as drawn")
    positions, variances = network.positions.copy(), []
    for i in network.free:
        node = network.names[i]
        seen = [mark for _, marks in frames for mark in marks if mark.node == node]
        if not seen:
            raise InputError.at(recording.folder, f"a mark on {node} in a picture of the tissue at rest", "none")
        positions[i] = np.mean([mark.position for mark in seen], axis=0)
        variances.append(np.mean([np.trace(mark.cov) for mark in seen]) / network.dim / len(seen))
    with placed(recording.folder, NetworkError):
        fitted = fit_rest_lengths(network, positions, sd_m=float(np.sqrt(np.mean(variances))))
    return replace(recording.scene, network=fitted)


def with_position_error(scene: Scene, frames: Frames) -> Frames:
    """The frames, with the error of the target's stated position as a part of the error of its mark.

    This error is the same in all frames. Here it is treated as independent, which is an approximation.
    """
    sd_m = scene.target.position_sd_m
    if not sd_m:
        return frames
    own = sd_m**2 * np.eye(scene.network.dim)
    return [
        (time_s, tuple(replace(m, cov=m.cov + own) if m.node == scene.target.node else m for m in marks))
        for time_s, marks in frames
    ]


def identified_scene(
    recording: Recording,
    frames: Frames,
    minutes: float,
    advance: Advance = lambda _share: None,
    workers: Workers = map,
) -> tuple[Scene, IdentificationResult]:
    """Identify the constants of a scene from a recording; returns the scene with these constants, and the full result.

    workers: map function, which may distribute the filter's passes over processes.
    Raises InputError if the target's mark is not visible, or if the identified constants fit worse than the scene's.
    """
    scene = recording.scene
    with estimated(recording):
        found = identify_constants(
            scene.network,
            with_position_error(scene, frames),
            scene.measured_nodes,
            scene.target.node,
            rests_as_drawn=rest_is_known(scene),
            spring_groups=scene.spring_groups,
            settings=scene.settings,
            budget=Budget(60.0 * minutes),
            workers=workers,
            advance=advance,
        )
    check_fit(recording, found)
    return replace(scene, network=found.network, uncertainty=found.uncertainty), found


def check_fit(recording: Recording, found: IdentificationResult) -> None:
    """Raise InputError if the identified constants fit the recording worse than the scene's constants."""
    if found.log_likelihood < found.log_likelihood_before:
        raise InputError.at(
            recording.folder,
            "constants that fit better than the scene's",
            f"a log likelihood of {found.log_likelihood:.1f}, below the scene's {found.log_likelihood_before:.1f}",
        )
    if found.target_error_m is None or found.target_error_before_m is None:
        return
    if found.target_error_m > MOST_WORSE * found.target_error_before_m:
        raise InputError.at(
            recording.folder,
            f"constants that predict {recording.scene.target.node} without its mark as well as the scene's",
            f"an error of {1e3 * found.target_error_m:.2f} mm instead of {1e3 * found.target_error_before_m:.2f} mm",
        )


def tuned_scene(
    recording: Recording,
    frames: Frames,
    minutes: float,
    advance: Advance = lambda _share: None,
    workers: Workers = map,
) -> tuple[Scene, TuningResult]:
    """Tune the discrepancy level: the size of the displacements that the model does not describe.

    Returns the scene with this level, and the full tuning result.
    workers: map function, which may distribute the filter's passes over processes.
    Raises InputError if `minutes` is too short for any result.
    """
    scene = recording.scene
    with estimated(recording):
        found = tune_strain(
            scene.network,
            frames,
            scene.measured_nodes,
            scene.target.node,
            uncertainty=scene.uncertainty,
            settings=scene.settings,
            is_identified=is_identified(scene),
            budget=Budget(60.0 * minutes),
            workers=workers,
            advance=advance,
        )
    return replace(scene, settings=found.settings), found


def constants(found: IdentificationResult, mesh: SceneMesh | None = None) -> list[dict[str, Any]]:
    """Name, value [SI], relative standard error and change of each identified constant.

    If the recording does not determine a constant, its value is not changed, and `kept` is true.
    mesh: the scene's mesh; None for a network of springs
    """
    tissues = () if mesh is None else mesh.tissues_of(found.network)
    return [
        {
            "name": group_label(one),
            "value": tissues[one.places[0]].young_pa if tissues else group_value(found.network, one),
            "standard_error": float(sd),
            "change": float(np.expm1(change)),
            "kept": bool(kept),
        }
        for one, sd, change, kept in zip(found.groups, found.sd, found.change, found.kept, strict=True)
    ]


def undetermined(found: IdentificationResult) -> list[Mapping[str, object]]:
    """Combinations of constants on which the recording contains less information than the prior.

    Each entry has the most important constants, and the posterior variance divided by the prior variance.
    """
    left, directions = found.identifiable()
    combinations: list[Mapping[str, object]] = []
    for share, direction in zip(left, directions, strict=True):
        if share > MAX_VARIANCE_LEFT:
            most = np.argsort(-np.abs(direction))[:NAMED]
            weights = {group_label(found.groups[k]): round(float(direction[k]), 3) for k in most}
            combinations.append({"variance_left": float(share), "weights": weights})
    return combinations


def confounded(found: IdentificationResult) -> list[dict[str, Any]]:
    """Pairs of constants with correlated errors, the strongest correlation first.

    A pair consists of two constants, or of the mean values of two kinds of constants.
    """
    kinds = [group.kind for group in found.groups]
    several = [kind for kind in dict.fromkeys(kinds) if kinds.count(kind) > 1]
    rows = [*np.eye(len(kinds)), *(np.array([one == kind for one in kinds], dtype=float) for kind in several)]
    names = [*(group_label(group) for group in found.groups), *(f"all {kind}" for kind in several)]
    cov = np.array(rows) @ found.cov @ np.array(rows).T
    sd = np.sqrt(np.diag(cov))
    correlation = cov / np.outer(sd, sd)
    n = len(kinds)
    pairs = [(a, b) for a in range(len(names)) for b in range(a + 1, len(names)) if (a < n) == (b < n)]
    together = [(a, b) for a, b in pairs if correlation[a, b] ** 2 > MOST_SHARED]
    together.sort(key=lambda pair: -abs(correlation[pair]))
    return [{"constants": [names[a], names[b]], "correlation": float(correlation[a, b])} for a, b in together]


def not_determined(found: IdentificationResult) -> dict[str, list[str]]:
    """Names of the constants that the recording does not determine, by kind of constant."""
    names: dict[str, list[str]] = {}
    for group, kept in zip(found.groups, found.kept, strict=True):
        if kept:
            names.setdefault(group.kind, []).append(group_label(group))
    return names


def identification_report(found: IdentificationResult, mesh: SceneMesh | None = None) -> dict[str, object]:
    """The output of `softaim identify --json`; mesh: the mesh whose tissues have these constants."""
    return {
        "passes": found.passes,
        "converged": found.converged,
        "directions": len(found.uncertainty.directions),
        "constants": constants(found, mesh),
        "undetermined_combinations": undetermined(found),
        "confounded": confounded(found),
        "not_determined": not_determined(found),
        "starts": {"followed": found.n_starts, "agreeing": found.n_agreeing},
        "residuals": {
            "explained": found.residuals.explained,
            "size": found.residuals.size,
            "inflation": found.residuals.inflation,
            "limited_by_prior": found.n_limited,
            "innovations": found.residuals.n,
            "effective_innovations": found.residuals.n_effective,
            "outliers": found.residuals.n_outliers,
        },
        "force_strength": found.force_strength,
        "log_likelihood": found.log_likelihood,
        "log_likelihood_before": found.log_likelihood_before,
        "target_error_mm": _mm(found.target_error_m),
        "target_error_before_mm": _mm(found.target_error_before_m),
        "frames": found.n_frames,
        "in_time": found.in_time,
    }


def _mm(length_m: float | None) -> float | None:
    return None if length_m is None else 1e3 * length_m


def fit_lines(found: IdentificationResult, minutes: float) -> list[str]:
    """Lines on how well the identified constants fit the recording."""
    residuals = found.residuals
    why = "" if found.n_agreeing else ": the search from the scene's own fits all frames better"
    lines = [f"{found.n_agreeing} of {found.n_starts} preliminary searches led to these constants{why}"]
    size = f"their mean square is {residuals.size:.2f} times the predicted one"
    if residuals.n_outliers >= 1.0:
        size += f", without {counted(round(residuals.n_outliers), 'outlying mark')}"
    if residuals.explained:
        lines += [f"Residuals are explained: {size}"]
    else:
        worth = f"{residuals.n} count as {residuals.n_effective:.0f} independent ones"
        larger = f"standard errors were multiplied by up to {residuals.inflation:.1f}"
        lines += [f"Residuals are not explained: {size}; {worth}; {larger}"]
    lines += _known_badly(found)
    if found.network.continuum is not None:
        lines += [f"Unknown forces: {found.force_strength:.2g} times as strong as expected from poke_m_s2"]
    if found.target_error_m is not None and found.target_error_before_m is not None:
        before, after = 1e3 * found.target_error_before_m, 1e3 * found.target_error_m
        with_noise = "Median error of the target predicted without its mark, mark noise included"
        lines += [f"{with_noise}: {before:.2f} mm before, {after:.2f} mm after"]
    return lines + time_lines(found, minutes)


def time_lines(found: IdentificationResult | TuningResult, minutes: float) -> list[str]:
    """If the time limit ended the search, a line that says so; otherwise no line."""
    best = f"Best result within {minutes:g} minutes, from {counted(found.n_frames, 'frame')}; more with --minutes"
    return [] if found.in_time else [best]


def _known_badly(found: IdentificationResult) -> list[str]:
    """Lines on constants that the recording does not determine, and on pairs of constants with correlated errors."""
    lines = []
    if kept := not_determined(found):
        kinds = [group.kind for group in found.groups]
        counts = ", ".join(f"{kind} ({len(names)} of {kinds.count(kind)})" for kind, names in kept.items())
        why = "" if found.network.continuum is None else f"; {ONLY_BY_FAST_MOTION}"
        lines += [f"Not determined by this recording, so the scene's values were kept: {counts}{why}"]
    if pairs := confounded(found):
        named = "; ".join(f"{' and '.join(p['constants'])} ({p['correlation']:+.2f})" for p in pairs[:NAMED])
        more = f"; {len(pairs) - NAMED} more pairs with --json" if len(pairs) > NAMED else ""
        lines += [f"Confounded constants, with the correlation of their errors: {named}{more}"]
    return lines


def tuning_report(found: TuningResult) -> dict[str, object]:
    """The output of `softaim tune --json`."""
    return {
        "levels": [
            {"strain": float(strain), "log_likelihood": float(log)}
            for strain, log in zip(found.strains, found.log_likelihoods, strict=True)
        ],
        "strain": found.settings.discrepancy,
        "log_likelihood": found.log_likelihood,
        "log_likelihood_before": found.log_likelihood_before,
        "frames": found.n_frames,
        "in_time": found.in_time,
    }
