"""Kernels are kept somewhere, whatever cannot be written."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from experiments import kernel_cache
from experiments.kernel_cache import VARIABLE, can_be_written, keep_kernels

PROGRAM = (
    "import os; from experiments import kernel_cache\n"
    "kernel_cache.can_be_written = lambda _folder: False\n"
    "kernel_cache.keep_kernels()\n"
    "from numba import njit\n"
    "import dynamics.forces.kernels as kernels\n"
    "print(kernels.spring_forces._cache.cache_path)"
)


def test_where_the_usual_folders_can_be_written_numba_chooses(monkeypatch, tmp_path):
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setattr(kernel_cache, "CODE", tmp_path / "none" / "yet")
    keep_kernels()
    assert VARIABLE not in os.environ


@pytest.mark.slow
def test_where_none_can_be_written_they_are_kept_as_long_as_the_run():
    """The folder is the run's own, and gone after it."""
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True)
    folder = Path(done.stdout.strip()).parent
    assert folder.name.startswith("softaim-kernels-")
    assert not folder.exists()


def test_what_is_no_folder_below_none_or_forbidden_cannot_be_written(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    assert can_be_written(tmp_path / "a" / "b")
    assert not can_be_written(tmp_path / "file")
    assert not can_be_written(tmp_path / "file" / "b")
    monkeypatch.setattr(os, "access", lambda _path, mode: not mode & os.W_OK)
    assert not can_be_written(tmp_path / "a" / "b")
