"""Values as JSON can hold them, numbers in words."""

from pathlib import Path

import pytest

from experiments.commands.console import advice_line, constants_table, levels_table, marks_table
from experiments.plain import amount, counted, plain


@pytest.mark.parametrize(
    ("grams", "expected"), [(8.25, "8.25 g"), (9999.4, "9999 g"), (9999.6, "10 kg"), (484_512.0, "484.5 kg")]
)
def test_large_amounts_are_in_the_larger_unit(grams: float, expected: str) -> None:
    assert amount(grams, "g", "kg") == expected


def test_what_json_cannot_hold_is_null() -> None:
    assert plain({"a": [float("nan"), float("-inf"), 1.5, True], "b": {"c": Path("x/y")}, "d": (1, "x", None)}) == {
        "a": [None, None, 1.5, True],
        "b": {"c": "x/y"},
        "d": [1, "x", None],
    }


@pytest.mark.parametrize(
    ("reported", "expected"),
    [
        (counted(0, "frame"), "0 frames"),
        (counted(1, "mass", "masses"), "1 mass"),
        (counted(2, "mass", "masses"), "2 masses"),
        (advice_line({"GO": 1, "WAIT": 0}), "1 frame: GO 1, WAIT 0"),
    ],
)
def test_one_thing_is_in_the_singular(reported: str, expected: str) -> None:
    assert reported == expected


def test_a_change_that_rounds_to_nothing_has_no_minus() -> None:
    rows = [{"name": "M1", "value": 1.0, "standard_error": 0.1, "change": x, "kept": False} for x in (-4e-4, -6e-4)]
    table = constants_table({"constants": rows, "undetermined_combinations": [], "passes": 1})
    assert list(table.columns[3].cells) == ["+0.0%", "-0.1%"]
    assert str(table.caption).startswith("1 pass. ")


@pytest.mark.parametrize(
    ("unknown", "words"),
    [
        (0, "The recording determines all of them."),
        (2, "The recording determines none of them."),
        (1, "1 of 2 independent combinations of them; 1 keep their prior uncertainty (--json lists them)."),
    ],
)
def test_what_a_recording_determines_is_one_sentence(unknown: int, words: str) -> None:
    row = {"name": "M1", "value": 1.0, "standard_error": 0.1, "change": 0.0, "kept": False}
    table = constants_table({"constants": [row, row], "undetermined_combinations": [{}] * unknown, "passes": 1})
    assert str(table.caption).endswith(words)


def test_levels_are_listed_with_the_log_likelihoods_by_which_one_is_chosen() -> None:
    logs = {0.003: 1000.0, 0.01: 998.0, 0.03: 900.0}
    levels = [{"strain": strain, "log_likelihood": log} for strain, log in logs.items()]
    table = levels_table({"levels": levels, "strain": 0.01, "log_likelihood_before": 2000.0})
    rows = list(zip(*(column.cells for column in table.columns), strict=True))
    assert rows == [("0.003", "0.0", ""), ("0.01", "-2.0", "chosen"), ("0.03", "-100.0", "")]
    assert str(table.caption).endswith(": +1000.0.")


def test_of_many_marks_those_found_least_are_shown() -> None:
    """12 of 40 are refused in 1 to 12 % of frames: the table has the last ten, worst first, and counts the others."""
    row = {"refused": 0.0, "lost": 0.0, "measured": True, "reason": None, "reason_share": 0.0}
    marks = {f"M{k}": row | {"found": 1.0 - 0.01 * k if k <= 12 else 1.0} for k in range(1, 41)}
    table = marks_table({"marks": marks})
    assert list(table.columns[0].cells) == [f"M{k}" for k in range(12, 2, -1)]
    assert table.caption == "found in all frames: 28 of 40 marks; 2 more in summary.json"
