"""A quick form of the marks study; figures of docs/marks-study.md from all of it."""

import pandas as pd
import pytest

from experiments.engine.workers import OWN_PROCESS
from experiments.studies import marks
from experiments.studies.marks import figures, run


def test_marks_in_good_light_are_found_to_a_fiftieth_of_a_pixel() -> None:
    told = figures(pd.concat([run(seed, "good light", 4) for seed in range(3)]))
    assert told["found"] == 1.0
    assert told["rms_px"] < 0.03  # measured 0.016
    assert told["false_per_1000_frames"] == 0.0
    assert 0.5 < told["predicted_by_real"] < 2.0


@pytest.mark.slow
def test_marks_in_any_room_are_found() -> None:
    told = figures(pd.concat([run(seed, "whole range", 3) for seed in (1, 4, 5, 7)]))
    assert told["found"] == 1.0
    assert told["rms_px"] < 0.35  # measured 0.15
    assert told["swapped"] == 0


def test_the_study_writes_the_rows_of_its_runs(tmp_path, monkeypatch):
    """Rows by hand, of marks that were found and of one that was not: as a table of pandas would be written."""

    def rows(seed, level, n_frames):
        seen = {"du": 0.1 * seed, "dv": -0.2, "uu": 0.02, "vv": 0.03, "occluded": False}
        seen |= {"far": False, "false": seed == 2, "swapped": False}
        both = [{"seed": seed, "frame": k, "mark": "M0", "visible": 1.0, "found": k != 1} for k in range(n_frames)]
        return pd.DataFrame([{**one, **(seen if one["found"] else {})} for one in both])

    monkeypatch.setattr(marks, "run", rows)
    monkeypatch.setattr(marks, "crossings", lambda _n, _workers: {"frames": 1.0})
    by_level = marks.study([1, 2], 3, tmp_path, OWN_PROCESS)
    tables = [pd.concat([rows(seed, level, 3) for seed in (1, 2)]).assign(level=level) for level in marks.LEVELS]
    expected = pd.concat(tables).to_csv(index=False, float_format="%.4f")
    assert (tmp_path / "marks.csv").read_text(encoding="utf-8") == expected
    assert by_level == {level: figures(table) for level, table in zip(marks.LEVELS, tables, strict=True)} | {
        "crossings": {"frames": 1.0}
    }
