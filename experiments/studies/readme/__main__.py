"""Rewrite the README's figures and the demo's pictures: `python -m experiments.studies.readme` in the checkout.

It takes about ten minutes. Comments enclose the figures in the README. The test
`tests/experiments/studies/readme/test_readme.py` runs a short demo and compares its figures with those of the README.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from experiments.formats.page import markdown_table, rewrite_page
from experiments.pipeline.line import FILTER, OPEN_LOOP
from experiments.pipeline.track import figures as figures_of
from experiments.studies.demo import PAPER_MM, SCENARIOS, Figures, demo, heads, tracked
from experiments.studies.hidden_error import N_RUNS, SEEDS, study
from experiments.studies.readme.moving_picture import PICTURE, write_moving_picture

ROOT = Path(__file__).parents[3]
PICTURES = ("path.png", "error.png", "sigma.png")
DEMO_SEEDS = range(1, 6)
"""Seeds of the README's coverage; choice: a seed takes a minute per scenario. The demo itself has one seed."""


def coverages(seeds: Sequence[int] = DEMO_SEEDS) -> dict[str, list[float]]:
    """For each scenario of the demo, the coverage of the 95 % region with each seed."""
    found: dict[str, list[float]] = {}
    for name in SCENARIOS:
        for seed in seeds:
            with tempfile.TemporaryDirectory() as folder:
                of_filter = figures_of(tracked(name, Path(folder) / "recording", seed), FILTER)
            found.setdefault(name, []).append(float(of_filter["coverage95"] or 0.0))
    return found


def demo_table(figures: Figures, spread: Mapping[str, Sequence[float]]) -> str:
    """The demo's table for the README; spread: result of `coverages`."""

    def errors(method: str) -> list[str]:
        found = [figures[name][method] for name in figures]
        return [f"{one['mae_mm']:.2f} ± {one['sd_mm']:.2f}" for one in found]

    covered = [100 * (figures[name][FILTER]["coverage95"] or 0.0) for name in figures]
    rows = {
        "as published, one frame every 1.09 s": [f"{PAPER_MM[s][0]:.2f} ± {PAPER_MM[s][1]:.2f}" for s in figures],
        "the paper's method on our frames": errors(OPEN_LOOP),
        "Softaim's filter on the same frames": errors(FILTER),
        "truth inside the filter's 95 % region": [f"{share:.1f} %" for share in covered],
        f"the same over seeds {DEMO_SEEDS[0]} to {DEMO_SEEDS[-1]}": [
            f"{100 * min(spread[name]):.1f} to {100 * max(spread[name]):.1f} %" for name in figures
        ],
    }
    head = ["mean absolute error ± SD of the hidden mass [mm]", *heads()]
    return markdown_table(head, [[label, *cells] for label, cells in rows.items()])


def figure_rows(studies: dict[str, dict[str, float]]) -> str:
    """The README's table of the filter's error ratio and coverage; studies: results of `study` by scenario."""
    ratios = ", ".join(f"{study['ratio']:.2f} {name}" for name, study in studies.items())
    covered = ", ".join(f"{study['coverage95']:.1%} {name}" for name, study in studies.items())
    command = "`python -m experiments.studies.hidden_error`"
    what = f"filter error / open-loop error; mark noise 4.14 mm per axis, 30 frames/s, {N_RUNS} runs"
    rows = [[what, ratios, command], ["truth inside the filter's 95 % region", covered, "the same"]]
    return markdown_table(["figure", "value", "command"], rows, left=(0, 1, 2))


def main() -> None:
    """Run the demo and the study of the hidden mass; write the pictures to docs/images, and the README's figures."""
    with tempfile.TemporaryDirectory() as folder:
        figures = demo(Path(folder) / "demo", stage=lambda _name: lambda _share: None)
        images = ROOT / "docs" / "images"
        images.mkdir(exist_ok=True)
        for name in PICTURES:
            shutil.copyfile(Path(folder) / "demo" / "poked" / name, images / f"poked-{name}")
    write_moving_picture(PICTURE)
    studies = {name: study(name, SEEDS) for name in SCENARIOS}
    parts = {"demo table": demo_table(figures, coverages()), "figures": figure_rows(studies)}
    rewrite_page(ROOT / "README.md", parts)


if __name__ == "__main__":
    main()
