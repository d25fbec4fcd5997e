"""The study of honest noise: its command, and figures that a wrong covariance would show in."""

import pandas as pd
import pytest

from experiments.studies import honesty as study
from experiments.studies.honesty import cells_of, main, run


def test_fine_marks_of_a_poked_phantom_are_covered_and_its_nees_is_by_the_error():
    """Mean square of the error by the variance: NEES, if errors and sigmas are those of the same frames."""
    case = {"body": "four masses", "pushes": "pokes", "seed": 3, "sd_m": 1e-3, "stated": 1.0, "duration_s": 6.0}
    found = run(case)
    assert (found["frames"], found["lost"]) == (150, 0)
    assert found["covered"] > 0.88 * 150
    assert 0.05 < found["error_mm"] < found["sd_mm"] < 0.7
    assert found["nees"] == pytest.approx((found["error_mm"] / found["sd_mm"]) ** 2, rel=0.8)


def test_a_cell_is_the_share_of_the_frames_that_may_guide():
    """Two runs of 10 frames, one of them lost in 5: 12 of 15 covered."""
    same = {"body": "b", "pushes": "p", "sd_m": 1e-3, "stated": 1.0, "frames": 10, "nees": 1.0}
    same |= {"error_mm": 1.0, "sd_mm": 1.0}
    runs = pd.DataFrame([{**same, "lost": 0, "covered": 9, "wrong": 1}, {**same, "lost": 5, "covered": 3, "wrong": 2}])
    cells = cells_of(runs)
    assert cells[["seeds", "frames"]].to_numpy().tolist() == [[2, 15]]
    assert cells["covered"].tolist() == pytest.approx([12 / 15])
    assert cells["wrong"].tolist() == pytest.approx([3 / 15])


def test_the_command_writes_all_cells(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(study, "SD_M", (1e-3, 1e-2))
    monkeypatch.setattr(study, "STATED", (1.0,))
    options = ["--bodies", "four masses", "--pushes", "nothing", "--seeds", "1", "--seconds", "1.2"]
    assert main(["--out", str(tmp_path), *options, "--processes", "1"]) == 0
    assert pd.read_csv(tmp_path / "cells.csv")["sd_m"].tolist() == [1e-3, 1e-2]
    assert "four masses" in capsys.readouterr().out
