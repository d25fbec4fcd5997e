"""The quick form of the zoo, its constants, its tables, its options."""

import json
from dataclasses import asdict

import numpy as np
import pandas as pd
import pytest

from experiments.simulation.bodies.zoo import make_body
from experiments.studies.zoo.__main__ import main
from experiments.studies.zoo.case import Case, cases, quick_cases
from experiments.studies.zoo.constants import wrong_network
from experiments.studies.zoo.run import run
from experiments.studies.zoo.table import cells_of, faults, markdown, page_tables


@pytest.fixture(autouse=True)
def _not_timed(monkeypatch):
    """Code need not be loaded before the runs: their time is not tested."""
    monkeypatch.setattr("experiments.studies.zoo.run.compile_kernels", lambda: None)


def table(*rows):
    return pd.DataFrame([{**asdict(Case("sheet", k)), **record(**row)} for k, row in enumerate(rows)])


def record(**figures):
    plain = {"failure": None, "ended": "", "frames_done": 10, "ms_a_frame": 1.0, "covered": 0.95, "nees": 1.0}
    plain |= {"error_m": 1e-3, "open_loop_m": 2e-3, "spline_m": 4e-3}
    return plain | dict.fromkeys(("non_finite", "wrong_tracking", "repairs"), 0) | figures


def test_a_cell_is_rated_by_the_better_of_its_references():
    (cell,) = cells_of(table({}, {"open_loop_m": 6e-3, "spline_m": 2e-3}))
    assert (cell.open_loop_mm, cell.spline_mm, cell.ratio) == pytest.approx((4.0, 3.0, 1.0 / 3.0))
    assert faults(cell) == []


@pytest.mark.parametrize(
    ("figures", "fault"),
    [
        ({"error_m": 2.2e-3}, "ratio"),
        ({"covered": 0.89}, "covered"),
        ({"covered": 0.995}, "covered"),
        ({"non_finite": 1}, "non-finite"),
        ({"wrong_tracking": 1}, "tracking"),
        ({"failure": "KilledWorker"}, "1 of 1 failed"),
        ({"ended": "stopped"}, "1 of 1 failed"),
    ],
)
def test_each_bound_is_held_to(figures, fault):
    assert faults(cells_of(table(figures))[0]) == [fault]


def test_what_may_be_anywhere_is_not_covered_too_well():
    chain = asdict(Case("chain2", 0, size=10.0))
    assert faults(cells_of(pd.DataFrame([chain | record(covered=0.995)]))[0]) == []
    assert faults(cells_of(pd.DataFrame([chain | record(covered=0.89)]))[0]) == ["covered"]


def test_wrong_constants_have_wider_bounds():
    assert faults(cells_of(table({"constants": "wrong", "covered": 0.86, "error_m": 2.25e-3}))[0]) == []


def test_a_cell_that_made_nothing_is_in_the_table_with_its_reason():
    (cell,) = cells_of(pd.DataFrame([{**asdict(Case("sheet", 0)), "ended": "no rest", "frames_done": 0}]))
    assert cell.ratio is None
    assert "no rest" in markdown([cell])


def test_the_page_has_a_row_for_each_body_with_the_extremes_of_its_scaled_cells():
    others = [{"constants": "identified", "covered": 0.92}, {"size": 0.1, "error_m": 1.9e-3, "covered": 0.91}]
    bodies, summary = page_tables(cells_of(table({}, *others, {"size": 10.0, "covered": 0.98}))).split("\n\n")
    assert bodies.splitlines()[2:] == ["| sheet | 1, 1 | 0.5, 0.5 | 95.0, 92.0 | 0.95 | 91.0 to 98.0 |"]
    assert summary.startswith("- true constants: 3 of 3 cells within all bounds; ratio: geometric mean 0.62")
    assert "worst 0.95 (bound 1.05), sheet, size x 0.1" in summary


def test_wrong_constants_scatter_by_a_fifth_and_rest_where_drawn():
    body = make_body("block27", 0, seconds=0.1)
    wrong = wrong_network(body, np.random.default_rng(0))
    logs = np.log(wrong.stiffness / body.network.stiffness)
    assert logs.std() == pytest.approx(np.log(1.2), rel=0.2)
    assert np.abs(wrong.positions - body.network.positions).max() < 1e-9


def test_cases_cover_every_body_and_travel_as_json():
    all_cases = cases(seeds=range(1000, 1020))
    assert len(all_cases) == 9 * (3 * 20 + 6 * 10)
    assert len({case.cell for case in all_cases}) == 9 * 9
    assert [Case.from_json(json.loads(json.dumps(asdict(case)))) for case in quick_cases()] == quick_cases()


def test_the_quick_zoo_writes_its_files(tmp_path, capsys):
    options = ["--quick", "--processes", "1", "--out", str(tmp_path / "zoo")]
    assert main(options) == 0
    assert "| chain2, true | 1 |" in capsys.readouterr().out
    written = {path.name for path in (tmp_path / "zoo").iterdir()}
    assert written == {"runs", "runs.csv", "cells.csv", "table.md"}
    assert len((tmp_path / "zoo" / "runs.csv").read_text().splitlines()) == 4


def test_a_cloth_of_a_tenth_is_followed_as_well_as_by_the_open_loop():
    """Stretched by far more than its marks scatter, it refutes the filter frame by frame; it was 1.3 times worse."""
    found = run(Case("sheet", 0, size=0.1, length_s=0.5))
    assert found["error_m"] < 1.1 * found["open_loop_m"]
    assert found["error_m"] < 0.7 * found["spline_m"]
    assert found["covered"] > 0.9
