"""Repeat one failed run from its record: `python -m experiments.engine FAILURE.json`.

It prints the run's result; an exception is shown in full, with exit code 1.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from experiments.engine.runs import named_work
from experiments.errors import InputError, read_text


def repeat(path: Path) -> object:
    """Repeat the run of a record and return its result. Raises InputError if the file is not a record."""
    try:
        record = json.loads(read_text(path))
        work, case = named_work(record["work"]), record["case"]
    except (ValueError, KeyError, TypeError, ImportError, AttributeError) as error:
        reason = " ".join(str(error).split())
        raise InputError.at(path, "a record in `failures/` of a study", reason) from None
    return work(case)


def main() -> None:
    """Repeat the run whose record the command line names."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("record", type=Path)
    try:
        result = repeat(parser.parse_args().record)
    except InputError as error:
        sys.stderr.write(f"{error}\n")
        sys.exit(2)
    sys.stdout.write(f"{result}\n")


if __name__ == "__main__":
    main()
