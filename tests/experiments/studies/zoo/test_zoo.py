"""The quick form of the zoo, its constants, splines and scores of known numbers, its tables."""

import json
from dataclasses import asdict

import numpy as np
import pandas as pd
import pytest

from dynamics import NetworkError
from experiments.simulation.bodies.body import Scale
from experiments.simulation.bodies.zoo import make_body
from experiments.studies.zoo import run as references
from experiments.studies.zoo.__main__ import cells_of, faults, main, markdown, page_tables
from experiments.studies.zoo.case import Case, cases, measured, quick_cases, wrong_network
from experiments.studies.zoo.run import open_loop, run, spline, thin_plate_weights
from experiments.studies.zoo.scores import hidden_scores, mean_distance


@pytest.mark.parametrize("flat", [False, True])
def test_a_thin_plate_spline_follows_an_affine_motion_exactly(flat):
    rng = np.random.default_rng(7)
    known, wanted = rng.normal(size=(12, 3)), rng.normal(size=(5, 3))
    if flat:
        known[:, 1] = wanted[:, 1] = 0.2
    A, b = rng.normal(size=(3, 3)), rng.normal(size=3)
    weights = thin_plate_weights(known, wanted)
    assert weights @ (known @ A + b) == pytest.approx(wanted @ A + b, abs=1e-9)


def test_one_link_of_two_is_put_on_the_straight_line_to_the_end():
    body = make_body("chain2", 0, seconds=0.1)
    frames = measured(body, body.marked, 0)
    first, second = body.network.rest_lengths
    ends = np.array([marks[0].position for _, marks in frames])
    assert spline(body, frames)[:, 0] == pytest.approx(ends * first / (first + second))


def test_the_open_loop_holds_a_phantom_at_rest_where_it_is():
    """Marks to 0.5 mm: the hidden mass stays within that of where it hangs."""
    body = make_body("phantom", 0, Scale(), seconds=0.2)
    simulated = open_loop(body.network, body, measured(body, body.marked, 0))
    assert simulated is not None
    assert np.linalg.norm(simulated[:, 0] - body.positions[:, 1], axis=1).max() < 5e-4


def test_a_body_without_a_rest_has_no_open_loop(monkeypatch):
    def no_rest(*_):
        raise NetworkError("no rest")

    monkeypatch.setattr(references, "OpenLoop", no_rest)
    body = make_body("chain2", 0, seconds=0.1)
    assert open_loop(body.network, body, measured(body, body.marked, 0)) is None


def test_a_spline_of_a_body_at_rest_leaves_it_there():
    """Before the first pull, within what marks of 0.5 mm an axis make of it."""
    body = make_body("sheet", 0, seconds=0.1)
    found = spline(body, measured(body, body.marked, 0))
    hidden = [body.network.index(name) for name in body.hidden]
    assert np.abs(found - body.positions[:, hidden]).max() < 4.0 * body.mark_sd_m


def scored(errors, sd, *, tracking=True, size_m=1.0):
    means = np.asarray(errors, dtype=float)[:, None]
    covs = np.tile(sd**2 * np.eye(2), (len(means), 1, 1, 1))
    return hidden_scores(means, covs, np.zeros_like(means), tracking=np.full(len(means), tracking), size_m=size_m)


def test_errors_and_nees_of_known_numbers():
    """Errors of 3 and 4 sd: NEES by degree of freedom (9 + 16) / 2 / 2, region of 95 % up to 2.45 sd."""
    found = scored([[0.03, 0.0], [0.0, 0.04], [0.01, 0.0], [0.0, 0.0]], 0.01)
    assert found["error_m"] == pytest.approx(0.02)
    assert found["rms_m"] == pytest.approx(np.sqrt((9 + 16 + 1) / 4) * 0.01)
    assert found["nees"] == pytest.approx((9 + 16 + 1) / 4 / 2)
    assert found["covered"] == 0.5
    assert (found["non_finite"], found["wrong_tracking"]) == (0, 0)


def test_tracking_is_wrong_beyond_both_five_sigma_and_a_tenth_of_the_size():
    errors = [[0.2, 0.0], [0.09, 0.0], [0.04, 0.0]]
    assert scored(errors, 0.01)["wrong_tracking"] == 1
    assert scored(errors, 0.05)["wrong_tracking"] == 0
    assert scored(errors, 0.01, tracking=False)["wrong_tracking"] == 0
    assert scored(errors, 0.01, size_m=0.5)["wrong_tracking"] == 2


def test_what_is_not_finite_or_not_definite_is_counted_and_never_covered():
    means = np.zeros((4, 1, 2))
    covs = np.tile(np.eye(2), (4, 1, 1, 1))
    means[0, 0, 0] = np.nan
    covs[1, 0, 0, 0] = np.inf
    covs[2, 0, 1, 1] = -1.0
    found = hidden_scores(means, covs, np.zeros_like(means), tracking=np.ones(4, dtype=bool), size_m=1.0)
    assert found["non_finite"] == 3
    assert found["covered"] == 0.25
    assert found["error_m"] == np.inf


def test_a_reference_that_runs_away_is_infinitely_wrong():
    places = np.zeros((2, 1, 3))
    assert mean_distance(np.tile([3.0, 4.0, 0.0], (2, 1, 1)), places) == pytest.approx(5.0)
    assert mean_distance(np.full((2, 1, 3), np.nan), places) == np.inf


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


def violated(runs):
    """The bounds that the only cell of these runs violates."""
    (cell,) = cells_of(runs).itertuples()
    return faults(cell)


def test_a_cell_is_rated_by_the_better_of_its_references():
    (cell,) = cells_of(table({}, {"open_loop_m": 6e-3, "spline_m": 2e-3})).itertuples()
    assert (cell.open_loop_mm, cell.spline_mm, cell.ratio) == pytest.approx((4.0, 3.0, 1.0 / 3.0))
    assert faults(cell) == []
    (cell,) = cells_of(table({}, {"open_loop_m": None})).itertuples()  # in one run the open loop could not start
    assert cell.ratio == pytest.approx(1.0 / 4.0)
    nothing = {"frames_done": 0, "error_m": None, "ended": "no rest"}
    assert cells_of(table({}, nothing))["filter_mm"][0] == pytest.approx(1.0)  # of the runs that made something


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
    assert violated(table(figures)) == [fault]


@pytest.mark.parametrize(
    ("figures", "faults"),
    [
        ({"body": "chain2", "size": 10.0, "covered": 0.995}, []),
        ({"body": "chain2", "size": 10.0, "covered": 0.89}, ["covered"]),
        ({"constants": "wrong", "covered": 0.86, "error_m": 2.25e-3}, []),
    ],
)
def test_bounds_are_wider_for_what_may_be_anywhere_and_for_wrong_constants(figures, faults):
    assert violated(table(figures)) == faults


def test_a_cell_that_made_nothing_is_in_the_table_with_its_reason():
    cells = cells_of(pd.DataFrame([{**asdict(Case("sheet", 0)), "ended": "no rest", "frames_done": 0}]))
    assert np.isnan(cells["ratio"][0])
    assert "| 1 of 1 failed, ratio, covered (no rest) |" in markdown(cells)


def test_the_page_has_a_row_for_each_body_with_the_extremes_of_its_scaled_cells():
    others = [{"constants": "identified", "covered": 0.92}, {"size": 0.1, "error_m": 1.9e-3, "covered": 0.91}]
    bodies, summary = page_tables(cells_of(table({}, *others, {"size": 10.0, "covered": 0.98}))).split("\n\n")
    assert bodies.splitlines()[2:] == ["| sheet | 1, 1 | 0.5, 0.5 | 95.0, 92.0 | 0.95 | 91.0 to 98.0 |"]
    assert summary == "Geometric means of the ratios, by constants: true 0.62, identified 0.50.\n"


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
