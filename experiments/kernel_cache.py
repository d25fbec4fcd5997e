"""Folder for compiled kernels: numba fails if it can write neither beside the code nor in the user's cache."""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile
from pathlib import Path

VARIABLE = "NUMBA_CACHE_DIR"
CODE = Path(__file__).parents[1] / "dynamics" / "forces" / "__pycache__"


def keep_kernels() -> None:
    """If numba has no writable folder, give it a temporary one. Call this before numba is loaded."""
    home = Path(os.path.expanduser("~"))
    users = Path(os.environ.get("XDG_CACHE_HOME") or home / ".cache")
    stated = [Path(os.environ[VARIABLE])] if os.environ.get(VARIABLE) else []
    if not any(map(can_be_written, [*stated, CODE, users])):
        # its name is unpredictable, because its content is executed
        os.environ[VARIABLE] = tempfile.mkdtemp(prefix="softaim-kernels-")
        atexit.register(shutil.rmtree, os.environ[VARIABLE], ignore_errors=True)


def can_be_written(folder: Path) -> bool:
    """Whether a folder is writable. A missing folder is writable if its nearest existing parent is writable."""
    there = next((one for one in (folder, *folder.parents) if one.exists()), None)
    return there is not None and os.access(there, os.W_OK | os.X_OK)
