"""Cost of the engine: figures against known ones, and their columns."""

import pytest

from experiments.engine.workers import OWN_PROCESS
from experiments.studies.load import busy, figures, measured


def test_figures_of_a_load():
    """2 processes for 6 s did 10 s of runs: 2 s are over, of four runs 0.5 s each; 11 s of processor time for 9."""
    found = figures(4, 2, wall_s=6.0, cpu_s=11.0, runs={"seconds": 10.0, "cpu_s": 9.0})
    assert found["busy"] == pytest.approx(10.0 / 12.0)
    assert found["beyond_a_run_ms"] == pytest.approx(500.0)
    assert found["beyond_a_run_cpu_ms"] == pytest.approx(500.0)


def test_runs_take_no_more_than_everything():
    """Four runs of 100 ms of processor time in this process."""
    found = measured(busy, [{"seed": seed, "ms": 100.0} for seed in range(4)], OWN_PROCESS)
    assert (found["runs"], found["processes"]) == (4, 1)
    assert found["wall_s"] >= 0.4
    assert 0.0 < found["busy"] <= 1.0
    assert found["beyond_a_run_cpu_ms"] >= -5.0  # counted in hundredths of a second, at the start and at the end
