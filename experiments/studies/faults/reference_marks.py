"""Error of the hidden target with a moving camera and reference marks, relative to a fixed camera.

`python -m experiments.studies.faults.reference_marks --seeds 10` prints a row for each body and motion: the four-mass
phantom with reference marks on its three anchors, and the breast, in space, with four of its anchors marked; pokes of 5
m/s², marks and reference marks to 1 mm an axis at 30 frames/s, 10 s. Truth by DOP853; the camera drifts by 1 mm/s, or
after 3 s is moved by 10 mm at once, or turned by 2 degrees. `still` has no reference marks; `unseen` has none while the
camera drifts. Figures obtained, with ten seeds:

    body     row            mean error [mm]  by still  in the 95 % region
    phantom  still               0.490         1.00          96.0 %
    phantom  drift 1 mm/s        0.524         1.07          96.3 %
    phantom  moved 10 mm         0.532         1.09          96.2 %
    phantom  turned 2 deg        0.532         1.09          96.2 %
    breast   still               0.207         1.00          99.7 %
    breast   drift 1 mm/s        0.217         1.05          99.7 %
    breast   moved 10 mm         0.221         1.07          99.7 %
    breast   turned 2 deg        0.224         1.08          99.7 %

Those of the breast are of 6 s (--seconds 6). All are of the filter without the slow acceleration of all mass.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from dynamics import breast_phantom, integrate_adaptive, pack, unpack
from estimators import MarkMeasurement, RigidMotion, coverage, normalised_error_squared
from experiments.arrays import Floats
from experiments.engine.runs import Case
from experiments.engine.workers import chosen_workers
from experiments.formats.scenario import Scenario, completed, read_scenario
from experiments.formats.scene.reference import Reference, ReferenceMark, reference_places
from experiments.formats.scene.scene import Scene
from experiments.pipeline.line import FILTER, Line
from experiments.projects.template import scene_with_marks
from experiments.simulation.forces import start_and_forces
from experiments.simulation.seen_marks import Truth
from experiments.simulation.simulate import exposures, scene_of
from experiments.studies.grid import grid, print_figures, runs_of, study_options

MARK_SD_M, SECONDS, MOVED_S = 1e-3, 10.0, 3.0
POKE_M_S2 = 5.0
N_ON_BREAST = 4
SEEDS = range(100, 110)


ROWS = ("still", "unseen", "none", "drift 1 mm/s", "moved 10 mm", "turned 2 deg")
WITHOUT = ("still", "unseen")
"""Rows without reference marks."""

BODIES = ("phantom", "breast")


def moved_by(row: str, t: float, dim: int) -> Floats:
    """Change of the camera's pose from the calibrated one, (n,), at a time since the start [s]."""
    change = np.zeros(dim * (dim + 1) // 2)
    if row in ("drift 1 mm/s", "unseen"):
        change[0] = 1e-3 * t
    elif row == "moved 10 mm" and t > MOVED_S:
        change[:2] = 8e-3, 6e-3
    elif row == "turned 2 deg" and t > MOVED_S:
        change[-1] = np.radians(2.0)
    return change


def scene_and_scenario(body: str, seed: int, seconds: float) -> tuple[Scene, Scenario]:
    """The scene of a body with its reference marks, and its forces."""
    scenario = read_scenario("poked")
    scene = scene_of(scenario) if body == "phantom" else scene_with_marks(breast_phantom(), {})
    network = scene.network
    anchors = [name for name, fixed in zip(network.names, network.fixed, strict=True) if fixed]
    spread = anchors if body == "phantom" else anchors[:: max(1, len(anchors) // N_ON_BREAST)][:N_ON_BREAST]
    assert scenario.pokes is not None
    pokes = scenario.pokes.model_copy(update={"nodes": list(scene.measured_nodes), "acceleration_m_s2": POKE_M_S2})
    scenario = scenario.model_copy(update={"pokes": pokes, "seed": seed, "duration_s": seconds})
    marks = tuple(ReferenceMark(f"R{k + 1}", node) for k, node in enumerate(spread))
    return (
        replace(scene, cameras=(), reference=Reference(marks)),
        completed(scenario, network, scene.measured_nodes, "scenario"),
    )


@cache
def _truth(body: str, seed: int, seconds: float) -> Truth:
    scene, scenario = scene_and_scenario(body, seed, seconds)
    network, times = scene.network, exposures(scenario)
    start, forces = start_and_forces(network, scenario, np.random.default_rng(seed))
    states = integrate_adaptive(
        network,
        pack(start, np.zeros_like(start)),
        times,
        force=lambda t: sum((force(t) for force in forces), np.zeros_like(start)),
        rtol=1e-6,
        atol=1e-8,
        max_step_s=1.0 / 60.0,
        bends_s=np.concatenate([np.empty(0), *(force.bends_s for force in forces)]),
    )
    return Truth(times, unpack(states, network.dim)[0])


def run(body: str, row: str, seed: int, seconds: float = SECONDS) -> tuple[Floats, Floats]:
    """Errors of the target [m], (n_frames, dim), and covariances; the noise of the marks is the same in every row."""
    scene, _ = scene_and_scenario(body, seed, seconds)
    truth, network = _truth(body, seed, seconds), scene.network
    still = reference_places(scene.reference, network)
    nothing = RigidMotion.none(np.mean(list(still.values()), axis=0))
    if row in WITHOUT:
        scene = replace(scene, reference=Reference())
    line, rng, dim = Line(scene, baseline=False), np.random.default_rng([seed, 7]), network.dim
    names, cov = [network.names[i] for i in network.free], MARK_SD_M**2 * np.eye(network.dim)
    estimates = []
    for time_s, positions in zip(truth.times_s, truth.positions, strict=True):
        motion = nothing.changed(moved_by(row, time_s - truth.times_s[0], dim))
        places = {**{node: positions[names.index(node)] for node in scene.measured_nodes}, **still}
        noise = rng.normal(0.0, MARK_SD_M, (len(places), dim))
        seen = motion.moved(np.array(list(places.values()))) + noise
        marks = [
            MarkMeasurement(name, place, cov)
            for name, place in zip(places, seen, strict=True)
            if name in scene.mark_names
        ]
        estimates.append(line.take(float(time_s), marks).estimates[FILTER])
    hidden = truth.positions[:, names.index(scene.target.node)]
    return np.array([e.mean for e in estimates]) - hidden, np.array([e.cov for e in estimates])


def case_run(case: Case) -> tuple[Floats, Floats]:
    """`run` of a body, a row, a seed and a length [s]."""
    return run(**case)


def figures(runs: Sequence[tuple[Floats, Floats]]) -> dict[str, float]:
    """Error of the target [mm], root mean square and mean; share inside the 95 % region; sigma of an axis [mm]."""
    errors, covs = (np.concatenate(parts) for parts in zip(*runs, strict=True))
    dim = errors.shape[1]
    return {
        "rmse_mm": 1e3 * float(np.sqrt((errors**2).sum(axis=1).mean())),
        "mae_mm": 1e3 * float(np.linalg.norm(errors, axis=1).mean()),
        "coverage95": coverage(normalised_error_squared(errors, covs), dim),
        "sigma_mm": 1e3 * float(np.sqrt(np.trace(covs, axis1=1, axis2=2).mean() / dim)),
    }


def main() -> None:
    """Print the figures of all rows."""
    parser = study_options(__doc__, out=False)
    parser.add_argument("--seeds", type=int, default=len(SEEDS))
    parser.add_argument("--seconds", type=float, default=SECONDS)
    parser.add_argument("--body", choices=BODIES, action="append")
    parser.add_argument("--row", choices=ROWS, action="append")
    given = parser.parse_args()
    for body in given.body or BODIES:
        still = 0.0
        for row in given.row or ROWS:
            cases = grid(body=[body], row=[row], seed=SEEDS[: given.seeds], seconds=[given.seconds])
            found = figures(runs_of(case_run, cases, chosen_workers(given)))
            still = still or found["mae_mm"]
            print_figures(f"{body:8} {row:13} by still {found['mae_mm'] / still:.3f}  ", found)


if __name__ == "__main__":
    main()
