"""The study of lattices, on one small box."""

import json

import numpy as np
import pandas as pd
import pytest

from experiments.studies.lattices import __main__ as study
from experiments.studies.lattices.__main__ import main


@pytest.fixture(name="out")
def _out(tmp_path, monkeypatch):
    monkeypatch.setattr(study, "FITTED_SEEDS", range(1))
    return tmp_path / "out"


def test_the_study_writes_its_files(out, capsys):
    command = ["--out", str(out), "--seeds", "1", "--cells", "6", "--structures", "sheet", "--processes", "1"]
    assert main(command) == 0
    assert sorted(path.name for path in out.iterdir()) == ["lattices.png", "rows.csv", "summary.json", "tables.md"]
    assert capsys.readouterr().out == (out / "tables.md").read_text()
    (row,) = json.loads((out / "summary.json").read_text())["rows"]
    found = row["methods"]
    assert found["own"]["largest_error"] < 1e-4
    assert found["fitted"]["largest_error"] < 0.15 < found["van_gelder"]["largest_error"]
    assert found["material"]["largest_error"] == 0.0
    assert row["alignment"] > 0.7
    assert sum(row["shares"]) == pytest.approx(1.0)
    rows = pd.read_csv(out / "rows.csv")
    assert rows["method"].tolist() == ["material", "van_gelder", "lloyd", "fitted", "own"]
    np.testing.assert_allclose(rows["young_yz_pa"][0], found["material"]["young_pa"][3])
    np.testing.assert_allclose(rows["poisson_xy"][3], found["fitted"]["poisson"][2])


def test_an_unknown_structure_is_one_line(out, capsys):
    assert main(["--out", str(out), "--structures", "sheet,bone"]) == 2
    assert capsys.readouterr().err == (
        "--structures: expected one of plain, sheet, foam, lobules, fibres, found bone\n"
    )
    assert not out.exists()
