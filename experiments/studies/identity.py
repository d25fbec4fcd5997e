"""Exchanged marks of one hue: how soon an exchange is detected, how often corrected, and false detections.

    python -m experiments.studies.identity --out study         # 108 runs of each kind, some 10 minutes on two cores
    python -m experiments.studies.identity --runs 4 --out study

Truth is by SciPy's RK45, 4 s at 30 frames/s, marks with noise. `phantom`: the paper's, marks 280 mm apart and more,
4.14 mm of noise. `close`: the same masses and springs with three tenths of the distances, 1 mm of noise; when shoved it
turns over and its marks pass each other. Kinds of run:

never: right names. wrong springs: the same, and the filter's springs are 1.4 times as
stiff. for good: two names exchanged from 1.5 s on. a while: for ten frames. from the start: names
permuted in all frames. slipped by: the same, names fixed in the first 1.5 s. hidden: no names are given;
all marks are hidden for half a second in each 1.3 s, and those that come back are named by where the filter expects
them (`vision.tracking.association`). seldom: the same with 5 frames/s and nothing hidden.

study/identity.json has the figures, study/identity.csv a row a run.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from dynamics import HIDDEN, OUTER, MassSpringNetwork, four_mass_phantom, rest_shape
from estimators import AssociatedEstimate, AssociationFilter, MarkMeasurement, TissueFilter
from experiments.arrays import Floats
from experiments.engine.runs import Case
from experiments.engine.study import OWN
from experiments.engine.workers import Workers, chosen_workers
from experiments.formats.outputs import write_whole
from experiments.formats.scenario import read_scenario
from experiments.simulation.simulate import true_motion
from experiments.studies.estimation.trials import EXACTLY
from experiments.studies.grid import command, kept_runs, print_figures, study_options
from vision import Detection, Expected, associate_marks

DURATION_S, FRAMES_PER_S = 4.0, 30
FROM, FOR = 45, 10
"""Frame of the exchange, and its duration in frames if it ends."""
SETTINGS = tuple((where, how) for where in ("phantom", "close") for how in ("quiet", "poked", "shoved"))
REPORTED = ("never", "wrong springs", "for good", "a while", "from the start", "slipped by")
BLIND = ("for good", "from the start")
"""Kinds of run that are also done with fixed names."""
WRONG = 1.4
"""Stiffness in the filter's model relative to the true one, for wrong springs."""
NAMELESS = {"hidden": 1, "seldom": 6}
"""Kinds of run without given names, and their step of frames."""
NOISE_M = {"phantom": 0.00414, "close": 0.001}
CLOSE = 0.3
END_S = 1.5
"""Errors of the target are those of the last seconds [s]."""


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """One truth: times [s] (n,), true and measured marks and target [m], (n, ., dim)."""

    network: MassSpringNetwork
    times_s: Floats
    marks: Floats
    target: Floats
    noise_m: float


def tissue_of(where: str) -> MassSpringNetwork:
    """The paper's phantom, or the same with its masses close together, at rest."""
    network = four_mass_phantom()
    if where == "phantom":
        return network
    close = replace(network, positions=CLOSE * network.positions, rest_lengths=CLOSE * network.rest_lengths)
    return replace(close, positions=rest_shape(close))


def world(where: str, how: str, seed: int) -> World:
    """The events of a run, and the measured marks."""
    network = tissue_of(where)
    change = {"duration_s": DURATION_S, "seed": seed, "frame_interval_s": 1.0 / FRAMES_PER_S}
    truth = true_motion(network, read_scenario(how).model_copy(update=change), np.random.default_rng([seed, 1]))
    places = [network.coordinates(node).start // network.dim for node in (*OUTER, HIDDEN)]
    positions = truth.positions[:, places]
    rng = np.random.default_rng([seed, 2])
    seen = positions[:, :-1] + rng.normal(0.0, NOISE_M[where], positions[:, :-1].shape)
    return World(network, truth.times_s, seen, positions[:, -1], NOISE_M[where])


def reported_names(kind: str, rng: np.random.Generator) -> NDArray[np.int64]:
    """Index of the mark reported under each name, by frame, (n_frames, 3)."""
    reported = np.tile(np.arange(len(OUTER)), (round(DURATION_S * FRAMES_PER_S), 1))
    i, j = rng.permutation(len(OUTER))[:2]
    if kind in ("from the start", "slipped by"):
        others = [(1, 0, 2), (2, 1, 0), (0, 2, 1), (1, 2, 0), (2, 0, 1)]
        reported[:] = others[rng.integers(len(others))]
    elif kind not in ("never", "wrong springs"):
        until = FROM + FOR if kind == "a while" else None
        reported[FROM:until, [i, j]] = reported[FROM:until, [j, i]]
    return reported


def named_run(
    one: World, kind: str, reported: NDArray[np.int64] | None, alike: list[tuple[str, ...]]
) -> dict[str, object]:
    """A run with names by another tracker, or by the filter's predictions; alike empty: names are fixed."""
    network = one.network
    if kind == "wrong springs":
        network = replace(network, stiffness=WRONG * network.stiffness)
    tissue = TissueFilter(network, HIDDEN, OUTER, EXACTLY)
    identity = AssociationFilter(tissue, alike)
    taken = range(0, len(one.times_s), NAMELESS.get(kind, 1))
    errors, wrong, doubts = [], [], 0
    for k in taken:
        tissue.predict(float(one.times_s[k]))
        if reported is None:
            names, which = expected_names(one, k, tissue, hidden=kind == "hidden")
        else:
            names, which = list(OUTER), reported[k].tolist()
        cov = one.noise_m**2 * np.eye(one.network.dim)
        marks = [MarkMeasurement(name, one.marks[k, m], cov) for name, m in zip(names, which, strict=True)]
        if kind == "slipped by" and k < FROM:
            named = AssociatedEstimate(tissue.update(marks), tuple(marks))
        else:
            named = identity.update(marks if reported is None else identity.named(marks))
        doubts += bool(identity.alternatives)
        errors.append(np.linalg.norm(named.estimate.mean - one.target[k]))
        if marks:
            wrong.append(any(mark.node != OUTER[m] for mark, m in zip(named.marks, which, strict=True)))
    end = one.times_s[taken] > one.times_s[-1] - END_S
    return {
        "end_mm": 1e3 * float(np.sqrt(np.mean(np.square(errors)[end]))),
        "wrong_frames": sum(wrong),
        "wrong_end": wrong[-1],
        "swaps": len(identity.swaps),
        "doubts": doubts,
    }


def expected_names(one: World, k: int, tissue: TissueFilter, *, hidden: bool) -> tuple[list[str], list[int]]:
    """Names of the marks of a frame by the filter's predictions, and the true marks; some frames hidden."""
    cov = one.noise_m**2 * np.eye(one.network.dim)
    seen = [] if hidden and k % 40 >= 25 else [Detection(1e3 * z, 1e6 * cov, 10.0, 0.0, False) for z in one.marks[k]]
    expected = []
    for node in OUTER:
        mean, spread = tissue.expected(node)
        expected.append(Expected(node, 1e3 * mean, 1e6 * spread, 0.0))
    found = associate_marks(seen, expected, gate=1e4)
    return [f.name for f in found], [next(m for m, d in enumerate(seen) if d is f.detection) for f in found]


def run(seed: int, where: str, how: str) -> list[dict[str, object]]:
    """All kinds of run on one truth, with names that may be exchanged and with fixed names."""
    one = world(where, how, seed)
    rows = []
    for kind in (*REPORTED, *NAMELESS):
        reported = None if kind in NAMELESS else reported_names(kind, np.random.default_rng([seed, 3]))
        for interchangeable in (True, False)[: 2 if kind in (*BLIND, *NAMELESS) else 1]:
            row = named_run(one, kind, reported, [tuple(OUTER)] if interchangeable else [])
            rows.append({"where": where, "how": how, "seed": seed, "kind": kind, "doubted": interchangeable} | row)
    return rows


def figures(rows: pd.DataFrame) -> dict[str, dict[str, float]]:
    """Figures of the rows by place, motion and kind of run, and by place and kind."""
    table_figures = {
        " ".join(which): _of_kind(part, rows[(rows["where"] == which[0]) & (rows.how == which[1])])
        for which, part in rows.groupby(["where", "how", "kind"], sort=False)
    }
    for (where, kind), part in rows.groupby(["where", "kind"], sort=False):
        table_figures[f"{where} all {kind}"] = _of_kind(part, rows[rows["where"] == where])
    return table_figures


def _of_kind(part: pd.DataFrame, rows: pd.DataFrame) -> dict[str, float]:
    """Figures of runs of one kind, beside all rows: with names that may be exchanged; `else` with fixed names."""
    ours, blind = part[part.doubted], part[~part.doubted]
    known = {
        "runs": len(ours),
        "swaps": int(ours.swaps.sum()),
        "runs_with_swaps": int((ours.swaps > 0).sum()),
        "runs_wrong_in_the_end": int(ours.wrong_end.astype(bool).sum()),
        "wrong_frames": int(ours.wrong_frames.sum()),
        "end_mm": float(ours.end_mm.median()),
        "end_mm_unswapped": float(rows[(rows.kind == "never") & rows.doubted].end_mm.median()),
    }
    if len(blind):
        known["runs_wrong_in_the_end_else"] = int(blind.wrong_end.astype(bool).sum())
        known["wrong_frames_else"] = int(blind.wrong_frames.sum())
        known["end_mm_else"] = float(blind.end_mm.median())
    if part.kind.iloc[0] in ("for good", "a while", "from the start", "slipped by"):
        late = ours.wrong_frames - (FROM if part.kind.iloc[0] == "slipped by" else 0)
        known["late_median"], known["late_most"] = float(late.median()), float(late.max())
    if part.kind.iloc[0] in REPORTED:
        known["frames_in_doubt"] = int(ours.doubts.sum())
    return known


def case_rows(case: Case) -> list[dict[str, object]]:
    """The rows of `run` without the columns of the case."""
    rows = run(case["seed"], case["where"], case["how"])
    return [{name: value for name, value in row.items() if name not in case} for row in rows]


def study(n_runs: int, out: Path, workers: Workers) -> dict[str, dict[str, float]]:
    """Run all settings; write identity.csv and identity.json in the folder, runs in `runs` there."""
    cases = [{"where": where, "how": how, "seed": seed} for where, how in SETTINGS for seed in range(n_runs)]
    table = kept_runs(case_rows, cases, out / "runs", workers).drop(columns=list(OWN))
    table_figures = figures(table)
    write_whole(out / "identity.csv", table.to_csv(index=False, float_format="%.4f"))
    write_whole(out / "identity.json", json.dumps(table_figures, indent=1) + "\n")
    return table_figures


@command
def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study and print its figures."""
    parser = study_options(__doc__)
    parser.add_argument("--runs", type=int, default=18)
    given = parser.parse_args(arguments)
    for name, row in study(given.runs, given.out, chosen_workers(given)).items():
        print_figures(f"{name}: ", row, digits=4)


if __name__ == "__main__":
    sys.exit(main())
