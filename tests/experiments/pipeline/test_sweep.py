"""Sweeps of short runs: what a run is, what is written, what is not done again, and what cannot be run."""

from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from dynamics import four_mass_phantom
from experiments.commands.app import app
from experiments.errors import InputError
from experiments.formats.sweep_file import read_sweep
from experiments.pipeline import sweep as module
from experiments.pipeline.sweep import assumed_network, cases_of, swept_rows

HANGING = Path(__file__).parents[1] / "hanging.toml"
TEXT = """
version = 1
scenario = "poked"
methods = ["filter", "ekf"]
seeds = 2
[grid]
scenario.duration_s = [0.2]
marks.sd_mm = [0.5, 4]
model.stiffness = [1.0, 1.3]
"""
CLOCK = ["ms_per_frame", "seconds"]


def file(folder, text=TEXT):
    path = folder / "sweep.toml"
    path.write_text(text, encoding="utf-8")
    return path


def softaim_sweep(path, out):
    return CliRunner().invoke(app, ["sweep", str(path), "--out", str(out), "--processes", "1"], catch_exceptions=False)


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """A sweep that the command ran."""
    folder = tmp_path_factory.mktemp("sweep")
    return folder / "out", softaim_sweep(file(folder), folder / "out")


def test_every_combination_seed_and_method_has_a_row(done):
    out, result = done
    assert result.exit_code == 0
    assert "8 runs, 8 of them new" in result.stdout
    runs = pd.read_parquet(out / "runs.parquet")
    rows = runs[["marks.sd_mm", "model.stiffness", "seed", "method"]].itertuples(index=False, name=None)
    expected = product((0.5, 4.0), (1.0, 1.3), (0, 1), ("open-loop", "filter", "ekf"))
    assert sorted(rows) == sorted(expected)
    assert set(runs["frames"]) == {6}
    own = ["seed", "method", "mae_mm"]
    pd.testing.assert_frame_equal(pd.read_csv(out / "runs.csv")[own], runs[own], rtol=1e-8)


def test_the_summary_is_over_the_runs(done):
    out, _ = done
    runs, summary = pd.read_parquet(out / "runs.parquet"), pd.read_csv(out / "summary.csv")
    assert len(summary) == 4 * 3
    row = summary[(summary["marks.sd_mm"] == 4) & (summary["model.stiffness"] == 1.3) & (summary["method"] == "ekf")]
    own = runs[(runs["marks.sd_mm"] == 4) & (runs["model.stiffness"] == 1.3)]
    ekf, paper = own[own["method"] == "ekf"], own[own["method"] == "open-loop"]
    assert row["runs"].item() == 2
    assert row["mae_mm"].item() == pytest.approx(ekf["mae_mm"].sum() / 2, rel=1e-5)
    assert row["rmse_mm"].item() == pytest.approx(np.hypot(*ekf["rmse_mm"]) / np.sqrt(2), rel=1e-5)
    assert row["by_open_loop"].item() == pytest.approx(ekf["mae_mm"].sum() / paper["mae_mm"].sum(), rel=1e-5)
    lines = (out / "summary.md").read_text(encoding="utf-8").splitlines()
    assert len(lines) == 2 + 12
    assert lines[0].startswith("| marks.sd_mm | model.stiffness | method | runs | failed | mean error [mm] |")


def test_a_run_is_its_case_whatever_ran_before(tmp_path):
    """And with its truth made again, kept, and read from the cache."""
    cases = cases_of(read_sweep(file(tmp_path)))
    first = swept_rows(cases[0])
    for case in (cases[7], cases[3]):
        swept_rows(case, tmp_path / "truths")
    assert len(list((tmp_path / "truths").iterdir())) == 1
    swept_rows(cases[0], tmp_path / "truths")
    again = swept_rows(cases[0], tmp_path / "truths")
    own = [{name: value for name, value in row.items() if name not in CLOCK} for row in first]
    assert own == [{name: value for name, value in row.items() if name not in CLOCK} for row in again]


def test_the_model_alone_has_the_factors():
    network = four_mass_phantom()
    assumed = assumed_network(network, {"stiffness": 1.3, "mass": 1.0})
    np.testing.assert_allclose(assumed.stiffness, 1.3 * network.stiffness, rtol=1e-12)
    np.testing.assert_allclose(assumed.damping, network.damping, rtol=1e-12)
    np.testing.assert_array_equal(assumed.rest_lengths, network.rest_lengths)


def test_run_again_it_does_what_is_new(tmp_path):
    small = TEXT.replace("[0.5, 4]", "[4]").replace("[1.0, 1.3]", "[1.0]").replace(', "ekf"', "")
    path, out = file(tmp_path, small), tmp_path / "out"
    assert "2 runs, 2 of them new" in softaim_sweep(path, out).stdout
    before = pd.read_parquet(out / "runs.parquet")
    assert "2 runs, 0 of them new" in softaim_sweep(path, out).stdout
    pd.testing.assert_frame_equal(pd.read_parquet(out / "runs.parquet"), before)
    file(tmp_path, small.replace("seeds = 2", "seeds = 3"))
    assert "3 runs, 1 of them new" in softaim_sweep(path, out).stdout
    assert list(pd.read_parquet(out / "runs.parquet")["seed"]) == [0, 0, 1, 1, 2, 2]


def test_the_scene_of_the_scenario_is_swept(tmp_path):
    """In space, with its marks' noise and pushes of all measured nodes; a grid varies them, and the truth's spread."""
    (tmp_path / "hanging.toml").write_text(HANGING.read_text(encoding="utf-8"), encoding="utf-8")
    text = 'version = 1\nscene = "hanging.toml"\nduration_s = 0.2\n[marks]\nsd_mm = 0.25\nlost = 0.1\n'
    text += "[pokes]\nacceleration_m_s2 = 2.0\nshortest_s = 0.1\nlongest_s = 0.3\npause_s = 0.1\n"
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    grid = "marks.outliers = [0.0, 0.1]\nscenario.constants.stiffness = [0.0, 0.2]\n"
    cases = cases_of(read_sweep(file(tmp_path, f'version = 1\nscenario = "mine.toml"\nseeds = 2\n[grid]\n{grid}')))
    assert len(cases) == 8
    setup = cases[-1]["setup"]
    assert setup["marks"] == {"sd_mm": 0.25, "lost": 0.1, "outliers": 0.1}
    assert setup["scenario"]["pokes"]["nodes"] == ["a"]
    assert str(tmp_path) not in str(setup)
    exact, wrong = (
        module.motion_of(module.Scenario(**one["setup"]["scenario"]), HANGING.read_text(), 0, None)
        for one in (cases[0], cases[2])
    )
    assert np.abs(exact.positions[0] - wrong.positions[0]).max() > 1e-4
    rows = swept_rows(cases[0])
    assert [row["method"] for row in rows] == ["open-loop", "filter"]
    assert rows[1]["mae_mm"] < 10.0


def test_a_run_that_fails_does_not_end_the_sweep(tmp_path, monkeypatch):
    move = module.motion_of

    def broken(scenario, text, seed, truths):
        if seed == 1:
            raise FloatingPointError("overflow")
        return move(scenario, text, seed, truths)

    monkeypatch.setattr(module, "motion_of", broken)
    path = file(tmp_path, TEXT.replace("[0.5, 4]", "[4]").replace("[1.0, 1.3]", "[1.0]"))
    result = softaim_sweep(path, tmp_path / "out")
    assert result.exit_code == 1
    assert "FloatingPointError: overflow; repeat: python -m experiments.engine " in result.stderr
    assert "1 of 2 runs failed" in result.stderr
    summary = pd.read_csv(tmp_path / "out" / "summary.csv")
    assert set(summary["runs"]) == set(summary["failed"]) == {1}
    monkeypatch.undo()
    assert "2 runs, 1 of them new" in softaim_sweep(path, tmp_path / "out").stdout


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        (TEXT + 'scenario.pokes.nodes = [["M9"]]\n', r'sweep\.toml: scenario: .*"M9"'),
        (
            TEXT + 'filter.led_nodes = [["M1"], ["M2"]]\n',
            r'sweep\.toml: grid\.filter\.led_nodes\[0\]: expected a node with a measured mark, found "M2" without',
        ),
    ],
)
def test_what_cannot_be_run_is_one_error_before_all_runs(tmp_path, text, fault):
    with pytest.raises(InputError, match=fault) as caught:
        softaim_sweep(file(tmp_path, text), tmp_path / "out")
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()
