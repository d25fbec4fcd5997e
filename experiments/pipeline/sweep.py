"""Grids of simulated runs: what `softaim sweep` does.

For each combination of the grid's values and each seed, truth and marks are simulated, and all methods track the marks.
Random errors of the marks depend only on the seed, so that combinations differ only by the grid's values.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from dynamics import KINDS, MassSpringNetwork, parameters, scale_parameters
from experiments.engine.runs import KEY_DIGITS, Case, program
from experiments.engine.study import Study, run_study
from experiments.engine.workers import Workers
from experiments.errors import InputError, placed, read_text, shown
from experiments.formats.outputs import write_whole
from experiments.formats.page import markdown_table
from experiments.formats.scenario import Scenario, SeenMarks, completed
from experiments.formats.scene.filter import settings_of
from experiments.formats.scene.scene import Scene, scene_of_tables
from experiments.formats.scene.schema import FilterTable, SceneError, SceneFile
from experiments.formats.sweep_file import MOTION, Sweep
from experiments.formats.toml_file import VERSION, validated
from experiments.pipeline.compare import compare, method_names, summary
from experiments.pipeline.line import OPEN_LOOP
from experiments.simulation.forces import start_and_forces
from experiments.simulation.seen_marks import Truth, seen_marks
from experiments.simulation.simulate import kept_motion, scene_of, true_motion, true_network

SCENE = "scene.toml"
STUDY, RUNS_CSV, SUMMARY_CSV, SUMMARY_MD, TRUTHS = "study.toml", "runs.csv", "summary.csv", "summary.md", "truths"

CHECKED_S = 1.0
"""To find faulty settings before all runs, the forces of each scenario are computed for at most this duration [s]."""


def cases_of(sweep: Sweep) -> list[dict[str, Any]]:
    """A case for each seed and each combination of the grid's values. Raises InputError for a case that cannot run."""
    for k, name in enumerate(sweep.methods):
        if name not in method_names():
            raise InputError.at(f"{sweep.path}: methods[{k}]", f"one of {', '.join(method_names())}", shown(name))
    text = None if sweep.scene is None else read_text(sweep.scene)
    cases, checked = [], set()
    for setup in sweep.setups:
        true = true_scene(text, setup.scenario, str(sweep.scene))
        scenario = _motion_of(setup.scenario, true, text, sweep)
        if (name := json.dumps(scenario)) not in checked:
            _check_forces(true, Scenario.model_validate(scenario), sweep)
            checked.add(name)
        if setup.filter.led_nodes:
            try:
                assumed_scene(true, {}, setup.filter, text)
            except SceneError as fault:
                raise InputError(f"{sweep.path}: grid.{fault}") from None
        table = {
            "scenario": scenario,
            "filter": setup.filter.model_dump(exclude_unset=True),
            "marks": setup.marks.model_dump(),
            "model": setup.model.model_dump(exclude_unset=True),
            "methods": list(sweep.methods),
            "scene": text,
        }
        at = {key: _column(value) for key, value in setup.at.items()}
        cases += [{**at, "seed": seed, "setup": table} for seed in sweep.seeds]
    return cases


def _motion_of(scenario: Scenario, true: Scene, text: str | None, sweep: Sweep) -> dict[str, Any]:
    """The tables and keys of a scenario that determine the motion; the file name of the scene is not among them."""
    if true.network.continuum is not None:
        raise InputError.at(f"{sweep.path}: scene", "a network of springs", "a mesh")
    with placed(sweep.path, InputError):
        complete = completed(scenario, true.network, true.measured_nodes, "scenario")
    tables = complete.model_dump(exclude_unset=True, exclude_none=True)
    if text is None:
        return tables
    return {"version": VERSION, "scene": SCENE, **{key: tables[key] for key in MOTION if key in tables}}


def _column(value: Any) -> str | int | float:
    return value if isinstance(value, str | int | float) else json.dumps(value)


def _check_forces(true: Scene, scenario: Scenario, sweep: Sweep) -> None:
    """Raise InputError if the scenario's forces do not fit the tissue; called before all runs."""
    with placed(sweep.path, InputError):
        brief = scenario.model_copy(update={"duration_s": min(scenario.duration_s, CHECKED_S)})
        start_and_forces(true.network, brief, np.random.default_rng(0))


@lru_cache(maxsize=8)
def _tables(text: str, name: str) -> SceneFile:
    return validated(tomllib.loads(text), SceneFile, f"{name}: ")


def true_scene(text: str | None, scenario: Scenario, name: str = "scene") -> Scene:
    """The scene in a scene file's `text`, or the phantom of the scenario if `text` is None. Cameras are omitted."""
    if text is None:
        return replace(scene_of(scenario), cameras=())
    return scene_of_tables(_tables(text, name).model_copy(update={"camera": []}), Path(name))


def assumed_scene(true: Scene, factors: Mapping[str, float], changed: FilterTable, text: str | None) -> Scene:
    """The scene that methods use; factors: multiply the constants, by kind; changed: values that replace `[filter]`."""
    own = None if text is None else _tables(text, "scene").filter
    table = (own or FilterTable()).model_copy(update=changed.model_dump(exclude_unset=True))
    return replace(true, network=assumed_network(true.network, factors), settings=settings_of(table))


def assumed_network(network: MassSpringNetwork, factors: Mapping[str, float]) -> MassSpringNetwork:
    """A copy of the network in which each constant is multiplied by the factor of its kind."""
    which = parameters(network, tuple(kind for kind in KINDS if kind in factors))
    return scale_parameters(network, which, [np.log(factors[one.kind]) for one in which])


def motion_of(scenario: Scenario, text: str | None, seed: int, truths: Path | None) -> Truth:
    """The simulated motion for a scenario, the text of a scene file and a seed; truths: folder that caches motions."""
    network, rng = true_scene(text, scenario).network, np.random.default_rng([seed, 1])
    network = true_network(network, scenario, seed)
    if truths is None:
        return true_motion(network, scenario, rng)
    name = json.dumps([scenario.model_dump(), text, seed], sort_keys=True)
    key = hashlib.sha256(name.encode("utf-8")).hexdigest()[:KEY_DIGITS]
    return kept_motion(truths / f"{key}.npy", network, scenario, rng)


def swept_rows(case: Case, truths: Path | None = None) -> list[dict[str, Any]]:
    """A row for each method in one run: the figures of `softaim compare`, and `by_open_loop`.

    by_open_loop: the method's mean error divided by the mean error of the open loop
    truths: folder in which runs on this machine cache and share simulated motions
    """
    setup, seed = case["setup"], case["seed"]
    scenario, text = Scenario.model_validate(setup["scenario"]), setup["scene"]
    motion = motion_of(scenario, text, seed, truths)
    true = true_scene(text, scenario)
    given = assumed_scene(true, setup["model"], FilterTable(**setup["filter"]), text)
    marks = SeenMarks.model_validate(setup["marks"])
    recording = seen_marks(true, motion, marks, np.random.default_rng([seed, 2]))
    figures = summary(compare(replace(recording, scene=given), setup["methods"]))
    paper = figures[OPEN_LOOP]["mae_mm"]
    return [
        {"method": method, **row, "by_open_loop": row["mae_mm"] / paper if row["mae_mm"] and paper else None}
        for method, row in figures.items()
    ]


def run_sweep(
    sweep: Sweep,
    folder: Path,
    workers: Workers,
    advance: Callable[[float], None] = lambda _share: None,
    *,
    force: bool = False,
) -> tuple[Study, pd.DataFrame]:
    """Do all runs that the folder does not have yet; write runs.parquet, runs.csv, summary.csv and summary.md to it.

    Returns the runs, and the summary of `summarised`.
    force: whether the folder may have other files. If the input is invalid, InputError is raised before the first run.
    """
    cases = cases_of(sweep)
    _check_folder(folder, force)
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / STUDY, read_text(sweep.path))
    truths = folder.resolve() / TRUTHS / program()
    done = run_study(partial(swept_rows, truths=truths), cases, folder, workers, advance)
    shutil.rmtree(folder / TRUTHS, ignore_errors=True)
    table = summarised(done.table, sweep)
    write_whole(folder / RUNS_CSV, done.table.to_csv(index=False, float_format="%.9g"))
    write_whole(folder / SUMMARY_CSV, table.to_csv(index=False, float_format="%.6g"))
    write_whole(folder / SUMMARY_MD, markdown(table))
    return done, table


def _check_folder(folder: Path, force: bool) -> None:
    if folder.exists() and not folder.is_dir():
        raise InputError.at(folder, "a folder", "a file")
    if not force and folder.is_dir() and any(folder.iterdir()) and not (folder / STUDY).is_file():
        raise InputError.at(folder, "a new folder or that of a sweep", "other files in it; --force adds to them")


def summarised(runs: pd.DataFrame, sweep: Sweep) -> pd.DataFrame:
    """A row for each combination and method, in the grid's order, with counts of runs and failures, and with figures.

    mae_mm, coverage95, mean_nees, frames_lost: means over runs; rmse_mm: rms error over the frames of all runs
    by_open_loop: mean error divided by the open loop's mean error; ms_per_frame: median over runs
    """
    keys = list(sweep.keys)
    rows = []
    for setup in sweep.setups:
        at = {key: _column(value) for key, value in setup.at.items()}
        own = runs
        for key, value in at.items():
            own = own[own[key] == value]
        failed = int(own["failure"].notna().sum())
        done = own[own["failure"].isna()]
        if done.empty:
            rows.append({**at, "method": "", "runs": 0, "failed": failed})
            continue
        paper = done[done["method"] == OPEN_LOOP]["mae_mm"].mean()
        for method, part in done.groupby("method", sort=False):
            figures = {name: float(part[name].mean()) for name in ("mae_mm", "coverage95", "mean_nees", "frames_lost")}
            figures |= {
                "rmse_mm": float(np.sqrt((part["rmse_mm"] ** 2).mean())),
                "by_open_loop": figures["mae_mm"] / paper,
                "ms_per_frame": float(part["ms_per_frame"].median()),
            }
            rows.append({**at, "method": method, "runs": len(part), "failed": failed, **figures})
    return pd.DataFrame(rows, columns=[*keys, "method", "runs", "failed", *FORMS])


FORMS = {
    "mae_mm": ("mean error [mm]", ".2f"),
    "rmse_mm": ("RMSE [mm]", ".2f"),
    "by_open_loop": ("error / open loop", ".2f"),
    "coverage95": ("in 95 % region", ".1%"),
    "mean_nees": ("mean NEES", ".2f"),
    "frames_lost": ("frames lost", ".1f"),
    "ms_per_frame": ("ms/frame", ".2f"),
}
"""Heading and number format of each figure in a summary."""


def cells(table: pd.DataFrame) -> list[list[str]]:
    """The cells of a summary as text, headings first. A key of the grid that has only one value is omitted."""
    names = [str(name) for name in table.columns if "." not in name or len(set(table[name])) > 1]
    forms = [FORMS.get(name, (name, None)) for name in names]
    rows = [
        [_cell(row[name], form) for name, (_, form) in zip(names, forms, strict=True)] for _, row in table.iterrows()
    ]
    return [[head for head, _ in forms], *rows]


def _cell(value: Any, form: str | None) -> str:
    if form is None:
        return f"{value:g}" if isinstance(value, float) else str(value)
    return "–" if pd.isna(value) else format(value, form)


def markdown(table: pd.DataFrame) -> str:
    """The summary as a Markdown table."""
    heads, *rows = cells(table)
    return markdown_table(heads, rows, left=range(len(heads)))
