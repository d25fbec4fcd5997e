"""The README's figures, and the table of a short demo."""

import re
from pathlib import Path

import pytest

from experiments.formats.scenario import read_scenario
from experiments.studies import demo as demo_of
from experiments.studies.demo import PAPER_MM, SCENARIOS, demo
from experiments.studies.readme.__main__ import demo_table

SPREAD = {name: [0.815, 0.98] for name in SCENARIOS}
"""In place of the coverage over seeds, ten minutes of work."""

README = Path(__file__).parents[4] / "README.md"


def pairs(values: list[float]) -> list[tuple[float, float]]:
    return list(zip(values[::2], values[1::2], strict=True))


def numbers(table: str) -> list[float]:
    return [float(x) for x in re.findall(r"\d+\.\d+", table)]


@pytest.mark.slow
@pytest.mark.usefixtures("without_pictures")
def test_the_table_in_the_readme_is_of_the_demo(tmp_path: Path, monkeypatch) -> None:
    """Films of 3 s in place of 20: the heads are the README's, errors within a factor of two of those there."""
    short = {name: read_scenario(name).model_copy(update={"duration_s": 3.0}) for name in SCENARIOS}
    monkeypatch.setattr(demo_of, "read_scenario", short.__getitem__)
    figures = demo(tmp_path / "demo", stage=lambda _name: lambda _share: None)
    shown = re.search(r"<!-- demo table -->\n(.*)\n<!-- end of demo table -->", README.read_text("utf-8"), re.DOTALL)
    assert shown is not None
    *errors, coverage, spread = shown[1].splitlines()
    *new_errors, new_coverage, _ = demo_table(figures, SPREAD).splitlines()
    assert errors[:3] == new_errors[:3]  # the seeds and the paper's figures
    for ours, new in zip(errors[3:], new_errors[3:], strict=True):
        means, new_means = numbers(ours)[::2], numbers(new)[::2]
        assert all(0.5 < one / other < 2.0 for one, other in zip(means, new_means, strict=True))
    assert len(numbers(coverage)) == len(numbers(new_coverage))
    for percent, (low, high) in zip(numbers(coverage), pairs(numbers(spread)), strict=True):
        assert low <= percent <= high
    assert all(f"{mean:.2f} ± {sd:.2f}" in shown[1] for mean, sd in PAPER_MM.values())
    for scenario in SCENARIOS:
        ours, papers = figures[scenario]["filter"], figures[scenario]["open-loop"]
        assert ours["mae_mm"] <= 0.5 * papers["mae_mm"]
        assert 0.90 <= ours["coverage95"] <= 0.99
