"""The table of the study: what the filter loses without each mechanism, and which may go."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from experiments.studies.ablation.switches import SWITCHES, TOGETHER, WHOLE

PAGE = Path(__file__).parents[3] / "docs" / "ablation.md"

ERROR, COVERED, FAULTS = 1.03, -2.0, 10
"""A mechanism stays whose absence costs so much: error by the whole filter's [1], coverage [points], faults."""

FIGURES = ["error_m", "covered", "nees", "wrong", "lost", "model_only", "failed"]
"""By these a switch is seen to have an effect."""

HEAD = ("without", "error", "worst", "covered", "worst", "NEES", "time", "faults", "not guiding", "bodies", "lines", "")
WHOLE_HEAD = ("whole filter", "error [mm]", "covered", "NEES", "wrong", "not guiding", "time [s]")


def rows_of(runs: pd.DataFrame) -> pd.DataFrame:
    """A row for each switch, of the runs that there are both with it and of the whole filter.

    error, nees, cpu: geometric means of ratios over bodies [1]; covered: mean change [points]; most, least: of the body
    with the largest ratio of errors and of that with the least change of coverage, with the body's name
    faults: more frames on a wrong estimate or without a finite one, a run that ended early as `FAULTS`; lost: more
    frames that may not guide; changed: bodies on which anything did; bodies: all; verdict
    """
    keyed = runs.set_index(["body", "seed"])
    whole = keyed[keyed["off"] == WHOLE]
    others = keyed[keyed["off"] != WHOLE].groupby("off", sort=False)
    both = [
        (name, own.loc[index], whole.loc[index])
        for name, own in others
        if len(index := whole.index.intersection(own.index))
    ]
    return pd.DataFrame([{"name": name, **_compared(own, before)} for name, own, before in both])


def _compared(own: pd.DataFrame, whole: pd.DataFrame) -> dict[str, object]:
    sound = (own["failed"] == "") & (whole["failed"] == "")
    a, b = (each.loc[sound, ["error_m", "covered", "nees", "cpu_s"]].groupby("body").mean() for each in (own, whole))
    points, by_body = 100.0 * (a["covered"] - b["covered"]), a / b
    ratio, error = np.exp(np.log(by_body).mean()), by_body["error_m"]
    faults, lost = (int((f(own) - f(whole)).sum()) for f in (_faults, lambda runs: runs["lost"]))
    is_so = (own[FIGURES].fillna(-1) != whole[FIGURES].fillna(-1)).any(axis=1)
    stays = ratio["error_m"] >= ERROR or points.mean() <= COVERED or faults >= FAULTS
    found = {"error": ratio["error_m"], "nees": ratio["nees"], "cpu": ratio["cpu_s"], "covered": points.mean()}
    found |= {"most": (error.max(), error.idxmax()), "least": (points.min(), points.idxmin()), "faults": faults}
    found |= {"lost": lost, "changed": is_so.groupby("body").any().sum(), "bodies": len(a)}
    return {**found, "verdict": ("stays" if stays else "may go") if is_so.any() else "no effect"}


def _faults(runs: pd.DataFrame) -> pd.Series:
    return runs["wrong"] + FAULTS * (runs["failed"] != "")


def markdown(runs: pd.DataFrame) -> str:
    """The whole filter's figures, body by body, the table, and the mechanisms that may go, by the lines gained."""
    rows = rows_of(runs).sort_values("error", ascending=False)
    lines = _table(WHOLE_HEAD, (_of_whole(str(body), m) for body, m in _whole(runs).iterrows()))
    lines += ["", *_table(HEAD, (_shown(row) for row in rows.itertuples())), ""]
    single = [SWITCHES[name] for name in rows["name"] if name in SWITCHES]
    lines += [f"- **{one.name}** ({one.kinds.replace(' ', ', ')}): {one.what}." for one in single]
    lines += ["", "May go, by the lines gained:", ""]
    gone = [one for one in single if one.name in set(rows.loc[rows["verdict"] != "stays", "name"])]
    for one in sorted(gone, key=lambda one: -one.lines):
        places = (
            f"{path}:{first}-{last}" + (f" ({n} of them)" if n <= last - first else "")
            for path, first, last, n in one.found
        )
        lines.append(f"- {one.name}, {one.lines}: {'; '.join(places)}")
    return "\n".join(lines) + "\n"


def _whole(runs: pd.DataFrame) -> pd.DataFrame:
    whole = runs[runs["off"] == WHOLE].groupby("body", sort=False)
    return whole[["error_m", "covered", "nees", "wrong", "lost", "cpu_s"]].mean()


def _of_whole(body: str, m: pd.Series) -> tuple[str, ...]:
    shown = f"{1e3 * m.error_m:.3g}", f"{100 * m.covered:.1f} %", f"{m.nees:.2f}"
    return (body, *shown, f"{m.wrong:g}", f"{m.lost:g}", f"{m.cpu_s:.1f}")


def _shown(row: Any) -> tuple[str, ...]:
    lines = sum(SWITCHES[name].lines for name in row.name.split(TOGETHER))
    errors = f"{row.error:.3f}", "{:.2f} {}".format(*row.most)
    covered = f"{row.covered:+.1f}", "{:+.1f} {}".format(*row.least)
    counts = f"{row.faults:+d}", f"{row.lost:+d}", f"{row.changed} of {row.bodies}", str(lines), row.verdict
    return (row.name, *errors, *covered, f"{row.nees:.2f}", f"{row.cpu:.2f}", *counts)


def _table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> list[str]:
    ruled = ("---", *("---:" for _ in head[1:]))
    return ["| " + " | ".join(row) + " |" for row in (head, ruled, *rows)]
