"""Values as JSON can hold them."""

from pathlib import Path

from experiments.plain import plain


def test_what_json_cannot_hold_is_null() -> None:
    assert plain({"a": [float("nan"), float("-inf"), 1.5, True], "b": {"c": Path("x/y")}, "d": (1, "x", None)}) == {
        "a": [None, None, 1.5, True],
        "b": {"c": "x/y"},
        "d": [1, "x", None],
    }
