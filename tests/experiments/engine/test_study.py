"""Studies on a local cluster: the same results on any number of workers, whatever dies, and as often as continued."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import dask
import pandas as pd
import pytest

from experiments.engine import workers
from experiments.engine.study import Parts, run_study
from experiments.engine.workers import OWN_PROCESS, Workers
from experiments.errors import InputError
from tests.experiments.engine import small_runs

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def two():
    """Two workers, as a cluster of somebody else's."""
    with workers.local_cluster(2, small_runs.__name__) as cluster:
        yield Workers(scheduler=cluster.scheduler_address)


def cases(n, folder=""):
    return [{"seed": seed, "folder": str(folder)} for seed in range(n)]


def same(one: pd.DataFrame, other: pd.DataFrame) -> None:
    """All but what the clock and the process have to do with is the same."""
    own = ["seconds", "pid"]
    columns = [name for name in one.columns if name not in own]
    pd.testing.assert_frame_equal(one[columns], other[columns], check_exact=True)


def test_the_same_table_from_one_process_and_from_two_workers(tmp_path, two):
    one = run_study(small_runs.drawn, cases(16), tmp_path / "one", OWN_PROCESS)
    other = run_study(small_runs.drawn, cases(16), tmp_path / "two", two)
    same(one.table, other.table)
    assert list(other.table["seed"]) == list(range(16))
    assert len(set(other.table["pid"])) > 1
    assert os.getpid() not in set(other.table["pid"])
    pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / "two" / "runs.parquet"), other.table)


def test_a_run_that_kills_its_workers_fails_and_the_others_are_done_again(tmp_path, two):
    """Seed 3 kills its worker once, seed 7 always."""
    with dask.config.set({"distributed.comm.timeouts.connect": "5s"}):  # of 30: to workers that died
        done = run_study(small_runs.deadly, cases(12, tmp_path), tmp_path / "study", two)
    failed = done.table[done.table["failure"].notna()]
    assert list(failed["seed"]) == [7]
    assert failed["failure"].iloc[0].startswith("KilledWorker")
    assert done.table.drop(index=7)["twice"].to_list() == [2 * seed for seed in range(12) if seed != 7]


STUDY = """
from pathlib import Path
from experiments.engine import study
from experiments.engine.workers import Workers
from tests.experiments.engine import small_runs
study.KEEP_S = study.KEEP_SHARE = 0.0
if __name__ == "__main__":
    cases = [{{"seed": seed, "folder": {folder!r}}} for seed in range(8)]
    study.run_study(small_runs.slow, cases, Path({study!r}), Workers(2))
"""


def test_what_is_done_is_not_done_again_after_a_kill(tmp_path):
    """The whole study is killed when it has kept some runs, the later ones held; then the rest is done, here."""
    (tmp_path / "held").touch()
    script = tmp_path / "script.py"
    script.write_text(STUDY.format(folder=str(tmp_path), study=str(tmp_path / "study")), encoding="utf-8")
    environment = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    process = subprocess.Popen([sys.executable, str(script)], env=environment | {"PYTHONPATH": str(ROOT)})
    kept = tmp_path / "study" / "kept"
    until = time.monotonic() + 120.0
    while len(list(kept.glob("*.parquet"))) < 2 and time.monotonic() < until:
        time.sleep(0.02)
    process.kill()
    process.wait()
    (tmp_path / "held").unlink()
    known = pd.concat([pd.read_parquet(path) for path in kept.glob("*.parquet")])
    assert 2 <= len(known) < 8
    assert set(known["threads"]) == {"1"}
    times_before = {path.name: len(path.read_text()) for path in tmp_path.iterdir() if path.name.isdigit()}
    done = run_study(small_runs.slow, cases(8, tmp_path), tmp_path / "study", OWN_PROCESS)
    assert done.n_done == 8 - len(known)
    assert all((tmp_path / str(seed)).read_text() == "x" * times_before[str(seed)] for seed in known["seed"])
    whole = run_study(small_runs.slow, cases(8, tmp_path), tmp_path / "other", OWN_PROCESS)
    same(done.table.drop(columns="threads"), whole.table.drop(columns="threads"))


def test_failures_are_kept_with_the_command_that_repeats_them(tmp_path):
    (tmp_path / "broken").touch()
    done = run_study(small_runs.failing, cases(5, tmp_path), tmp_path / "study", OWN_PROCESS)
    failed = done.table[done.table["failure"].notna()]
    assert list(failed["seed"]) == [0, 3]
    assert list(failed["failure"]) == ["ValueError: no 0 of these", "ValueError: no 3 of these"]
    assert len(done.failures) == 2
    words = failed["command"].iloc[1].split()
    assert words[:3] == ["python", "-m", "experiments.engine"]
    record = json.loads(Path(words[3]).read_text(encoding="utf-8"))
    assert (record["case"]["seed"], record["failure"]) == (3, "ValueError: no 3 of these")
    repeated = subprocess.run([sys.executable, *words[1:]], cwd=ROOT, capture_output=True, text=True, check=False)
    assert repeated.returncode == 1
    assert "ValueError: no 3\nof these" in repeated.stderr
    (tmp_path / "broken").unlink()
    mended = run_study(small_runs.failing, cases(6, tmp_path), tmp_path / "study", OWN_PROCESS)
    assert mended.n_done == 3
    assert mended.failures == ()
    assert list(mended.table["twice"]) == [0, 2, 4, 6, 8, 10]
    assert list((tmp_path / "study" / "failures").iterdir()) == []


def test_a_result_that_is_none_is_a_failure(tmp_path, two):
    hows = [{"seed": 1, "how": how} for how in ("sent", "row", "name")]
    failures = run_study(small_runs.wrong, hows, tmp_path / "study", two).table["failure"]
    assert "pickle" in failures[0]
    assert failures[1] == "ValueError: result: expected one or more rows, found none"
    assert failures[2] == "ValueError: result: expected columns other than the case's keys, found seed"


def test_rows_of_a_run_stay_together_and_whole_numbers_join_real_ones(tmp_path, monkeypatch):
    monkeypatch.setattr("experiments.engine.study.KEEP_S", 0.0)
    monkeypatch.setattr("experiments.engine.study.KEEP_SHARE", 0.0)
    done = run_study(small_runs.paired, cases(3)[::-1], tmp_path, OWN_PROCESS)
    assert len(list((tmp_path / "kept").iterdir())) == 3
    assert list(done.table["side"]) == ["left", "right"] * 3
    assert list(done.table["half"]) == [1.0, 1.0, 0.5, 0.5, 0.0, 0.0]


def test_no_two_cases_are_alike(tmp_path):
    with pytest.raises(ValueError, match=r"expected different ones, found \{'seed': 1"):
        run_study(small_runs.paired, [*cases(2), *cases(2)[1:]], tmp_path, OWN_PROCESS)


def test_a_column_has_one_kind_of_value(tmp_path):
    parts = Parts(tmp_path)
    parts.add([{"a": 1}, {"a": "x"}])
    with pytest.raises(TypeError, match="one kind of value"):
        parts.write()


def test_a_scheduler_that_is_not_there_is_bad_input(tmp_path, monkeypatch):
    monkeypatch.setattr(workers, "REACHED_S", 0.2)
    with pytest.raises(InputError, match=r"--scheduler tcp://127.0.0.1:1: expected a Dask scheduler, found"):
        run_study(small_runs.paired, cases(2), tmp_path, Workers(scheduler="tcp://127.0.0.1:1"))


def test_without_the_extra_the_message_has_the_command(tmp_path, monkeypatch):
    monkeypatch.setattr("experiments.extras.find_spec", lambda _name: None)
    with pytest.raises(InputError, match=r'pip install "softaim\[cluster\]"'):
        run_study(small_runs.paired, cases(2), tmp_path, OWN_PROCESS)


def test_runs_of_another_state_of_the_program_are_reported(tmp_path, monkeypatch, capsys):
    run_study(small_runs.paired, cases(2), tmp_path, OWN_PROCESS)
    run_study(small_runs.paired, cases(2), tmp_path, OWN_PROCESS)
    assert capsys.readouterr().err == ""
    monkeypatch.setattr("experiments.engine.study.program", lambda: "another")
    done = run_study(small_runs.paired, cases(3), tmp_path, OWN_PROCESS)
    assert "another state of the program" in capsys.readouterr().err
    assert len(set(done.table["program"])) == 2
