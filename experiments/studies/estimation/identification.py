"""Test of the standard errors of identified constants: the table "Standard errors" of docs/identification.md.

    python -m experiments.studies.estimation.identification --out study             # 20 fits of each phantom
    python -m experiments.studies.estimation.identification --out study --runs 4 --first-seed 0
    python -m experiments.studies.estimation.identification --out study --page      # rewrites the page's table, too

A fit takes about 15 s on one core. The fit estimates logarithms of constants; a pull is the error of such an estimate
divided by its standard error.

Recordings last 12 s at 30 frames/s, with marks accurate to 1 mm per axis. They show the built-in phantom, or a phantom
with five masses and fourteen springs. An adaptive Runge-Kutta method computes the truth, with a tremor of 0.05 m/s²/√Hz
on every mass, Coulomb friction, and half-sine forces on one marked mass at a time (`experiments/scenarios/poked.toml`).
The scene's constants have random errors with the standard deviations `PRIOR_SD`. The prior of the fit has the same
deviations. Each fit starts from these constants. Development used seeds 0 to 39; the page uses seeds 1000 to 1019.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from dynamics import (
    HIDDEN,
    OUTER,
    MassSpringNetwork,
    build_network,
    four_mass_phantom,
    parameters,
    rest_shape,
    scale_parameters,
)
from estimators import IdentificationSettings, identify_constants
from experiments.engine.runs import Case
from experiments.formats.page import markdown_table
from experiments.formats.scenario import read_scenario
from experiments.simulation.simulate import true_motion
from experiments.studies.estimation.trials import Frames, frames_of
from experiments.studies.grid import command, grid, kept_runs, publish, seeds_of, study_options

PRIOR_SD: Mapping[str, float] = {"stiffness": 0.1, "rest_length": 0.01, "damping": 0.3, "drag": 0.3, "friction": 0.3}
"""Relative standard deviations of the errors in the scene's constants. The prior of the fit has the same deviations."""

FRAMES_PER_S, MARK_SD_M, LONG_S = 30, 1e-3, 12.0

BOUNDS = {"mean": (-0.3, 0.3), "spread": (0.8, 1.2)}
"""Permitted ranges of the pulls' mean and standard deviation."""

_PLACES_MM = {"P1": (-90, 70), "P2": (-60, 150), "P3": (55, 160), "P4": (95, 80), "T": (5, 85)}
_PLACES_MM |= {"A1": (-100, 0), "A2": (0, 0), "A3": (100, 0)}
_MASSES_KG = {"P1": 0.12, "P2": 0.10, "P3": 0.08, "P4": 0.12, "T": 0.15}
_SPRINGS = [
    ("P1", "P2", 160.0, 0.3),
    ("P2", "P3", 120.0, 0.3),
    ("P3", "P4", 150.0, 0.3),
    ("P1", "T", 120.0, 0.4),
    ("P2", "T", 120.0, 0.4),
    ("P3", "T", 120.0, 0.4),
    ("P4", "T", 120.0, 0.4),
    ("P1", "A1", 240.0, 0.4),
    ("T", "A2", 200.0, 0.6),
    ("P4", "A3", 240.0, 0.4),
    ("P1", "A2", 150.0, 0.5),
    ("P4", "A2", 150.0, 0.5),
    ("T", "A1", 120.0, 0.3),
    ("T", "A3", 120.0, 0.3),
]


def five_mass_phantom() -> MassSpringNetwork:
    """A phantom at rest under gravity: masses P1 to P4 around the hidden target T; nodes A1 to A3 are fixed."""
    anchors = [name for name in _PLACES_MM if name not in _MASSES_KG]
    drawn = build_network(
        list(_PLACES_MM),
        1e-3 * np.array(list(_PLACES_MM.values()), dtype=float),
        [(a, b) for a, b, _, _ in _SPRINGS],
        stiffness=[stiffness for _, _, stiffness, _ in _SPRINGS],
        damping=[damping for _, _, _, damping in _SPRINGS],
        masses=[_MASSES_KG.get(name, 0.1) for name in _PLACES_MM],
        drag=[0.0 if name in anchors else 0.15 for name in _PLACES_MM],
        friction=[0.0 if name in anchors else 0.015 for name in _PLACES_MM],
        fixed=anchors,
        gravity=[0.0, -9.81],
        rest_lengths="as drawn",
    )
    return replace(drawn, positions=rest_shape(drawn))


def phantom(name: str) -> tuple[MassSpringNetwork, tuple[str, ...], str]:
    """Network, marked nodes and target of a phantom; name: `built-in` or `five-mass`."""
    if name == "built-in":
        return four_mass_phantom(), OUTER, HIDDEN
    return five_mass_phantom(), ("P1", "P2", "P3", "P4"), "T"


def recorded(network: MassSpringNetwork, poked: Sequence[str], seed: int, duration_s: float) -> Frames:
    """Simulate short forces on the nodes `poked`; returns frames with noisy marks of all free nodes."""
    scenario = read_scenario("poked")
    if scenario.pokes is None:
        raise ValueError("scenario poked: expected pokes, found none")
    change = {
        "seed": seed,
        "duration_s": duration_s,
        "frame_interval_s": 1.0 / FRAMES_PER_S,
        "pokes": scenario.pokes.model_copy(update={"nodes": list(poked)}),
    }
    rng = np.random.default_rng(seed)
    truth = true_motion(network, scenario.model_copy(update=change), rng)
    noisy = truth.positions + rng.normal(0.0, MARK_SD_M, truth.positions.shape)
    names = [network.names[i] for i in network.free]
    return frames_of(truth.times_s, noisy, names, MARK_SD_M)


def identified(case: Case) -> list[dict[str, float | str]]:
    """A row for each fitted constant: errors of its logarithm before and after the fit, and the standard error."""
    network, marked, target = phantom(case["phantom"])
    frames = recorded(network, marked, case["seed"], case["duration_s"])
    which = parameters(network, tuple(PRIOR_SD))
    prior = np.array([PRIOR_SD[one.kind] for one in which])
    off = prior * np.random.default_rng([case["seed"], 1]).normal(size=len(which))
    wrong = scale_parameters(network, which, off)
    found = identify_constants(
        wrong, frames, marked, target, prior_sd=PRIOR_SD, search=IdentificationSettings(n_starts=1)
    )
    return [
        {"kind": one.kind, "place": one.index, "error": float(change + d), "before": float(d), "sd": float(sd)}
        for one, change, d, sd in zip(found.parameters, found.change, off, found.sd, strict=True)
    ]


def pulls(table: pd.DataFrame) -> dict[tuple[str, str], dict[str, float]]:
    """Figures for each phantom and kind of constant: mean and sd of pulls, rms errors, and rms of standard errors."""
    found: dict[tuple[str, str], dict[str, float]] = {}
    for (name, kind), rows in table.groupby(["phantom", "kind"], sort=False):
        pull = (rows["error"] / rows["sd"]).to_numpy()
        rms = {key: float(np.sqrt((rows[key] ** 2).mean())) for key in ("before", "error", "sd")}
        pulled = {"mean": float(pull.mean()), "spread": float(pull.std(ddof=1))}
        found[str(name), str(kind)] = {"fits": float(rows["seed"].nunique()), **pulled, **rms}
    return found


def page_table(found: Mapping[tuple[str, str], Mapping[str, float]]) -> str:
    """The table of docs/identification.md. A mean or sd of the pulls is bold if it is outside `BOUNDS`."""
    heads = ["phantom", "constants", "fits", "pull: mean, SD", "error: before, after", "standard error"]
    rows = []
    for (name, kind), row in found.items():
        bold = {key: "" if low <= row[key] <= high else "**" for key, (low, high) in BOUNDS.items()}
        pull = ", ".join(f"{mark}{row[key]:.2f}{mark}" for key, mark in bold.items())
        before, after, stated = (f"{100.0 * row[key]:.3g}%" for key in ("before", "error", "sd"))
        rows.append([name, kind.replace("_", " "), f"{row['fits']:.0f}", pull, f"{before}, {after}", stated])
    return markdown_table(heads, rows, left=(0, 1))


@command
def main(arguments: Sequence[str] | None = None) -> None:
    """Do the fits that the output folder lacks, and print the table."""
    parser = study_options(__doc__, page="identification.md", seeds=(20, 1000), runs="--runs")
    given = parser.parse_args(arguments)
    cases = grid(duration_s=[LONG_S], seed=seeds_of(given), phantom=["built-in", "five-mass"])
    table = kept_runs(identified, cases, given.out, given).checked()
    made = page_table(pulls(table.sort_values("phantom", kind="stable")))
    publish(given, made, {"pulls": made})


if __name__ == "__main__":
    sys.exit(main())
