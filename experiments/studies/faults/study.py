"""Runs of all faults with many seeds on all cores, and the table of results."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from experiments.engine.study import KEPT, run_study
from experiments.engine.workers import Workers
from experiments.errors import InputError
from experiments.formats.outputs import write_whole
from experiments.studies.faults.judge import Fault, quiet_folder
from experiments.studies.faults.scripted import ScriptedFault
from experiments.studies.faults.scripts import CAMERA, LOOP, TISSUE
from experiments.studies.faults.system import SYSTEM
from experiments.studies.grid import chosen, grid

_ALL: tuple[Fault, ...] = (ScriptedFault("none", "no fault", 0.0), *CAMERA, *TISSUE, *LOOP, *SYSTEM)

FAULTS: Mapping[str, Fault] = {fault.name: fault for fault in _ALL}
"""All faults by name, in the order of the table."""

ROWS = "faults.csv"
NEVER = float("nan")


def run(case: Mapping[str, Any]) -> dict[str, Any]:
    """Run one fault with one seed; returns a row of the study, in which NaN replaces None."""
    with quiet_folder() as folder:
        row = asdict(FAULTS[case["fault"]].judged(case["seed"], folder))
    return {key: NEVER if value is None else value for key, value in row.items()}


def faults_study(
    only: Sequence[str],
    seeds: Iterable[int],
    folder: Path,
    workers: Workers,
    advance: Callable[[float], None] = lambda _share: None,
    *,
    force: bool = False,
) -> pd.DataFrame:
    """Run faults with all seeds; returns a row for each fault. Raises InputError.

    Runs in real time are done first, one at a time. The folder stores the runs; an interrupted study continues there.
    force: whether the folder may contain files of other programs
    """
    if not force and folder.is_dir() and any(folder.iterdir()) and not (folder / KEPT).is_dir():
        raise InputError.at(folder, "an empty or new folder, or one of this study", "files in it")
    cases = grid(fault=chosen("--only", only, FAULTS), seed=seeds)
    alone = [case for case in cases if FAULTS[case["fault"]].alone]
    if alone:
        run_study(run, alone, folder, Workers(1), lambda share: advance(share * len(alone) / len(cases)))
    found = run_study(run, cases, folder, workers, advance).checked()
    rows = summary(found)
    write_whole(folder / ROWS, rows.to_csv(index=False))
    return rows


def summary(runs: pd.DataFrame) -> pd.DataFrame:
    """A row for each fault: numbers of seeds, detections and recoveries, slowest detection and slowest recovery [ms].

    covered: number of runs without a wrong estimate after the time limit for detection
    go_shown_while_faulty, go: sums over seeds
    sigma_ratio: median over seeds of the ratio `sigma_most_mm / sigma_before_mm`, see `Judged`
    ended: how runs in separate processes ended; lacks_s: largest `Judged.lacks_s` [s]
    """
    rows = []
    for fault in FAULTS.values():
        own = runs[runs["fault"] == fault.name]
        if own.empty:
            continue
        shown = own["shown"][own["shown"] != ""]
        rows.append(
            {
                "fault": fault.name,
                "what": fault.what,
                "seeds": len(own),
                "noticed": int(own["noticed_ms"].notna().sum()),
                "noticed_ms": own["noticed_ms"].max(),
                "within_ms": 1e3 * fault.within_s,
                "covered": int(own["covered"].sum()),
                "shown": shown.mode().iloc[0] if len(shown) else "",
                "sigma_ratio": float((own["sigma_most_mm"] / own["sigma_before_mm"]).median()),
                "recovered": int(own["recovered_ms"].notna().sum()),
                "recovered_ms": own["recovered_ms"].max(),
                "go_shown_while_faulty": int(own["go_shown_while_faulty"].sum()),
                "go": int(own["go"].sum()),
                "ended": "; ".join(sorted(set(own["ended"]))),
                "lacks_s": own["lacks_s"].max(),
            }
        )
    return pd.DataFrame(rows)


HEADS = ("fault", "noticed", "shown", "sigma", "covered", "recovered", "wrong GO", "GO", "ended", "lacks")


def cells(rows: pd.DataFrame) -> list[list[str]]:
    """The table's cells as text, a row for each fault."""
    return [
        [
            f"{row.fault}: {row.what}",
            _delay(row.noticed, row.noticed_ms, row.seeds),
            row.shown or "–",
            f"x {row.sigma_ratio:.1f}" if np.isfinite(row.sigma_ratio) else "–",
            f"{row.covered} of {row.seeds}",
            _delay(row.recovered, row.recovered_ms, row.seeds),
            str(row.go_shown_while_faulty),
            str(row.go),
            row.ended or "–",
            "–" if np.isnan(row.lacks_s) else f"{row.lacks_s:.1f} s",
        ]
        for row in rows.itertuples()
    ]


def by_shown(rows: pd.DataFrame) -> dict[str, list[str]]:
    """Descriptions of faults, grouped by the `beginning` of the text displayed for them (column `shown`)."""
    groups: dict[str, list[str]] = {}
    for row in rows.itertuples():
        notes = [_delay(row.noticed, row.noticed_ms, row.seeds)] if row.noticed else []
        notes += [f"covered {row.covered}/{row.seeds}"] if row.covered < row.seeds else []
        notes += [f"GO wrong {row.go_shown_while_faulty}/{row.go}"] if row.go_shown_while_faulty else []
        one = f"{row.what} ({', '.join(notes)})" if notes else row.what
        groups.setdefault(beginning(row.shown) or "no report", []).append(one)
    return groups


def beginning(shown: str) -> str:
    """Status and reason, the first two parts of a displayed text; only the status if the reason repeats it."""
    status, *rest = re.split(": |; ", shown)
    return status if not rest or rest[0].endswith(status) else f"{status}: {rest[0]}"


def _delay(n: int, slowest_ms: float, seeds: int) -> str:
    if not n:
        return "never"
    return f"{slowest_ms:.0f} ms" if n == seeds else f"{slowest_ms:.0f} ms, {n} of {seeds}"


def markdown(rows: pd.DataFrame) -> str:
    """The list of docs/faults.md, and a line with the numbers of wrong displays of GO and of all displays of GO."""
    lines = [f"- **{shown}**: {'; '.join(own)}\n" for shown, own in by_shown(rows).items()]
    return "".join(lines) + f"\nGO wrong: {rows['go_shown_while_faulty'].sum()} of {rows['go'].sum():,}.\n"
