"""No frame waits for a compiler: what a run calls was called before its first frame, with the same types."""

import os
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.slow
@pytest.mark.parametrize("name", ["phantom", "chain3", "cable-fast", "block27"])
def test_a_run_calls_no_kernel_that_the_rehearsal_did_not(name):
    """In a process of its own, since what an earlier test called would not be missed."""
    done = subprocess.run(
        [sys.executable, "-m", "tests.experiments.pipeline.warmed", name],
        cwd=Path(__file__).parents[3],
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == ""
