"""Tables whose entries may be missing."""

from pathlib import Path

import numpy as np

from experiments.formats.exchange.open_table import open_table


def test_what_is_missing_is_no_number() -> None:
    rows = [["1.5", "a"], ["", "nan"], ["inf", ""], ["-inf", "b"], ["nan", "c"]]
    table = open_table(Path("a.csv"), ["x", "word"], rows, ["word"])
    assert np.array_equal(table.numbers["x"], [1.5, np.nan, np.inf, -np.inf, np.nan], equal_nan=True)
    assert table.texts == {"word": ["a", "nan", "", "b", "c"]}
