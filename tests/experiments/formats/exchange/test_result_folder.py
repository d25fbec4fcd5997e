"""A folder of results in pandas: the columns of its files by time, as the lines of the page read it; its faults."""

import json
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from experiments.formats.exchange.result_folder import read_result
from tests.experiments.command import softaim
from tests.experiments.rows import complaint, rows

PAGE = Path(__file__).parents[4] / "docs" / "recording.md"
HEADER = "time_s,status,x_mm,y_mm,nis,marks_used,model_only,nees"
FLAT = f"{HEADER}\n0.5,TRACKING,1.25,-2,0.5,3,False,inf\n0.75,COASTING,1.5,-2,,0,True,\n"


def blocks() -> list[str]:
    """The lines of Python of the page."""
    return re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)


@pytest.mark.usefixtures("without_pictures")
def test_the_lines_of_the_page_read_what_track_writes(here: Path) -> None:
    """Each number of the files is found where the page says, by both ways alike; marks that are there, too."""
    tracked = here / "track"
    assert softaim("track", "marks", "--out", "track") == 0
    names: dict[str, Any] = {}
    of_softaim, of_pandas = blocks()
    exec(of_softaim, names)
    exec(of_pandas, names)
    found = names["result"]
    pd.testing.assert_frame_equal(found.estimates, names["estimates"], rtol=0.0, atol=0.0)
    for frame, name in ((found.estimates, "estimates.csv"), (found.open_loop, "estimates.open-loop.csv")):
        header, *lines = (tracked / name).read_text(encoding="utf-8").splitlines()
        assert [frame.index.name, *frame.columns] == header.split(",")
        assert frame.index.tolist() == [0.0, 0.1, 0.2]
        cells = [line.split(",") for line in lines]
        for k, column in enumerate(frame.columns, start=1):
            written = [row[k] for row in cells]
            if column in ("status", "model_only"):
                assert [str(entry) for entry in frame[column]] == written
            else:
                assert np.array_equal(frame[column], [float(x or "nan") for x in written], equal_nan=True), column
    assert found.open_loop["xx"].isna().all()
    assert found.estimates["xx"].notna().all()
    assert found.summary == json.loads((tracked / "summary.json").read_text(encoding="utf-8"))
    assert found.summary["filter"]["frames"] == 3
    assert found.marks is None
    shutil.copy("marks/marks.csv", tracked)
    marks = read_result(tracked).marks
    assert list(marks.columns) == ["node", "x_mm", "y_mm", "sd_mm"]
    assert marks.loc[0.1, "node"].tolist() == ["M1", "M3", "M4"]
    assert (marks["sd_mm"] == 1.0).all()


def test_the_folder_of_a_live_run_has_estimates_alone(tmp_path: Path) -> None:
    """A live run may have been killed in its last line. Infinite is no missing number."""
    (tmp_path / "estimates.csv").write_text(f"{FLAT}1.0,TRAC", encoding="utf-8")
    found = read_result(str(tmp_path))
    assert (found.open_loop, found.marks, found.summary) == (None, None, {})
    assert found.estimates.index.tolist() == [0.5, 0.75]
    assert np.array_equal(found.estimates["nis"], [0.5, np.nan], equal_nan=True)
    assert np.array_equal(found.estimates["nees"], [np.inf, np.nan], equal_nan=True)
    assert found.estimates["marks_used"].tolist() == [3, 0]
    assert found.estimates["model_only"].tolist() == [False, True]
    assert found.estimates["model_only"].dtype == bool


def test_a_run_without_frames_has_no_rows(tmp_path: Path) -> None:
    (tmp_path / "estimates.csv").write_text(f"{HEADER}\n", encoding="utf-8")
    found = read_result(tmp_path).estimates
    assert [found.index.name, *found.columns] == HEADER.split(",")
    assert len(found) == 0


FAULTS = rows(r"""
estimates.csv | 0.75 |  | estimates.csv: row 3: time_s: expected a finite number, found nan
estimates.csv | 1.25 | left | estimates.csv: row 2: x_mm: expected a number, found "left"
estimates.csv | COASTING | GONE | estimates.csv: row 3: status: expected one of INITIALISING, TRACKING, COASTING,
    LOST, DIVERGED, found "GONE"
estimates.csv | True | yes | estimates.csv: row 3: model_only: expected True or False, found "yes"
estimates.csv | ,3, | ,2.5, | estimates.csv: row 2: marks_used: expected a whole number, found 2.5
estimates.csv | ,3, | ,, | estimates.csv: row 2: marks_used: expected a whole number, found nan
estimates.csv | status | state | estimates.csv: row 1: expected one column status, found none in
    "time_s,state,x_mm,y_mm,nis,marks_used,model_only,nees"
estimates.open-loop.csv | 1.25 | left | estimates.open-loop.csv: row 2: x_mm: expected a number, found "left"
marks.csv | node | name | marks.csv: row 1: expected one column node, found none in "time_s,name,x_mm,y_mm,sd_mm"
summary.json | "filter": | "filter" | summary.json: line 1: expected JSON, found Expecting ':' delimiter
summary.json | {"filter": {}} | [1] | summary.json: expected a JSON object, found [1]
""")


@pytest.mark.parametrize(("name", "good", "bad", "expected"), FAULTS)
def test_a_fault_is_named_on_one_line(tmp_path: Path, name: str, good: str, bad: str, expected: str) -> None:
    texts = dict.fromkeys(("estimates.csv", "estimates.open-loop.csv"), FLAT)
    texts |= {"marks.csv": "time_s,node,x_mm,y_mm,sd_mm\n0.5,M1,1,2,1\n", "summary.json": '{"filter": {}}'}
    assert good in texts[name]
    texts[name] = texts[name].replace(good, bad, 1)
    for file, text in texts.items():
        (tmp_path / file).write_text(text, encoding="utf-8")
    assert complaint(read_result, tmp_path) == f"{tmp_path}/{expected}"


def test_other_folders_are_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    assert complaint(read_result, tmp_path) == f"{tmp_path}/estimates.csv: expected a file, found none"
    none = f"{tmp_path}/none: expected a folder with estimates.csv, found none"
    assert complaint(read_result, tmp_path / "none") == none
    a_file = f"{tmp_path}/file: expected a folder with estimates.csv, found a file"
    assert complaint(read_result, tmp_path / "file") == a_file
