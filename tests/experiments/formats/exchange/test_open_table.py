"""Tables whose entries may be missing."""

from pathlib import Path

import numpy as np

from experiments.formats.exchange.open_table import numbers_of, open_table


def test_what_is_missing_or_infinite_is_no_number() -> None:
    rows = [["1.5", "a"], ["", "nan"], ["inf", ""], ["-inf", "b"], ["nan", "c"]]
    table = open_table(Path("a.csv"), ["x", "word"], rows, ["word"])
    assert np.array_equal(table.numbers["x"], [1.5, *[np.nan] * 4], equal_nan=True)
    assert table.texts == {"word": ["a", "nan", "", "b", "c"]}


def test_numbers_of_a_column_may_be_infinite() -> None:
    found = numbers_of(Path("a.csv"), "x", ["1.5", "", "-inf"])
    assert np.array_equal(found, [1.5, np.nan, -np.inf], equal_nan=True)
