"""The study's table and files, and its faults on one line."""

import json

import numpy as np
import pandas as pd
import pytest

from experiments.studies.dense_lungs import __main__ as study
from experiments.studies.dense_lungs.__main__ import main
from experiments.studies.dense_lungs.methods import METHODS, Found
from experiments.studies.dense_lungs.table import COUNTS, WORDS, Run, markdown, summary
from tests.experiments.studies.dense_lungs.displaced import exhaled, landmarks, write_case

SOLVED = [method for method in WORDS if method != "open_loop"]


def test_a_row_has_means_over_all_lungs_and_nothing_of_a_method_that_failed():
    runs = [
        Run(name, where, marks, dict.fromkeys(SOLVED, np.array(e)), {"filter": np.array(nees)}, {"open_loop": "why"})
        for where in ("all", "front")
        for marks in COUNTS
        for name, e, nees in (("right", [1e-3, 2e-3, 3e-3], [1.0, 1.0, 1.0]), ("left", [4e-3], [9.0]))
    ]
    rows = summary(runs)
    assert [(row["where"], row["marks"]) for row in rows] == [
        (w, n) for w in ("all", "front") for n in (10, 20, 40, 80)
    ]
    found = rows[5]["methods"]
    assert found["filter"] == {"mae_mm": pytest.approx(2.5), "coverage95": 0.75, "n": 4}
    assert found["thin_plate"] == {"mae_mm": pytest.approx(2.5), "coverage95": None, "n": 4}
    assert found["open_loop"] == {"mae_mm": None, "coverage95": None, "n": 4}
    assert markdown(rows).splitlines()[2] == "| 10, all | 2.50 | 2.50 | 2.50 | 2.50 |  | 2.50 | 75.0% |  |"


@pytest.fixture
def tables(tmp_path, monkeypatch):
    """A folder of one person; methods that leave every landmark where it was, the first with 2 mm an axis."""

    def still(task):
        return Found(task.wanted)

    def unsure(task):
        return Found(task.wanted, np.tile(4e-6 * np.eye(3), (len(task.wanted), 1, 1)))

    monkeypatch.setattr(study, "METHODS", {name: unsure if name == "filter" else still for name in METHODS})
    folder = tmp_path / "tables"
    folder.mkdir()
    write_case(folder / "case1.csv", landmarks(1), exhaled(landmarks(1)))
    return folder


def test_the_study_writes_its_files(tables, tmp_path, capsys):
    assert main([str(tables), "--out", str(tmp_path / "out"), "--processes", "1"]) == 0
    out = tmp_path / "out"
    assert sorted(path.name for path in out.iterdir()) == ["rows.csv", "summary.json", "table.md"]
    assert capsys.readouterr().out == (out / "table.md").read_text()
    content = json.loads((out / "summary.json").read_text())
    assert content["lungs"] == ["case1 right", "case1 left"]
    found = content["rows"][0]["methods"]
    assert found["filter"]["mae_mm"] == pytest.approx(found["none"]["mae_mm"]) != 0.0
    assert found["filter"]["coverage95"] == 1.0
    assert found["thin_plate"]["coverage95"] is None
    rows = pd.read_csv(out / "rows.csv")
    assert len(rows) == 8 * len(WORDS)
    assert rows["mae_mm"][0] == pytest.approx(found["filter"]["mae_mm"])


def test_a_method_that_fails_is_named(tables, tmp_path, capsys, monkeypatch):
    def failing(task):
        raise ValueError("no such tissue")

    monkeypatch.setitem(study.METHODS, "field", failing)
    assert main([str(tables), "--out", str(tmp_path / "out"), "--processes", "1"]) == 1
    assert "case1 left, 80 marks, front: field: ValueError: no such tissue\n" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["none"], "none: expected tables of landmarks, case1.csv and others, found no folder"),
        (["tables", "--stiffness-factor", "0"], "--stiffness-factor: expected a finite number above 0, found 0"),
    ],
)
def test_faults_are_one_line_and_nothing_is_written(tables, tmp_path, capsys, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    assert main([*arguments, "--out", "out"]) == 2
    assert capsys.readouterr().err == f"{message}\n"
    assert not (tmp_path / "out").exists()


def test_results_do_not_go_into_the_folder_of_the_tables(tables, capsys):
    assert main([str(tables), "--out", str(tables / "out")]) == 2
    assert "a folder apart from" in capsys.readouterr().err
