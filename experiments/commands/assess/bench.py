"""`softaim bench`."""

from __future__ import annotations

from experiments.commands.run import Answer, Run


def bench(run: Run) -> Answer:
    """Measure the speed of the filter, the live loop and reference implementations."""
    from experiments.commands.console import bench_table
    from experiments.studies.bench import bench as measured

    report = measured(run.stage("bench"))
    return Answer(report, [bench_table(report)])
