"""Error of the hidden mass by both methods, at 30 frames/s and 4.14 mm of mark noise, with true parameters.

Reproduces the comparison in [paper] section IV with the paper's mark noise ("4.14 ± 1.47 mm", assumed to be the
standard deviation on each axis) at a camera's frame rate. Truth is by SciPy's RK45.
`python -m experiments.studies.hidden_error` prints, with 20 runs of 20 s (latest figures in README.md):

    scenario  open loop  filter  ratio  in 95 % region  worst
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimators import coverage, normalised_error_squared
from experiments.arrays import Floats
from experiments.engine.workers import ALL_CORES, Workers, chosen_workers
from experiments.formats.scenario import read_scenario
from experiments.pipeline.line import FILTER, OPEN_LOOP, Line
from experiments.simulation.simulate import scene_of, true_motion
from experiments.studies.estimation.trials import frames_of
from experiments.studies.grid import print_figures, runs_of, study_options

MARK_SD_M = 0.00414
N_RUNS = 20
SEEDS = range(100, 100 + N_RUNS)


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """One seeded run: errors of the hidden mass by method [m], (n_frames,), and the filter's NEES, (n_frames,)."""

    errors: dict[str, Floats]
    nees: Floats


def run(scenario_name: str, seed: int, mark_sd_m: float = MARK_SD_M, duration_s: float = 20.0) -> Run:
    """Both methods on the same noisy marks of one scenario."""
    scenario = read_scenario(scenario_name).model_copy(update={"seed": seed, "duration_s": duration_s})
    rng = np.random.default_rng(seed)
    scene = scene_of(scenario)
    truth = true_motion(scene.network, scenario, rng)
    names = [scene.network.names[i] for i in scene.network.free]
    hidden = names.index(scene.target.node)
    noisy = truth.positions + rng.normal(0.0, mark_sd_m, truth.positions.shape)
    seen = noisy[:, [names.index(node) for node in scene.measured_nodes]]
    line = Line(scene)
    steps = [line.take(*frame) for frame in frames_of(truth.times_s, seen, scene.measured_nodes, mark_sd_m)]
    errors = {
        m: np.array([s.estimates[m].mean for s in steps]) - truth.positions[:, hidden] for m in (OPEN_LOOP, FILTER)
    }
    covs = np.array([s.estimates[FILTER].cov for s in steps])
    return Run(
        {m: np.linalg.norm(e, axis=1) for m, e in errors.items()}, normalised_error_squared(errors[FILTER], covs)
    )


def seeded_run(case: tuple[str, int]) -> Run:
    """Result of `run` for a scenario and a seed."""
    return run(*case)


def study(scenario_name: str, seeds: range, workers: Workers = ALL_CORES) -> dict[str, float]:
    """Figures of all runs: mean errors [mm], their ratio, coverage of 95 % regions, largest error in any frame [mm]."""
    runs: list[Run] = runs_of(seeded_run, [(scenario_name, seed) for seed in seeds], workers)
    errors = {m: 1e3 * np.concatenate([r.errors[m] for r in runs]) for m in (OPEN_LOOP, FILTER)}
    means = {m: float(e.mean()) for m, e in errors.items()}
    return {
        "open_loop_mm": means[OPEN_LOOP],
        "filter_mm": means[FILTER],
        "ratio": means[FILTER] / means[OPEN_LOOP],
        "worst_run_ratio": max(float(r.errors[FILTER].mean() / r.errors[OPEN_LOOP].mean()) for r in runs),
        "coverage95": coverage(np.concatenate([r.nees for r in runs]), 2),
        "mean_nees": float(np.concatenate([r.nees for r in runs]).mean()),
        "worst_mm": float(errors[FILTER].max()),
    }


def main() -> None:
    """Print the figures of both scenarios."""
    workers = chosen_workers(study_options(__doc__, out=False).parse_args())
    for scenario in ("quiet", "poked"):
        print_figures(f"{scenario:8}", study(scenario, SEEDS, workers))


if __name__ == "__main__":
    main()
