"""The study of lattices, on one small box."""

import json

import pandas as pd
import pytest

from experiments.studies import lattices as study
from experiments.studies.lattices import YOUNG, main, summary


@pytest.fixture(name="out")
def _out(tmp_path, monkeypatch):
    monkeypatch.setattr(study, "FITTED_SEEDS", range(1))
    return tmp_path / "out"


def test_the_study_writes_its_files(out, capsys):
    command = ["--out", str(out), "--seeds", "1", "--cells", "6", "--structures", "sheet", "--processes", "1"]
    assert main(command) == 0
    assert sorted(path.name for path in out.iterdir()) == ["lattices.png", "rows.csv", "summary.json", "tables.md"]
    assert capsys.readouterr().out == (out / "tables.md").read_text()
    content = json.loads((out / "summary.json").read_text())
    found = content["methods"]["sheet"]
    assert found["own"]["largest_error"] < 1e-4
    assert found["fitted"]["largest_error"] < 0.15 < found["van_gelder"]["largest_error"]
    assert found["material"]["largest_error"] == 0.0
    assert found["material"]["alignment"] > 0.7
    assert len(content["factors"]["sheet"]) == 6
    rows = pd.read_csv(out / "rows.csv")
    assert rows["method"].tolist() == ["material", "van_gelder", "lloyd", "fitted", "own"]


def test_errors_are_of_the_mean_over_boxes_and_of_any_box():
    """Errors along x of 10 % and -6 % in two boxes of 1 and 2 kPa: their mean is 2 %."""
    flat = [
        {"structure": "sheet", "seed": seed, "method": method, **dict.fromkeys(YOUNG, young), YOUNG[0]: young * factor}
        for seed, young in ((7, 1e3), (8, 2e3))
        for method, factor in (("material", 1.0), ("fitted", {7: 1.10, 8: 0.94}[seed]))
    ]
    found = summary(pd.DataFrame(flat)).loc[("sheet", "fitted")]
    assert found.largest_mean_error == pytest.approx(0.02)
    assert found.largest_error == pytest.approx(0.10)
    assert found[YOUNG[1]] == pytest.approx(1.5e3)


CELLS = [(f"--cells={n}", f"--cells: expected 6 or more, found {n}") for n in ("-3", "0", "1", "5")]
BONE = "--structures: expected one of plain, sheet, foam, lobules, fibres, found bone"


@pytest.mark.parametrize(("option", "said"), [*CELLS, ("--structures=sheet,bone", BONE)])
def test_wrong_options_are_one_line(out, capsys, option, said):
    assert main(["--out", str(out), option]) == 2
    assert capsys.readouterr().err == f"{said}\n"
    assert not out.exists()
