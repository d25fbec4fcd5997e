"""CSV files: numbers come back exactly, and every fault is reported with its row and column."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from experiments.errors import InputError
from experiments.formats import tables
from experiments.formats.tables import read_table, write_table
from tests.experiments.rows import complaint


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "t.csv"


def test_columns_are_found_by_name_in_any_order(path: Path):
    path.write_bytes(b'\xef\xbb\xbfnode, b,a\r\n"M,1", 1e-3,-2\r\nM2,4 ,5\r\n\r\n')
    table = read_table(path, ["a", "b"], ["node"])
    assert (table.n_rows, table.texts["node"]) == (2, ["M,1", "M2"])
    np.testing.assert_array_equal(table.numbers["a"], [-2.0, 5.0])
    np.testing.assert_array_equal(table.numbers["b"], [0.001, 4.0])


BAD = {
    "empty": ("", ": expected columns a, b, node, found an empty file"),
    "missing column": ("a,node\n1,x\n", ': row 1: expected one column b, found none in "a,node"'),
    "extra column": ("a,b,c,node\n1,2,3,x\n", ': row 1: expected only columns a, b, node, found also "c"'),
    "column twice": ("a,b,a,node\n1,2,3,x\n", ': row 1: expected one column a, found 2 in "a,b,a,node"'),
    "refused column": ("a,b,node,camera\n1,2,x,front\n", ": camera: one camera is supported"),
    "long row": ("a,b,node\n1,2,x\n1,2,x,\n", ": row 3: expected 3 values, found 4"),
    "empty line": ("a,b,node\n1,2,x\n\n\n1,2,x\n", ": row 3: expected 3 values, found an empty line"),
    "not a number": ("a,b,node\n1,2,x\n1,two,x\n", ': row 3: b: expected a finite number, found "two"'),
    "no number": ("a,b,node\n1,,x\n", ": row 2: b: expected a finite number, found none"),
    "infinite": ("a,b,node\n-inf,2,x\n", ': row 2: a: expected a finite number, found "-inf"'),
    "Python's own": ("a,b,node\n1_000,2,x\n", ': row 2: a: expected a finite number, found "1_000"'),
    "other digits": ("a,b,node\n１,2,x\n", ': row 2: a: expected a finite number, found "１"'),
    "line in quotes": ('a,b,node\n1,2,"x\ny"\n', ": row 2: expected a row on one line, found a line break in quotes"),
    "open quotes": ('a,b,node\n1,2,"x', ": row 2: expected comma-separated values, found "),
    "first of two": ("a,b,node\n1,2,x\n1,no,x\nno,2,x\n", ": row 3: b: expected a finite number"),
}


@pytest.mark.parametrize(("content", "message"), BAD.values(), ids=BAD.keys())
def test_a_fault_is_reported_in_one_line_with_row_and_column(path: Path, content: str, message: str):
    path.write_text(content, encoding="utf-8")
    said = complaint(read_table, path, ["a", "b"], ["node"], rejected={"camera": "one camera is supported"})
    assert said.startswith(f"{path}{message}")


def test_rows_are_counted_through_chunks(path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(tables, "CHUNK_ROWS", 2)
    path.write_text("a,node\n" + "1,x\n" * 5 + "no,x\n", encoding="utf-8")
    assert "t.csv: row 7: a: expected a finite number" in complaint(read_table, path, ["a"], ["node"])
    path.write_text("a,node\n" + "".join(f"{k},n{k}\n" for k in range(5)), encoding="utf-8")
    table = read_table(path, ["a"], ["node"])
    np.testing.assert_array_equal(table.numbers["a"], np.arange(5.0))
    assert table.texts["node"] == ["n0", "n1", "n2", "n3", "n4"]


def test_order_within_groups_names_the_first_late_row_and_the_one_before(path: Path):
    # group 0 is late in row 6 (after row 2), group 1 in row 5 (after row 4): row 5 is the first
    path.write_text("t\n0.5\n0.1\n0.3\n0.2\n0.4\n", encoding="utf-8")
    table = read_table(path, ["t"])
    with pytest.raises(InputError, match=r"row 5: t: expected more than 0\.3 \(the row before\), found 0\.2$"):
        table.check_order("t", strictly=True, groups=np.array([0, 1, 1, 1, 0]))
    with pytest.raises(InputError, match=r"row 6: t: expected more than 0\.5 \(row 2\), found 0\.4$"):
        table.check_order("t", strictly=True, groups=np.array([0, 1, 1, 2, 0]))
    table.check_order("t", strictly=True, groups=np.array([3, 1, 1, 2, 0]))


@given(
    st.lists(
        st.tuples(
            st.floats(allow_nan=False, allow_infinity=False),
            st.text(st.characters(codec="utf-8", exclude_categories=["C", "Z"]), min_size=1),
        )
    )
)
@settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_what_is_written_is_read_again(path: Path, rows: list[tuple[float, str]]):
    write_table(path, ["number", "text"], [[repr(number), text] for number, text in rows])
    table = read_table(path, ["number"], ["text"])
    assert table.numbers["number"].tolist() == [number for number, _ in rows]
    assert table.texts["text"] == [text for _, text in rows]


@given(st.binary(max_size=200))
@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_bytes_are_a_table_or_one_line_of_complaint(path: Path, content: bytes):
    path.write_bytes(b"a,b\n" + content)
    complaint = ""
    try:
        table = read_table(path, ["a"], ["b"])
    except InputError as fault:
        complaint = str(fault)
    if complaint:
        assert complaint.startswith(f"{path}: ")
        assert complaint.isprintable()
    else:
        assert np.isfinite(table.numbers["a"]).all()
        assert len(table.texts["b"]) == len(table.numbers["a"]) == table.n_rows
