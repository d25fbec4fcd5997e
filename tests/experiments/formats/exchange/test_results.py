"""Results are read with the columns that they have, and their rows are those of the recording's frames."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from estimators import Status, TargetEstimate
from experiments.errors import InputError
from experiments.formats.estimate_rows import header, row
from experiments.formats.exchange.results import read_advice, read_estimates
from experiments.formats.outputs import table_text
from experiments.formats.tables import write_table
from tests.experiments.rows import complaint

EXPOSURES_S = 33763.60965430567 + np.arange(4) / 30


def estimate(time_s: float, status: Status, cov: np.ndarray | None) -> TargetEstimate:
    return TargetEstimate(time_s, np.array([0.001, 0.002, -0.003]), cov, status, marks_used=3)


def test_estimates_as_a_live_run_writes_them(tmp_path: Path) -> None:
    """In space: means and covariances in metres; a row between frames is of none."""
    cov = 1e-6 * np.array([[4.0, 1.0, 0.5], [1.0, 9.0, -2.0], [0.5, -2.0, 16.0]])
    times_s, covs = EXPOSURES_S[[0, 1, 1, 3]] + [0.0, 0.0, 0.01, 0.0], (cov, cov, 2.0 * cov, None)
    statuses = Status.INITIALISING, Status.TRACKING, Status.COASTING, Status.TRACKING
    written = [estimate(*one) for one in zip(times_s, statuses, covs, strict=True)]
    rows = [["" if value is None else str(value) for value in row(one)] for one in written]
    write_table(tmp_path / "estimates.csv", header(3), rows)
    found = read_estimates(tmp_path, 3, EXPOSURES_S)
    assert found.frames.tolist() == [0, 1, -1, 3]
    assert found.trusted.tolist() == [False, True, True, False]
    assert found.times_s.tolist() == [one.time_s for one in written]
    np.testing.assert_allclose(found.means, [one.mean for one in written], rtol=1e-12)
    np.testing.assert_allclose(found.covs[:3], [cov, cov, 2.0 * cov], rtol=1e-12)
    assert np.isnan(found.covs[3]).all()
    said = found.entries(3)
    assert list(said) == header(3)
    assert (said["status"], said["xx"], said["model_only"]) == ("TRACKING", None, False)
    assert said["z_mm"] == pytest.approx(-3.0)


def test_times_since_1970_keep_their_frames(tmp_path: Path) -> None:
    """As `track` writes them, each row is of its own frame; of nine digits none is."""
    epoch_s = 1.7e9 + np.arange(4) / 30
    columns = ["status", "x_mm", "y_mm", "xx", "xy", "yy", "nis", "marks_used", "poked", "gain", "model_only"]
    rows = pd.DataFrame([["TRACKING", 1.0, 2.0, 1.0, 0.0, 1.0, np.nan, 3, 0.1, np.nan, False]] * 4, columns=columns)
    rows.insert(0, "time_s", epoch_s)
    (tmp_path / "estimates.csv").write_text(table_text(rows))
    assert read_estimates(tmp_path, 2, epoch_s).frames.tolist() == [0, 1, 2, 3]
    (tmp_path / "estimates.csv").write_text(rows.to_csv(index=False, float_format="%.9g"))
    assert read_estimates(tmp_path, 2, epoch_s).frames.tolist() == [0, 0, 0, 0]


def test_a_line_that_was_being_written_is_left_out(tmp_path: Path) -> None:
    text = 'time_s,advice,reason\n33763.61,GO,"there, now"\n33763.64,NO_GUI'
    assert read_advice(tmp_path, EXPOSURES_S) is None
    (tmp_path / "advice.csv").write_text(text)
    found = read_advice(tmp_path, EXPOSURES_S)
    assert found.table.texts == {"advice": ["GO"], "reason": ["there, now"]}


def test_a_row_must_say_when(tmp_path: Path) -> None:
    (tmp_path / "advice.csv").write_text("time_s,advice,reason\n1,GO,x\n,GO,x\n")
    assert "row 3: time_s: expected a finite number, found nan" in complaint(read_advice, tmp_path, EXPOSURES_S)


def test_estimates_in_space_are_not_of_a_flat_scene(tmp_path: Path) -> None:
    (tmp_path / "estimates.csv").write_text(",".join(header(3)) + "\n")
    with pytest.raises(InputError, match=r"row 1: expected estimates of a flat scene, .*, found column z_mm"):
        read_estimates(tmp_path, 2, EXPOSURES_S)
