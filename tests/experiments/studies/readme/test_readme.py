"""The README's figures against a new demo."""

import re
from pathlib import Path

import pytest

from experiments.studies.demo import PAPER_MM, SCENARIOS, demo
from experiments.studies.readme.__main__ import markdown_table

SPREAD = {name: [0.815, 0.98] for name in SCENARIOS}
"""In place of the coverage over seeds, ten minutes of work."""

README = Path(__file__).parents[4] / "README.md"


def pairs(values: list[float]) -> list[tuple[float, float]]:
    return list(zip(values[::2], values[1::2], strict=True))


def numbers(table: str) -> list[float]:
    return [float(x) for x in re.findall(r"\d+\.\d+", table)]


@pytest.mark.slow
@pytest.mark.usefixtures("without_pictures")
def test_the_table_in_the_readme_is_what_the_demo_gives(tmp_path: Path) -> None:
    figures = demo(tmp_path / "demo", stage=lambda _name: lambda _share: None)
    shown = re.search(r"<!-- demo table -->\n(.*)\n<!-- end of demo table -->", README.read_text("utf-8"), re.DOTALL)
    assert shown is not None
    *errors, coverage, spread = shown[1].splitlines()
    *new_errors, new_coverage, _ = markdown_table(figures, SPREAD).splitlines()
    assert errors[0] == new_errors[0]  # the seeds
    # Seeds fix the films; the last digits of sums and of a codec may differ from machine to machine.
    assert numbers("\n".join(errors)) == pytest.approx(numbers("\n".join(new_errors)), rel=0.1, abs=0.02)
    # In points: a change of the filter is to be followed by a new table.
    assert numbers(coverage) == pytest.approx(numbers(new_coverage), abs=1.0)
    for percent, (low, high) in zip(numbers(coverage), pairs(numbers(spread)), strict=True):
        assert low <= percent <= high
    assert all(f"{mean:.2f} ± {sd:.2f}" in shown[1] for mean, sd in PAPER_MM.values())
    for scenario in SCENARIOS:
        ours, papers = figures[scenario]["filter"], figures[scenario]["open-loop"]
        assert ours["mae_mm"] <= 0.5 * papers["mae_mm"]
        assert 0.90 <= ours["coverage95"] <= 0.99
