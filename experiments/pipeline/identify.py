"""Constants, noise levels and rest shape from recordings: what `softaim identify` and `softaim tune` do."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from dynamics import NetworkError, fit_rest_lengths, parameter_label, parameter_value
from estimators import (
    IdentificationError,
    IdentificationResult,
    MarkMeasurement,
    TuningResult,
    identify_constants,
    tune_noise,
)
from experiments.errors import InputError
from experiments.formats.recording import Recording
from experiments.formats.scene.scene import Scene
from experiments.pipeline.line import Line
from experiments.pipeline.track import measurement

Advance = Callable[[float], None]
Frames = list[tuple[float, tuple[MarkMeasurement, ...]]]

MAX_VARIANCE_LEFT = 0.5
"""Part of the prior variance left to a combination of constants above which it is undetermined; chosen."""

NAMED = 4
"""Constants named of such a combination, those that weigh most."""


def marks_in(recording: Recording, advance: Advance = lambda _share: None) -> Frames:
    """All marks of each frame, those that are there for scoring only included; raises InputError, SourceError."""
    times = recording.exposures_s
    if recording.marks is not None:
        return [
            (float(time_s), tuple(measurement(mark) for mark in marks))
            for time_s, marks in zip(times, recording.marks, strict=True)
        ]
    line = Line(recording.scene, baseline=False)
    frames = []
    with recording.open_frames() as film:
        for k, frame in enumerate(film):
            frames.append((frame.exposure_s, line.see(frame.exposure_s, frame.image).marks))
            advance((k + 1) / len(times))
    return frames


def resting_scene(recording: Recording, frames: Frames) -> Scene:
    """The scene with rest lengths corrected so that it rests where the recording, at rest, shows it; InputError."""
    network = recording.scene.network
    positions, variances = network.positions.copy(), []
    for i in network.free:
        node = network.names[i]
        seen = [mark for _, marks in frames for mark in marks if mark.node == node]
        if not seen:
            raise InputError.at(recording.folder, f"a mark on {node} in a picture of the tissue at rest", "none")
        positions[i] = np.mean([mark.position for mark in seen], axis=0)
        variances.append(np.mean([np.trace(mark.cov) for mark in seen]) / network.dim / len(seen))
    try:
        return replace(
            recording.scene, network=fit_rest_lengths(network, positions, sd_m=float(np.sqrt(np.mean(variances))))
        )
    except NetworkError as error:
        raise InputError(f"{recording.folder}: {error}") from None


def identified_scene(
    recording: Recording, frames: Frames, advance: Advance = lambda _share: None
) -> tuple[Scene, IdentificationResult]:
    """The scene with the constants found in a calibration recording, how well they are known, and all that was found.

    Raises InputError where the hidden mark is not seen.
    """
    scene = recording.scene
    try:
        found = identify_constants(
            scene.network, frames, scene.measured_nodes, scene.target.node, settings=scene.settings, advance=advance
        )
    except IdentificationError as error:
        raise InputError(f"{recording.folder}: {error}") from None
    return replace(scene, network=found.network, uncertainty=found.uncertainty), found


def tuned_scene(
    recording: Recording, frames: Frames, advance: Advance = lambda _share: None
) -> tuple[Scene, TuningResult]:
    """The scene with the noise levels under which the recording is most probable, and all that was found."""
    scene = recording.scene
    found = tune_noise(
        scene.network,
        frames,
        scene.measured_nodes,
        scene.target.node,
        uncertainty=scene.uncertainty,
        settings=scene.settings,
        advance=advance,
    )
    return replace(scene, settings=found.settings), found


@dataclass(frozen=True, slots=True)
class Constant:
    """One constant found: its name, its value [SI], relative standard error, by how much it changed, relative."""

    name: str
    value: float
    standard_error: float
    change: float


def constants(found: IdentificationResult) -> list[Constant]:
    """What was found, constant by constant."""
    return [
        Constant(
            parameter_label(found.network, one), parameter_value(found.network, one), float(sd), float(np.expm1(change))
        )
        for one, sd, change in zip(found.parameters, found.sd, found.change, strict=True)
    ]


def undetermined(found: IdentificationResult) -> list[Mapping[str, object]]:
    """Combinations that the recording determines less than the prior does.

    Of each the part of the variance that is left, and the constants that weigh most in it.
    """
    left, directions = found.identifiable()
    combinations: list[Mapping[str, object]] = []
    for share, direction in zip(left, directions, strict=True):
        if share > MAX_VARIANCE_LEFT:
            most = np.argsort(-np.abs(direction))[:NAMED]
            weights = {parameter_label(found.network, found.parameters[k]): round(float(direction[k]), 3) for k in most}
            combinations.append({"variance_left": float(share), "weights": weights})
    return combinations


def identification_report(found: IdentificationResult) -> dict[str, object]:
    """What `softaim identify --json` prints."""
    return {
        "passes": found.passes,
        "converged": found.converged,
        "directions": len(found.uncertainty.directions),
        "constants": [
            {"name": c.name, "value": c.value, "standard_error": c.standard_error, "change": c.change}
            for c in constants(found)
        ],
        "not_told": undetermined(found),
    }


def tuning_report(found: TuningResult) -> dict[str, object]:
    """What `softaim tune --json` prints."""
    return {
        "levels": {
            name: {"value": float(level), "relative_standard_error": float(sd)}
            for name, level, sd in zip(found.names, found.values, found.log_sd, strict=True)
        },
        "log_likelihood": found.log_likelihood,
        "log_likelihood_before": found.log_likelihood_before,
    }
