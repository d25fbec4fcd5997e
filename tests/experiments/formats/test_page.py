"""Parts of a page are replaced between their comments, and nothing else is."""

from pathlib import Path

import pytest

from experiments.formats.page import replaced, rewrite_page

TEXT = "before\n<!-- a -->\nold 1\n<!-- end of a -->\nbetween\n<!-- b -->\nkept\n<!-- end of b -->\nafter\n"


def test_only_what_stands_between_the_comments_is_replaced() -> None:
    assert replaced(TEXT, {"a": "new \\1\n"}) == TEXT.replace("old 1", "new \\1")
    assert replaced(TEXT, {"a": "x", "b": "y"}) == TEXT.replace("old 1", "x").replace("kept", "y")


@pytest.mark.parametrize("text", [TEXT, TEXT + "<!-- c -->", "<!-- end of c -->\n<!-- c -->\n"])
def test_a_page_without_the_comments_of_a_part_is_left_as_it_is(text: str, tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match="expected <!-- c --> and <!-- end of c -->"):
        rewrite_page(page, {"a": "new", "c": "new"} if "<!-- a -->" in text else {"c": "new"})
    assert page.read_text(encoding="utf-8") == text
