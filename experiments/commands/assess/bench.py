"""`softaim bench`."""

from __future__ import annotations

import json

from experiments.commands.options import AsJson
from experiments.commands.terminal import print_table, progress


def bench(
    as_json: AsJson = False,
) -> None:
    """Time the filter and the loop against their references, in one run."""
    from experiments.commands.console import bench_table
    from experiments.studies.bench import bench as run

    with progress() as stage:
        report = run(stage("bench"))
    if as_json:
        print(json.dumps(report, indent=2))
    else:
        print_table(bench_table(report))
