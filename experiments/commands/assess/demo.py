"""`softaim demo`."""

from __future__ import annotations

from pathlib import Path

from experiments.commands.options import Force, Out
from experiments.commands.terminal import print_table, progress


def demo(out: Out = Path("demo"), force: Force = False) -> None:
    """Simulate, film and track the paper's two scenarios, and compare with what the paper found."""
    from experiments.commands.console import demo_table
    from experiments.studies.demo import demo as run

    with progress() as stage:
        figures = run(out, force=force, stage=stage)
    print_table(demo_table(figures))
    for scenario in figures:
        print(f"Pictures: {out / scenario / 'path.png'}, error.png, sigma.png, consistency.png beside it")
