"""How far a run is, said where there is no terminal for a bar; tables."""

import threading

import pytest

from experiments.commands.console import track_table
from experiments.commands.run import print_table
from experiments.engine.progress import progress_lines
from tests.experiments.waiting import until

BEGUN = "0% after 0 s; a first run compiles"


@pytest.mark.parametrize(("share", "line"), [(0.0, BEGUN), (0.005, BEGUN), (0.02, "2% after 0 s")])
def test_a_run_that_stands_still_says_how_far_it_is_and_one_that_hardly_began_the_reason(share: float, line: str):
    """After a time, then after twice as long; the stage begun last is the one at work."""
    said: list[str] = []
    with progress_lines(0.05, said.append) as stage:
        stage("read")(1.0)
        stage("track")(share)
        until(lambda: len(said) >= 2)
    assert said[:2] == [f"track: {line}"] * 2


def test_a_run_that_ends_says_nothing_more() -> None:
    said: list[str] = []
    with progress_lines(3600.0, said.append) as stage:
        stage("read")(0.5)
    assert not [thread for thread in threading.enumerate() if thread.name == "softaim progress"]
    assert said == []


def test_columns_of_lengths_name_their_unit(capsys: pytest.CaptureFixture[str]) -> None:
    row = {"frames": 10, "frames_lost": 0, "ms_per_frame": 1.2, "sigma_mm": 0.5, "sigma_most_mm": 1.0, "mean_nis": 2.0}
    print_table(track_table({"filter": row}))
    assert capsys.readouterr().out.count("[mm]") == 2
    print_table(track_table({"filter": row | {"mae_mm": 0.4, "sd_mm": 0.1, "rmse_mm": 0.4}}))
    assert capsys.readouterr().out.count("[mm]") == 2
