"""The tests beside what was changed since the last commit, and since the branch left main: for `make quick`.

The tests mirror the packages: of `estimators/guidance/advice.py` it is `tests/estimators/guidance/test_advice.py`,
or all of the folder where there is no file of that name. Where nothing was changed it is the test of the pins.
"""

import subprocess
from pathlib import Path

PACKAGES = ("dynamics", "estimators", "vision", "experiments")


def changed_files() -> list[str]:
    """Paths that differ from main, and those not yet known to git."""
    names = []
    for words in (
        ["diff", "--name-only", "HEAD"],
        ["diff", "--name-only", "main...HEAD"],
        ["ls-files", "-o", "--exclude-standard"],
    ):
        names += subprocess.run(["git", *words], capture_output=True, text=True, check=False).stdout.split()
    return sorted(set(names))


def beside(name: str) -> str | None:
    """The test file or folder of a changed file; None where there is none."""
    path = Path(name)
    if path.parts[0] == "tests":
        return name if path.name.startswith("test_") and path.exists() else None
    if name == "softaim.py":
        return "tests/test_softaim.py"
    if path.parts[0] not in PACKAGES or path.suffix != ".py":
        return None
    folder = Path("tests", *path.parts[:-1])
    own = folder / f"test_{path.name}"
    if own.exists():
        return str(own)
    while not folder.exists():
        folder = folder.parent
    return str(folder)


if __name__ == "__main__":
    found = {test for name in changed_files() if (test := beside(name)) is not None}
    print(*sorted(found or {"tests/test_pins.py"}), sep="\n")
