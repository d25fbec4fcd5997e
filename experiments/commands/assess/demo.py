"""`softaim demo`."""

from __future__ import annotations

from pathlib import Path

from experiments.commands.options import Force, Out, Vector
from experiments.commands.run import Answer, Run


def demo(run: Run, out: Out = Path("demo"), vector: Vector = None, force: Force = False) -> Answer:
    """Simulate, film and track the two scenarios of the paper, and compare errors with the published ones."""
    from experiments.commands.console import demo_table
    from experiments.studies.demo import demo as done

    with run.folder(out, force=force) as folder:
        figures = done(folder, vector=vector, stage=run.stage)
    pictures = (
        f"Pictures: {out / name / 'path.png'}, error.png, sigma.png, consistency.png beside it" for name in figures
    )
    verdicts = f"All figures, with a verdict for each: {out / 'summary.json'}"
    return Answer({"out": out, "summary": figures}, [demo_table(figures), *pictures, verdicts])
