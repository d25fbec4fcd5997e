"""What studies share: a grid of cases, names of options, seeds, tables, and the exit code of a command."""

import pandas as pd
import pytest

from experiments.errors import InputError
from experiments.formats.page import markdown_table
from experiments.studies.ablation.__main__ import main as ablation
from experiments.studies.faults.wrong_worlds.__main__ import main as wrong_worlds
from experiments.studies.grid import command, grid, kept_runs, runs_of, seeds_of, study_options
from experiments.studies.zoo.__main__ import main as zoo


def area(case):
    return {"area": case["a"] * case["b"]}


def test_a_grid_is_every_combination_and_its_runs_are_rows(tmp_path):
    cases = grid(a=(1, 2), b=range(3, 5))
    assert cases == [{"a": 1, "b": 3}, {"a": 1, "b": 4}, {"a": 2, "b": 3}, {"a": 2, "b": 4}]
    given = study_options("What it is.").parse_args(["--out", str(tmp_path), "--processes", "1"])
    table = kept_runs(area, cases, tmp_path / "runs", given).checked()
    pd.testing.assert_frame_equal(table[["a", "b", "area"]], pd.DataFrame(cases).assign(area=[3, 4, 6, 8]))
    assert runs_of(area, cases, given) == [{"area": 3}, {"area": 4}, {"area": 6}, {"area": 8}]


def test_options_are_named_by_the_docstring_and_choose_seeds():
    parser = study_options(
        "What it is.\n\n    python -m experiments.studies.some --out FOLDER",
        page="some.md",
        seeds=(20, 100),
        runs="--runs",
    )
    assert (parser.prog, parser.description) == ("python -m experiments.studies.some", "What it is.")
    given = parser.parse_args(["--out", "x", "--runs", "2", "--first-seed", "7"])
    assert list(seeds_of(given)) == [7, 8]
    assert len(seeds_of(parser.parse_args(["--out", "x"]))) == 20


@pytest.mark.parametrize("n", ["0", "-1", "two"])
def test_there_is_one_run_at_least(n, capsys):
    parser = study_options("What it is.", page="some.md", seeds=(20, 100))
    with pytest.raises(SystemExit):
        parser.parse_args(["--out", "x", f"--seeds={n}"])
    assert f"expected 1 or more, found {n}" in capsys.readouterr().err


def test_a_table_is_markdown_whatever_its_entries():
    shown = markdown_table(["name", "n", "why"], [["a|b", "1", "so"]], left=(0, 2))
    assert shown == "| name | n | why |\n| --- | ---: | --- |\n| a/b | 1 | so |\n"


def test_what_a_command_returns_is_its_exit_code_and_wrong_input_is_two(capsys):
    def ended(arguments):
        if arguments is None:
            raise InputError("--out: expected a folder")
        return arguments[0]

    assert [command(ended)([None]), command(ended)([1]), command(ended)()] == [0, 1, 2]
    assert capsys.readouterr().err == "--out: expected a folder\n"


@pytest.mark.parametrize(
    ("main", "option", "value", "expected"),
    [
        (ablation, "--only", "magic", "one of whole filter, "),
        (ablation, "--bodies", "magic", "one of phantom, "),
        (zoo, "--bodies", "sheet,magic", "one of chain2, chain3, "),
        (wrong_worlds, "--only", "magic", "one of nothing, "),
        (wrong_worlds, "--bodies", "magic", "one of four masses, "),
    ],
)
def test_a_name_that_there_is_not_is_one_line_and_nothing_is_written(main, option, value, expected, tmp_path, capsys):
    assert main(["--out", str(tmp_path / "out"), option, value]) == 2
    assert capsys.readouterr().err.startswith(f"{option}: expected {expected}")
    assert not (tmp_path / "out").exists()
