"""TOML as it is written: what is read back is what was given."""

import tomllib

import numpy as np
import pytest

from experiments.formats.toml_file import key_lines


@pytest.mark.parametrize("value", ['quote " and \\', "bell \x07, delete \x7f", "ä\n", True, 3, 0.1, [1.5, [2.0, 3.0]]])
def test_values_are_read_back(value):
    assert tomllib.loads("\n".join(key_lines({"key": value}))) == {"key": value}


def test_numbers_of_numpy_are_numbers():
    table = {"n": np.int64(3), "x": np.float32(0.5), "is": np.bool_(True), "none": None}
    assert tomllib.loads("\n".join(key_lines(table))) == {"n": 3, "x": 0.5, "is": True}
