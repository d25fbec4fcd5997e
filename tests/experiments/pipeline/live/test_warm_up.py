"""No frame waits for a compiler: what a run calls was called before its first frame, with the same types."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

NAMES = ["phantom", "space"]


@pytest.mark.slow
def test_a_run_calls_no_kernel_that_the_rehearsal_did_not():
    """In processes of their own, since what an earlier test called would not be missed."""
    words = [sys.executable, "-m", "tests.experiments.pipeline.live.warmed", *NAMES]
    where = {"cwd": Path(__file__).parents[4], "env": os.environ | {"OPENBLAS_NUM_THREADS": "1"}}
    done = subprocess.run(words, capture_output=True, text=True, check=False, **where)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [f"{name}: over" for name in NAMES], done.stderr
