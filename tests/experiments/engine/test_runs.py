"""One run: its key, its failure, and the name by which other processes find its function."""

from functools import partial

import pytest

from experiments.engine.executor import RunsFailedError, results
from experiments.engine.runs import importable, key_of, perform
from experiments.engine.workers import OWN_PROCESS
from tests.experiments.engine import small_runs


def test_a_key_is_of_function_and_case_in_any_order():
    key = key_of(small_runs.paired, {"seed": 1, "rate": 0.5})
    assert key == key_of(small_runs.paired, {"rate": 0.5, "seed": 1})
    assert key == key_of(partial(small_runs.paired, cache="x"), {"rate": 0.5, "seed": 1})
    others = [(small_runs.drawn, {"seed": 1, "rate": 0.5}), (small_runs.paired, {"seed": 2, "rate": 0.5})]
    assert len({key} | {key_of(*other) for other in others}) == 3


def test_a_case_is_what_json_can_hold():
    with pytest.raises(TypeError):
        key_of(small_runs.paired, {"seed": object()})


@pytest.mark.parametrize("work", [lambda case: case, partial(small_runs.paired, {"seed": 1})])
def test_a_function_without_a_name_of_its_own_is_no_work(work):
    with pytest.raises(ValueError, match="expected"):
        importable(work)


def test_what_a_run_raises_is_its_failure_on_one_line(tmp_path):
    (tmp_path / "broken").touch()
    run = perform(small_runs.failing, 4, {"seed": 3, "folder": str(tmp_path)})
    assert (run.index, run.result, run.failure) == (4, None, "ValueError: no 3 of these")
    assert "small_runs.py" in run.trace
    assert perform(exit, 0, 3).failure == "SystemExit: 3"
    with pytest.raises(KeyboardInterrupt):
        perform(interrupted, 0, None)


def interrupted(_case):
    raise KeyboardInterrupt


def test_results_in_the_order_of_the_jobs_or_the_first_failure(tmp_path):
    shares = []
    assert results(abs, [-1, 2, -3], OWN_PROCESS, shares.append) == [1, 2, 3]
    assert shares == pytest.approx([1 / 3, 2 / 3, 1.0])
    (tmp_path / "broken").touch()
    jobs = [{"seed": seed, "folder": str(tmp_path)} for seed in (1, 3, 6)]
    with pytest.raises(RunsFailedError, match=r"2 of 3 runs failed, first .*'seed': 3.*ValueError: no 3 of these"):
        results(small_runs.failing, jobs, OWN_PROCESS)
