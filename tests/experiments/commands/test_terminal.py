"""How far a run is, said where there is no terminal for a bar; tables."""

import threading

import pytest

from experiments.commands.console import track_table
from experiments.commands.terminal import print_table, progress_lines

SOON_S = 20.0


def test_a_run_that_takes_long_says_how_far_it_is_though_it_stands_still() -> None:
    """After a time, then after twice as long; the stage begun last is the one at work."""
    said, heard = [], [threading.Event() for _ in range(3)]

    def say(line: str) -> None:
        said.append(line)
        heard[len(said) - 1].set()

    with progress_lines(0.05, say) as stage:
        stage("read")(1.0)
        done = stage("track")
        done(0.25)
        assert heard[0].wait(SOON_S)
        assert heard[1].wait(SOON_S)
        lines = said[:2]
    assert [line.split(" after")[0] for line in lines] == ["track: 25%", "track: 25%"]


@pytest.mark.parametrize(
    ("share", "line"),
    [
        (0.0, "0% after 0 s; a first run compiles"),
        (0.005, "0% after 0 s; a first run compiles"),
        (0.02, "2% after 0 s"),
    ],
)
def test_a_stage_that_hardly_began_names_the_reason(share: float, line: str) -> None:
    said, heard = [], threading.Event()

    def say(line: str) -> None:
        said.append(line)
        heard.set()

    with progress_lines(0.05, say) as stage:
        stage("track")(share)
        assert heard.wait(SOON_S)
    assert said[0] == f"track: {line}"


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
