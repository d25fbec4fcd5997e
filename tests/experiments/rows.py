"""Tables of tests as text: a row a line."""


def rows(table: str) -> list[list[str]]:
    r"""The cells of each row, between ` | `; `\n` is a line break, and an indented line goes on with the one before."""
    lines = table.strip().replace("\n    ", " ").splitlines()
    return [[cell.replace(r"\n", "\n") for cell in line.split(" | ")] for line in lines]
