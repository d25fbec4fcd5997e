"""Error of the hidden mass for the paper's method and for the filter, with true constants.

Reproduces the comparison in [paper] section IV at a camera's frame rate, 30 frames/s. The marks have the paper's noise:
"4.14 ± 1.47 mm". The study uses a standard deviation of 4.14 mm on each axis. SciPy's RK45 computes the truth.
`python -m experiments.studies.hidden_error` prints figures of 20 runs of 20 s (latest figures in README.md).
"""

from __future__ import annotations

import argparse
import tempfile
from functools import partial
from pathlib import Path

import pandas as pd

from experiments.studies.estimation.study import figures, row_of
from experiments.studies.estimation.trials import Model, Trial, run
from experiments.studies.grid import print_figures, runs_of, study_options

N_RUNS = 20
SEEDS = range(100, 100 + N_RUNS)


def study(scenario: str, seeds: range, given: argparse.Namespace | None = None) -> dict[str, float]:
    """Run a scenario with all seeds; returns `experiments.studies.estimation.study.figures`. given: see `runs_of`."""
    with tempfile.TemporaryDirectory() as cache:
        done = runs_of(partial(run, model=Model(), cache=Path(cache)), [Trial(scenario, k) for k in seeds], given)
    return figures(pd.DataFrame([row_of(one) for one in done]))


def main() -> None:
    """Print the figures of the scenarios `quiet` and `poked`."""
    given = study_options(__doc__, out=False).parse_args()
    for scenario in ("quiet", "poked"):
        print_figures(f"{scenario:8}", study(scenario, SEEDS, given))


if __name__ == "__main__":
    main()
