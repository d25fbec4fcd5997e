"""A live run is watched by both clients, and all counts are reported. Speed is not tested."""

import pytest

from experiments.studies.live.pace import busy, measured


def test_processors_that_were_busy_are_the_run_s_the_clients_and_others():
    """Two seconds of 2 processors: 1.0 s by the run, 0.4 s by the clients, 2.0 s of all."""
    before = {"at": 10.0, "run": 3.0, "clients": 1.0, "all": 50.0}
    between = {"at": 11.0, "run": 3.9, "clients": 1.3, "all": 51.0}
    after = {"at": 12.0, "run": 4.0, "clients": 1.4, "all": 52.0}
    found = busy([before, between, after])
    assert found == pytest.approx({"cores_run": 0.5, "cores_clients": 0.2, "cores_others": 0.3})


@pytest.mark.slow
def test_a_run_is_watched_by_both_clients():
    found = measured(1.0, 10.0)
    assert 1 <= found["frames"] <= 15
    assert 0.0 < found["p50_ms"] <= found["p99_ms"] <= found["worst_ms"]
    assert found["page_states_s"] > 0.0
    assert found["page_pictures_s"] > 0.0
    assert found["igtl_messages_s"] > found["page_states_s"]  # several of each moment
    assert 0.0 < found["igtl_age_p50_ms"] < 60e3
    assert found["cores_run"] > 0.0
