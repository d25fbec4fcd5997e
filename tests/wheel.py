"""Whether a wheel holds all that belongs in it, and nothing else: `make wheel`.

    python -m tests.wheel WHEEL

What belongs in it is every file of the four packages that git knows, and softaim.py. The reference is git, not the
lists of pyproject.toml.
"""

import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from zipfile import ZipFile

PACKAGES = ("dynamics", "estimators", "vision", "experiments")
MODULE = "softaim.py"


def tracked() -> list[str]:
    """Paths of the files that belong in the wheel."""
    words = ["git", "ls-files", "--", *PACKAGES, MODULE]
    return subprocess.run(words, capture_output=True, text=True, check=True).stdout.split()


def faults(wheel: Path, expected: Iterable[str]) -> list[str]:
    """A line for each file that is missing from a wheel, or does not belong in it, and for a missing command."""
    wanted = set(expected)
    with ZipFile(wheel) as archive:
        held = {name for name in archive.namelist() if ".dist-info/" not in name and not name.endswith("/")}
        entries = [archive.read(name).decode() for name in archive.namelist() if name.endswith("entry_points.txt")]
    lines = [f"{name}: expected in the wheel, found none" for name in sorted(wanted - held)]
    lines += [f"{name}: found in the wheel, where it does not belong" for name in sorted(held - wanted)]
    if not any("softaim = experiments.commands.app:main" in text for text in entries):
        lines.append("entry_points.txt: expected the command softaim, found none")
    return lines


if __name__ == "__main__":
    found = faults(Path(sys.argv[1]), tracked())
    print(*found, sep="\n") if found else print(f"{sys.argv[1]}: all that belongs in it")
    sys.exit(1 if found else 0)
