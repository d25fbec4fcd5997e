"""Repeat one failed run from its record: `python -m experiments.engine FAILURE.json`.

The command prints the run's result. If the run fails, it shows the whole traceback, with exit code 1.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from experiments.engine.runs import named_work
from experiments.errors import InputError, read_text


def repeat(path: Path) -> object:
    """Repeat the failed run of a record file, and return its result. Raises InputError if the file has no record."""
    try:
        record = json.loads(read_text(path))
        work, case = named_work(record["work"]), record["case"]
    except (ValueError, KeyError, TypeError, ImportError, AttributeError) as error:
        reason = " ".join(str(error).split())
        raise InputError.at(path, "a record in `failures/` of a study", reason) from None
    return work(case)


def main() -> None:
    """Repeat the failed run of the record file that the command line states."""
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
