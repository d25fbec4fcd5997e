"""Faults as `softaim faults` makes them: the quick form of the study, and its judge on moments made by hand."""

import numpy as np
import pandas as pd
import pytest

from estimators import Advice, Status, TargetEstimate
from experiments.errors import InputError
from experiments.studies.faults.catalogue import FAULTS, ONSET_S, Fault, fault_of
from experiments.studies.faults.judge import STALE_S, Moment, _verdict, is_wrong, judged
from experiments.studies.faults.study import cells, markdown, names_of, run, summary
from experiments.studies.faults.world import BEGAN_S, Arrival, ScriptedFrames

SEED = 7000


def moment(time_s: float, **changes: object) -> Moment:
    usual = {
        "age_s": 0.02,
        "status": Status.TRACKING,
        "advice": Advice.GO,
        "why": "",
        "sigma_m": 1e-3,
        "wrong": False,
        "well": True,
    }
    return Moment(time_s, **(usual | changes))  # type: ignore[arg-type]


def test_a_moment_of_go_counts_where_the_estimate_is_wrong_or_old_and_the_time_to_notice_is_over():
    fault = Fault("made up", "for the test", 2.0)
    times = np.round(ONSET_S + 0.1 * np.arange(-5, 40), 6)
    cases = {
        "wrong": [moment(t, wrong=0.0 <= t - ONSET_S < 2.0) for t in times],
        "old": [moment(t, age_s=STALE_S + 0.01 if 0.0 <= t - ONSET_S < 2.0 else 0.02) for t in times],
        "neither": [moment(t) for t in times],
        "not GO": [moment(t, wrong=0.0 <= t - ONSET_S < 2.0, advice=Advice.WAIT) for t in times],
    }
    counted = {name: _verdict(fault, 0, moments).go_shown_while_faulty for name, moments in cases.items()}
    # from 0.2 s after the onset to its end, a moment each 0.1 s
    assert counted == {"wrong": 18, "old": 18, "neither": 0, "not GO": 0}


def test_noticing_and_recovering_are_timed():
    fault = Fault("made up", "for the test", 2.0)
    tenths = np.arange(-5, 60)
    times = np.round(ONSET_S + 0.1 * tenths, 6)
    ill = [moment(t, well=not 3 <= k < 24) for k, t in zip(tenths, times, strict=True)]
    found = _verdict(fault, 0, ill)
    assert found.noticed_ms == pytest.approx(300.0)
    assert found.recovered_ms == pytest.approx(400.0)
    never = _verdict(fault, 0, [moment(t, well=t < ONSET_S) for t in times])
    assert never.recovered_ms is None


def test_an_estimate_is_wrong_outside_of_its_region_and_not_by_a_hair():
    def off(mm: float, sd_mm: float) -> bool:
        estimate = TargetEstimate(0.0, np.zeros(2), (1e-3 * sd_mm) ** 2 * np.eye(2), Status.TRACKING, 3)
        return is_wrong(estimate, np.array([1e-3 * mm, 0.0]))

    # the root of the 99.9 % quantile of chi-square, 2 degrees of freedom, is 3.717
    assert [off(3.6, 1.0), off(3.8, 1.0), off(0.9, 0.1), off(1.1, 0.1)] == [False, True, False, True]


def test_a_scripted_camera_is_a_live_one():
    """A picture that comes again is withheld, one of 16 bit is read, a failure is an event at once."""
    rng = np.random.default_rng(0)
    pictures = [rng.integers(0, 255, (8, 8, 3), dtype=np.uint8) for _ in range(4)]
    given = [pictures[0], pictures[1], pictures[0], pictures[2].astype(np.uint16) * 257, None, pictures[3]]
    frames = ScriptedFrames([Arrival(BEGAN_S + 0.1 * k, image) for k, image in enumerate(given)])
    taken = [frame.image for _ in range(12) if (frame := frames.next(0.1)) is not None]
    assert len(taken) == 4
    for found, picture in zip(taken, pictures, strict=True):
        np.testing.assert_array_equal(found, picture)
    assert [str(event.kind) for event in frames.take_events()] == ["DROPPED", "RESUMED", "ENDED"]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["frozen in turn", "16 bit", "all covered"])
def test_go_is_not_shown_on_a_faulty_estimate(name, tmp_path):
    """One seed of three faults; before and after them GO is shown, so that there is something to withhold."""
    found = judged(fault_of(name), SEED, tmp_path)
    assert found.go_shown_while_faulty == 0
    assert found.go > 60
    if name == "16 bit":
        assert found.noticed_ms is None
        assert found.covered
    else:
        assert found.noticed_ms is not None
        assert found.noticed_ms <= 1e3 * fault_of(name).within_s
        assert found.recovered_ms is not None
        assert found.recovered_ms <= 500.0


@pytest.mark.slow
def test_a_run_is_a_row_of_the_study():
    row = run({"fault": "black", "seed": SEED})
    assert row["go_shown_while_faulty"] == 0
    assert row["noticed_ms"] <= 200.0


def test_the_table_tells_the_slowest_and_the_sum():
    runs = pd.DataFrame(
        {
            "fault": ["blood", "blood", "none"],
            "seed": [1, 2, 1],
            "noticed_ms": [20.0, np.nan, np.nan],
            "covered": [True, False, True],
            "shown": ["COASTING", "", ""],
            "recovered_ms": [400.0, 90.0, 0.0],
            "sigma_before_mm": [1.0, 1.0, 1.0],
            "sigma_most_mm": [4.0, 2.0, 1.0],
            "go_shown_while_faulty": [2, 1, 0],
            "go": [5, 6, 90],
        }
    )
    rows = summary(runs)
    assert list(rows["fault"]) == ["none", "blood"]
    blood = cells(rows)[1]
    assert blood[1:] == ["20 ms, 1 of 2", "COASTING", "x 3.0", "1 of 2", "400 ms", "3", "11"]
    assert "| never |" in markdown(rows)


def test_every_fault_has_a_name_of_its_own_and_another_is_refused():
    assert len({fault.name for fault in FAULTS}) == len(FAULTS) == len(names_of([]))
    assert names_of(["blood"]) == ["blood"]
    with pytest.raises(InputError, match="--only: expected one of none, unplugged"):
        names_of(["flood"])
