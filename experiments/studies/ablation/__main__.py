"""What each mechanism of the filter is worth: the same recordings with one of them turned off at a time.

    python -m experiments.studies.ablation --out FOLDER --lungs LUNGS      # --page writes docs/ablation.md
    python -m experiments.studies.ablation --out FOLDER --only outliers --bodies phantom

LUNGS is a folder as for `experiments.studies.lungs`. A study that was ended goes on in its folder, seed by seed.
Last figures: docs/ablation.md.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from estimators import Status
from estimators.process.target import target_map
from experiments.engine.progress import run_bar
from experiments.engine.study import run_study
from experiments.engine.workers import add_worker_options, chosen_workers
from experiments.errors import InputError
from experiments.formats.outputs import write_whole
from experiments.formats.page import rewrite_page
from experiments.studies.ablation.recordings import BODIES, LUNG, recording
from experiments.studies.ablation.switches import SWITCHES, WHOLE
from experiments.studies.zoo.scores import hidden_scores

PAGE = Path(__file__).parents[3] / "docs" / "ablation.md"

FIRST_SEED = 830
"""No prior was chosen on seeds from here on."""

HEAD = ("without", "error", "worst", "covered", "worst", "bodies", "lines")
WHOLE_HEAD = (WHOLE, "error [mm]", "covered", "NEES")

FIGURES = ["error_m", "covered", "nees", "lost", "failed"]
"""By these a mechanism is seen to have an effect."""


def run(case: Mapping[str, Any]) -> dict[str, Any]:
    """The figures of a body by the filter without the mechanism `off`.

    error_m: mean over hidden points and frames; covered, nees: by the region of 95 %, and by the dimension
    lost: frames that are not TRACKING; failed: why it ended early, whose other figures are those until then
    """
    given, switch = recording(case["body"], case["seed"], case["lungs"]), SWITCHES[case["off"]]
    means, covs, tracking, failed = [], [], [], ""
    try:
        with switch.patched():
            tissue = switch.filter(given)
            maps = [target_map(given.network, one) for one in given.targets]
            for time_s, marks in given.frames:
                tissue.predict(time_s)
                tracking.append(tissue.update(marks).status is Status.TRACKING)
                places = [tissue.place_of(one) for one in maps]
                means.append([mean for mean, _ in places])
                covs.append([cov for _, cov in places])
    except (ArithmeticError, ValueError) as error:  # whatever a filter raises is a result of the study
        failed = f"{type(error).__name__}: {error}"
    n, dim = len(means), given.network.dim
    read = np.array(covs) + given.read_sd_m**2 * np.eye(dim)
    size_m = float(np.ptp(given.network.positions, axis=0).max())
    found = hidden_scores(np.array(means), read, given.truth[:n], tracking=np.array(tracking[:n]), size_m=size_m)
    figures = {name: found[name] for name in ("error_m", "covered", "nees")}
    return {**figures, "frames": n, "lost": n - sum(tracking[:n]), "failed": failed}


def compared(runs: pd.DataFrame) -> pd.DataFrame:
    """A row for each mechanism: error by the whole filter's, geometric mean [1], and mean change of coverage [points].

    Over the bodies on which anything changed, `changed` of all `bodies`.

    most, least: of the body with the largest ratio and of that with the least change, with its name
    failed: runs that ended early
    """
    keyed = runs.set_index(["body", "seed"])
    whole, rows = keyed[keyed["off"] == WHOLE], []
    for name, own in keyed[keyed["off"] != WHOLE].groupby("off", sort=False):
        before = whole.loc[own.index]
        is_so = (own[FIGURES] != before[FIGURES]).any(axis=1).groupby("body").any()
        counted = is_so | (not is_so.any())
        a, b = (each[["error_m", "covered"]].groupby("body").mean()[counted] for each in (own, before))
        ratio, points = a["error_m"] / b["error_m"], 100.0 * (a["covered"] - b["covered"])
        found = {"name": name, "error": np.exp(np.log(ratio).mean()), "covered": points.mean()}
        found |= {"most": (ratio.max(), ratio.idxmax()), "least": (points.min(), points.idxmin())}
        found |= {"changed": is_so.sum(), "bodies": len(is_so), "failed": (own["failed"] != "").sum()}
        rows.append(found)
    return pd.DataFrame(rows)


def markdown(runs: pd.DataFrame) -> str:
    """The whole filter's figures, body by body, and the table of mechanisms, the most valuable first."""
    whole = runs[runs["off"] == WHOLE].groupby("body", sort=False)[["error_m", "covered", "nees"]]
    lines = _table(WHOLE_HEAD, (_of_whole(str(body), m) for body, m in whole.mean().iterrows()))
    rows = compared(runs).sort_values("error", ascending=False)
    return "\n".join([*lines, "", *_table(HEAD, (_shown(row) for row in rows.itertuples()))]) + "\n"


def _of_whole(body: str, m: pd.Series) -> tuple[str, ...]:
    return body, f"{1e3 * m.error_m:.3g}", f"{100 * m.covered:.1f} %", f"{m.nees:.2f}"


def _shown(row: Any) -> tuple[str, ...]:
    errors = f"{row.error:.3f}", "{:.2f} {}".format(*row.most)
    covered = f"{row.covered:+.1f}", "{:+.1f} {}".format(*row.least)
    bodies = f"{row.changed} of {row.bodies}" + (f", {row.failed} runs ended early" if row.failed else "")
    return (row.name, *errors, *covered, bodies, str(SWITCHES[row.name].lines))


def _table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> list[str]:
    ruled = ("---", *("---:" for _ in head[1:]))
    return ["| " + " | ".join(row) + " |" for row in (head, ruled, *rows)]


def main(arguments: Iterable[str] | None = None) -> int:
    """Do the runs that the folder does not have yet, and write the table; the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m experiments.studies.ablation", description=(__doc__ or "").split("\n", maxsplit=1)[0]
    )
    parser.add_argument("--out", type=Path, required=True, help="a study that was ended goes on")
    parser.add_argument("--only", action="append", default=[], help="a mechanism; again for more; default: all")
    parser.add_argument("--bodies", action="append", default=[], help="a body; again for more; default: all")
    parser.add_argument("--seeds", type=int, default=1, help=f"runs of each body, from {FIRST_SEED} on: %(default)s")
    parser.add_argument("--lungs", type=Path, help="folder of case1.csv and others; default: no lungs")
    parser.add_argument("--page", action="store_true", help="rewrite the tables of docs/ablation.md")
    add_worker_options(parser)
    given = parser.parse_args(None if arguments is None else list(arguments))
    bodies = [*BODIES] if given.lungs is None else [*BODIES, LUNG]
    try:
        for option, chosen, known in (("--only", given.only, SWITCHES), ("--bodies", given.bodies, bodies)):
            for name in chosen:
                if name not in known:
                    raise InputError.at(option, f"one of {', '.join(known)}", name)
        cases = [
            {"body": body, "seed": seed, "off": off, "lungs": str(given.lungs)}
            for body in given.bodies or bodies
            for seed in range(FIRST_SEED, FIRST_SEED + (1 if body == LUNG else given.seeds))
            for off in dict.fromkeys([WHOLE, *(given.only or SWITCHES)])
        ]
        with run_bar("ablation") as advance:
            page = markdown(run_study(run, cases, given.out, chosen_workers(given), advance).checked())
    except InputError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    write_whole(given.out / "table.md", page)
    sys.stdout.write(page)
    if given.page:
        rewrite_page(PAGE, {"ablation table": page})
    return 0


if __name__ == "__main__":
    sys.exit(main())
