"""The README's figures against a new demo."""

import re
from pathlib import Path

import pytest

from experiments.studies.demo import PAPER_MM, SCENARIOS, demo
from experiments.studies.readme import markdown_table

README = Path(__file__).parents[3] / "README.md"


def numbers(table: str) -> list[float]:
    return [float(x) for x in re.findall(r"\d+\.\d+", table)]


@pytest.mark.slow
@pytest.mark.usefixtures("without_pictures")
def test_the_table_in_the_readme_is_what_the_demo_gives(tmp_path: Path) -> None:
    figures = demo(tmp_path / "demo", stage=lambda _name: lambda _share: None)
    shown = re.search(r"<!-- demo table -->\n(.*)\n<!-- end of demo table -->", README.read_text("utf-8"), re.DOTALL)
    assert shown is not None
    # Seeds fix the films; the last digits of sums and of a codec may differ from machine to machine.
    assert numbers(shown[1]) == pytest.approx(numbers(markdown_table(figures)), rel=0.1, abs=0.02)
    assert all(f"{mean:.2f} ± {sd:.2f}" in shown[1] for mean, sd in PAPER_MM.values())
    for scenario in SCENARIOS:
        ours, papers = figures[scenario]["filter"], figures[scenario]["open-loop"]
        assert ours["mae_mm"] <= 0.5 * papers["mae_mm"]
        assert 0.90 <= ours["coverage95"] <= 0.99
