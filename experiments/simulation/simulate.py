"""Recordings that `softaim simulate` writes: the true motion of a scenario, and its film or its marks.

The true motion is computed with SciPy's adaptive integrators, not with the filter's steps.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path

import numpy as np

import vision
from dynamics import (
    KINDS,
    MassSpringNetwork,
    four_mass_phantom,
    integrate_adaptive,
    pack,
    parameters,
    scale_parameters,
    stable_step,
    supported,
    unpack,
)
from dynamics.phantoms.four_mass import HIDDEN
from estimators import FilterSettings
from experiments.arrays import Floats
from experiments.errors import InputError, read_text
from experiments.formats.outputs import output_folder, write_whole
from experiments.formats.recording import write_frames_csv, write_marks_csv, write_truth_csv
from experiments.formats.scenario import Scenario
from experiments.formats.scene.reference import Reference
from experiments.formats.scene.scene import Mark, Scene, Target, read_scene, step_lines, with_step, write_scene
from experiments.formats.scene.schema import SceneFile
from experiments.formats.toml_file import read_toml
from experiments.simulation.film import write_films
from experiments.simulation.forces import start_and_forces
from experiments.simulation.seen_marks import Truth, seen_marks
from experiments.version import version

TARGET_RADIUS_M = 0.005
"""Radius of the target in the phantom [m]; a parameter of the study."""

EXACT = 0.0015
"""Setting `discrepancy` of the filter for the phantom: the model's error [1], relative to the phantom's extent; choice:
small, because the model of a simulated phantom is exact."""

TRUTH = 0.2
"""Share of the reported progress that is reached when the true motion is computed and only the film remains [1]."""

STIFF_S = 1e-4
"""If the longest stable step is shorter than this [s], the integrator is implicit, otherwise explicit; numerical."""


def scene_of(scenario: Scenario) -> Scene:
    """The scene that the scenario names, or the phantom's scene with the scenario's camera. Raises InputError."""
    if scenario.scene is not None:
        return read_scene(Path(scenario.scene))
    network = four_mass_phantom()
    names = [network.names[i] for i in network.free]
    marks = tuple(
        Mark(name, scenario.marks.hue_deg, scenario.marks.diameter_mm * 1e-3, measured=name != HIDDEN) for name in names
    )
    seen = scenario.camera
    if seen is None:
        raise InputError.at("scenario: camera", "this table beside phantom", "none")
    camera = vision.fronto_parallel_camera(
        "front",
        (seen.size_px[0], seen.size_px[1]),
        (seen.mm_per_px[0], seen.mm_per_px[1]),
        (seen.centre_mm[0] * 1e-3, seen.centre_mm[1] * 1e-3),
        calibration_sd_px=seen.calibration_sd_px,
    )
    return Scene(
        network=network,
        marks=marks,
        target=Target(HIDDEN, TARGET_RADIUS_M, position_sd_m=0.0),
        cameras=(camera,),
        reference=Reference(drift_sd_m=0.0),
        settings=FilterSettings(discrepancy=EXACT),
    )


def exposures(scenario: Scenario) -> Floats:
    """Exposure times of the scenario's frames [s], (n_frames,)."""
    return np.arange(0.0, scenario.duration_s, scenario.frame_interval_s)


def true_network(network: MassSpringNetwork, scenario: Scenario, seed: int) -> MassSpringNetwork:
    """The network with random true constants; the scenario states how much they differ from the scene's constants."""
    if scenario.constants is None:
        return network
    spread = scenario.constants.model_dump()
    which = parameters(network, tuple(kind for kind in KINDS if spread[kind] > 0.0))
    sds = np.array([spread[parameter.kind] for parameter in which])
    return scale_parameters(network, which, sds * np.random.default_rng([seed, 3]).normal(size=len(which)))


def kept_motion(path: Path, network: MassSpringNetwork, scenario: Scenario, rng: np.random.Generator) -> Truth:
    """The result of `true_motion`, from a cache file of positions (.npy). If the file is missing, it is written."""
    if path.exists():
        return Truth(exposures(scenario), np.load(path))
    motion, content = true_motion(network, scenario, rng), io.BytesIO()
    np.save(content, motion.positions)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, content.getvalue())
    return motion


def true_motion(
    network: MassSpringNetwork,
    scenario: Scenario,
    rng: np.random.Generator,
    advance: Callable[[float], None] = lambda _share: None,
    *,
    times_s: Floats | None = None,
) -> Truth:
    """True motion of the free nodes under the scenario's forces; raises InputError.

    A network without anchors moves without gravity, see `supported`.
    advance: called with the completed share
    times_s: times of the positions [s], (n,); by default, the scenario's exposure times
    """
    times = exposures(scenario) if times_s is None else times_s
    start, forces = start_and_forces(network, scenario, rng)
    nothing, shown = np.zeros_like(start), 0

    def acting(t: float) -> Floats:
        nonlocal shown
        if (done := int(100.0 * t / scenario.duration_s)) > shown:
            shown = done
            advance(min(0.01 * done, 1.0))
        return sum((force(t) for force in forces), nothing)

    try:
        states = integrate_adaptive(
            supported(network),
            pack(start, nothing),
            times,
            force=acting,
            # explicit: with one or two steps between knots a method of higher order is not faster
            method="Radau" if stable_step(network) < STIFF_S else "RK45",
            rtol=1e-6,
            atol=1e-8,
            max_step_s=scenario.tremor.interval_s if scenario.tremor else 1.0 / 60.0,
            bends_s=np.concatenate([np.empty(0), *(force.bends_s for force in forces)]),
        )
    except RuntimeError as fault:
        raise InputError(f"scenario: expected forces that the motion can follow, found {fault}") from None
    return Truth(times, unpack(states, network.dim)[0])


def simulate(
    scenario: Scenario,
    out: Path,
    *,
    force: bool = False,
    filmed: bool = True,
    advance: Callable[[float], None] = lambda _share: None,
) -> None:
    """Write the recording of a scenario to the folder `out`; raises InputError.

    filmed: if False, or if the scene has no camera, marks.csv is written instead of a film
    advance: called with the completed share
    """
    scene = scene_of(scenario)
    if filmed and len(scene.cameras) > 1:
        raise InputError.at(f"{scenario.scene}: camera", "one for a film, or --no-film", str(len(scene.cameras)))
    n_films = len(scene.cameras or scene.space_cameras) if filmed else 0
    # each camera in space exposes after the previous one
    times = [exposures(scenario) + k * scenario.video.stagger_s for k in range(max(n_films, 1))]
    times_s = np.unique(np.concatenate(times).round(9)) if len(times) > 1 else times[0]
    of_truth = TRUTH if n_films else 1.0
    with output_folder(out, force=force) as folder:
        rng = np.random.default_rng(scenario.seed)
        network = true_network(scene.network, scenario, scenario.seed)
        truth = true_motion(network, scenario, rng, lambda share: advance(of_truth * share), times_s=times_s)
        _copy_scene(scenario, scene, folder / "scene.toml")
        names = [scene.network.names[i] for i in scene.network.free]
        write_truth_csv(folder / "truth.csv", times_s, {name: truth.positions[:, k] for k, name in enumerate(names)})
        if n_films:
            rest = 1.0 - TRUTH
            write_films(scenario, scene, times, truth, folder, rng, lambda share: advance(TRUTH + rest * share))
        else:
            write_frames_csv(folder / "frames.csv", times_s)
            marks = seen_marks(scene, truth, scenario.seen, rng).marks
            write_marks_csv(folder / "marks.csv", times_s, marks or (), dim=scene.network.dim)
            advance(1.0)


def _copy_scene(scenario: Scenario, scene: Scene, path: Path) -> None:
    """Write the scene to `path`. If the scene uses camera files, their contents are written in place of their names.

    If the scenario does not change the constants of the scene, `[[provenance]]` gets the step `simulate`.
    """
    done = with_step(scene, "simulate", version()) if scenario.constants is None else scene
    own = None if scenario.scene is None else Path(scenario.scene)
    if own is None or scene.mesh or any(camera.file is not None for camera in read_toml(own, SceneFile).camera):
        write_scene(done, path)
    else:
        added = step_lines(done.steps[len(scene.steps) :])
        write_whole(path, "\n".join([read_text(own).rstrip("\n"), *added]) + "\n")
