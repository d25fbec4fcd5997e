"""The README's figures, and a short demo that makes a table of the same form."""

import re
from pathlib import Path

import pytest

from experiments.formats.scenario import read_scenario
from experiments.studies.demo import PAPER_MM, SCENARIOS, demo
from experiments.studies.readme import markdown_table

README = Path(__file__).parents[3] / "README.md"


@pytest.fixture(scope="module")
def shown() -> list[str]:
    found = re.search(r"<!-- demo table -->\n(.*)\n<!-- end of demo table -->", README.read_text("utf-8"), re.DOTALL)
    assert found is not None
    return found[1].splitlines()


def numbers(line: str) -> list[float]:
    return [float(x) for x in re.findall(r"\d+\.\d+", line)]


def test_the_figures_are_those_of_the_paper_half_its_error_and_coverages_within_their_spread(shown) -> None:
    *_, published, papers, ours, coverage, spread = (numbers(line) for line in shown)
    assert published[1:] == [x for scenario in SCENARIOS for x in PAPER_MM[scenario]]
    for ours_mm, papers_mm in zip(ours[::2], papers[::2], strict=True):
        assert ours_mm <= 0.5 * papers_mm
    for percent, low, high in zip(coverage, spread[::2], spread[1::2], strict=True):
        assert 90.0 <= low <= percent <= high <= 99.0


@pytest.mark.usefixtures("without_pictures")
def test_a_short_demo_makes_such_a_table(shown, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def short(name):
        return read_scenario(name).model_copy(update={"duration_s": 0.5})

    monkeypatch.setattr("experiments.studies.demo.read_scenario", short)
    figures = demo(tmp_path / "demo", stage=lambda _name: lambda _share: None)
    new = markdown_table(figures, {name: [0.815, 0.98] for name in SCENARIOS}).splitlines()
    assert [re.sub(r"\d+\.\d+", "x", line) for line in new] == [re.sub(r"\d+\.\d+", "x", line) for line in shown]
    assert {path.name for path in (tmp_path / "demo").iterdir()} == {*SCENARIOS, "summary.json"}
