"""Faults by a script's clock as `softaim faults` makes them, quickly, and their judge on constructed moments."""

from dataclasses import fields, replace

import numpy as np
import pandas as pd
import pytest

from experiments.engine.workers import Workers
from experiments.errors import InputError
from experiments.studies.faults import study
from experiments.studies.faults.judge import ONSET_S, STALE_S, Judged, Moment, is_wrong, verdict
from experiments.studies.faults.scripted import ARRIVES_S, ScriptedFault
from experiments.studies.faults.study import FAULTS, beginning, by_shown, cells, markdown, run, summary
from experiments.studies.faults.world import BEGAN_S, INTERVAL_S, Arrival, ScriptedFrames, drawn, undisturbed

SEED = 7000
MOST_KEPT = 960
"""Pictures of a quarter of a megabyte."""


@pytest.fixture(scope="module")
def pictures():
    """What was drawn, by where the nodes are and which are hidden: until its onset all faults are of the same film."""
    return {}


@pytest.fixture(autouse=True)
def _drawn_once(pictures, monkeypatch):
    def kept(scene, places, rng, *, hidden=()):
        key = places.tobytes(), hidden
        image = pictures[key].copy() if key in pictures else drawn(scene, places, rng, hidden=hidden)
        if len(pictures) < MOST_KEPT:
            pictures.setdefault(key, image.copy())
        return image

    monkeypatch.setattr("experiments.studies.faults.scripted.drawn", kept)


def moment(time_s: float, **changes: object) -> Moment:
    usual = {"age_s": 0.02, "status": "TRACKING", "advice": "GO", "why": "", "sigma_m": 1e-3}
    return Moment(time_s, **(usual | {"wrong": False, "well": True} | changes))  # type: ignore[arg-type]


def test_a_moment_of_go_counts_where_estimate_or_needle_are_wrong_or_old_and_the_time_to_notice_is_over():
    fault = ScriptedFault("made up", "for the test")
    times = np.round(ONSET_S + 0.1 * np.arange(-5, 40), 6)
    cases = {
        "wrong": [moment(t, wrong=0.0 <= t - ONSET_S < 2.0) for t in times],
        "old": [moment(t, age_s=STALE_S + 0.01 if 0.0 <= t - ONSET_S < 2.0 else 0.02) for t in times],
        "astray": [moment(t, astray=0.0 <= t - ONSET_S < 2.0) for t in times],
        "neither": [moment(t) for t in times],
        "not GO": [moment(t, wrong=0.0 <= t - ONSET_S < 2.0, advice="WAIT") for t in times],
    }
    counted = {name: verdict(fault, moments, 2.0).go_shown_while_faulty for name, moments in cases.items()}
    # from 0.2 s after the onset to its end, a moment each 0.1 s
    assert counted == {"wrong": 18, "old": 18, "astray": 18, "neither": 0, "not GO": 0}


def test_noticing_and_recovering_are_timed():
    fault = ScriptedFault("made up", "for the test")
    tenths = np.arange(-5, 60)
    times = np.round(ONSET_S + 0.1 * tenths, 6)
    ill = [moment(t, well=not 3 <= k < 24) for k, t in zip(tenths, times, strict=True)]
    found = verdict(fault, ill, 2.0)
    assert found.noticed_ms == pytest.approx(300.0)
    assert found.recovered_ms == pytest.approx(400.0)
    never = verdict(fault, [moment(t, well=t < ONSET_S) for t in times], 2.0)
    assert never.recovered_ms is None


def test_what_is_reported_is_noticed_though_all_goes_well_and_shown_words_count_whatever_their_figures():
    fault = ScriptedFault("made up", "for the test")
    times = np.round(ONSET_S + 0.1 * np.arange(30), 6)
    reported = verdict(fault, [moment(t, reported="CLOCK" if k == 1 else "") for k, t in enumerate(times)], np.inf)
    assert (reported.noticed_ms, reported.shown) == (pytest.approx(100.0), "CLOCK")
    reasons = ["now 7 %", "now 8 %", "now 9 %", "lost", "lost", *[""] * 25]
    moments = [moment(t, advice="ABORT", why=why, well=not why) for t, why in zip(times, reasons, strict=True)]
    assert verdict(fault, moments, 2.0).shown == "ABORT: now 7 %"


def test_an_estimate_is_wrong_outside_of_its_region_and_not_by_a_hair():
    def off(mm: float, sd_mm: float) -> bool:
        return is_wrong(np.zeros(2), (1e-3 * sd_mm) ** 2 * np.eye(2), np.array([1e-3 * mm, 0.0]))

    # the root of the 99.9 % quantile of chi-square, 2 degrees of freedom, is 3.717
    assert [off(3.6, 1.0), off(3.8, 1.0), off(0.9, 0.1), off(1.1, 0.1)] == [False, True, False, True]


def test_a_scripted_camera_is_a_live_one():
    """A picture that comes again is withheld, one of 16 bit is read, a failure is an event at once."""
    rng = np.random.default_rng(0)
    pictures = [rng.integers(0, 255, (8, 8, 3), dtype=np.uint8) for _ in range(4)]
    sixteen = FAULTS["16 bit"].picture(pictures[2], ONSET_S, rng)
    given = [pictures[0], pictures[1], pictures[0], sixteen, None, pictures[3]]
    frames = ScriptedFrames([Arrival(BEGAN_S + 0.1 * k, image) for k, image in enumerate(given)])
    taken = [frame.image for _ in range(12) if (frame := frames.next(0.1)) is not None]
    assert len(taken) == 4
    for found, picture in zip(taken, pictures, strict=True):
        np.testing.assert_array_equal(found, picture)
    assert [str(event.kind) for event in frames.take_events()] == ["DROPPED", "RESUMED", "ENDED"]
    assert frames.reported().startswith("DROPPED: ")


def played(name, n_frames):
    """A scripted camera with a fault, its pictures 1/30 s apart, and when each of these was exposed [s]."""
    rng, fault = np.random.default_rng(1), FAULTS[name]
    times = INTERVAL_S * np.arange(n_frames)
    pictures = rng.integers(0, 255, (n_frames, 4, 4, 3), dtype=np.uint8)
    shown = [fault.picture(one, t, rng) if fault.acts(t) else one for one, t in zip(pictures, times, strict=True)]
    given = [Arrival(BEGAN_S + t + ARRIVES_S, one) for one, t in zip(shown, times, strict=True)]
    exposed = {one.tobytes(): BEGAN_S + t for one, t in zip(pictures, times, strict=True)}
    return ScriptedFrames(fault.arrivals(given, rng, fault.lasts_s)), exposed


@pytest.mark.parametrize(
    ("name", "reported"),
    [("clock ahead", "CLOCK"), ("clock back", "CLOCK"), ("NaN times", "CLOCK"), ("NaN pictures", "DROPPED")],
)
def test_a_camera_that_tells_no_time_or_no_picture_is_reported_within_three_frames_and_no_time_jumps(name, reported):
    """180 pictures of 1/30 s whose clock was trusted until the fault: times go on by arrival, to 1 ms."""
    (frames, _), found = played(name, 180), []
    while not frames.ended:
        frame = frames.next(0.1)
        if frames.take_events() and reported in (said := frames.reported()):
            found.append((frames.now_s - BEGAN_S - ONSET_S, said))
        if frame is not None and frame.index > 0:  # of the first the interval is not known
            assert abs(frame.exposure_s - (frames.now_s - 0.5 * INTERVAL_S)) < 1e-3
    assert len(found) == 1
    assert 0.0 <= found[0][0] <= 0.1


def test_a_camera_of_which_every_other_frame_is_lost_is_reported_within_three_of_its_frames_and_once():
    """Two seconds of 180 pictures of 1/30 s, from the fourth on: nothing is reported for a film."""
    reported = {}
    for is_film in (False, True):
        frames, _ = played("dropped frames", 240)
        frames._may_repeat = is_film
        reported[is_film] = []
        while not frames.ended:
            frames.next(0.1)
            reported[is_film] += [(frames.now_s - BEGAN_S - ONSET_S, str(one.kind)) for one in frames.take_events()]
    assert [kind for _, kind in reported[False]] == ["SPARSE", "RESUMED", "ENDED"]
    assert 0.0 < reported[False][0][0] <= 0.2
    assert [kind for _, kind in reported[True]] == ["ENDED"]


@pytest.mark.parametrize(
    ("name", "late_s"), [("blocked", 2.0), ("blocked, dated", 0.0), ("lag", 1.0), ("lag, dated", 1.0)]
)
def test_a_camera_that_tells_its_times_proves_after_a_pause_that_nothing_lags(name, late_s):
    """Of pictures that nothing proves to be of now, each is dated or said to be late by as much as it may be."""
    frames, exposed = played(name, 300)
    while not frames.ended:
        frame = frames.next(0.1)
        if frame is not None and frame.index > 0:
            off_s = frame.exposure_s - exposed[frame.image.tobytes()]
            assert -0.01 < off_s < frames.late_s + 0.01
    assert frames.late_s == pytest.approx(late_s, abs=0.05)


@pytest.fixture
def onset(monkeypatch):
    """Sets the onset of a fault, earlier than in the study [s]; runs of all lengths have one truth."""

    def at(onset_s):
        for module in ("judge", "scripted", "scripts"):
            monkeypatch.setattr(f"experiments.studies.faults.{module}.ONSET_S", onset_s)
        return onset_s

    monkeypatch.setattr("experiments.studies.faults.scripted.undisturbed", lambda seed, _s: undisturbed(seed, 6.0))
    return at


def lasting(name: str, seconds: float) -> ScriptedFault:
    """A fault that is over after so long, if it does not stay."""
    fault = FAULTS[name]
    return replace(fault, lasts_s=min(fault.lasts_s, seconds)) if np.isfinite(fault.lasts_s) else fault


@pytest.mark.slow
@pytest.mark.parametrize(("name", "lasts_s", "seconds"), [("frozen in turn", 1.2, 2.5), ("all covered", 1.2, 2.3)])
def test_go_is_not_shown_on_a_faulty_estimate(name, lasts_s, seconds, onset, tmp_path):
    """One seed of two faults; before and after them GO is shown, so that there is something to withhold."""
    found = lasting(name, lasts_s).judged(SEED, tmp_path, duration_s=onset(2.5) + seconds)
    assert found.go_shown_while_faulty == 0
    assert found.go > 20
    assert found.noticed_ms is not None
    assert found.noticed_ms <= 1e3 * FAULTS[name].within_s
    assert found.recovered_ms is not None
    assert found.recovered_ms <= 500.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("needle bent", "ABORT: stop: draw back, or wait for GO; turned by"),
        ("needle unseen", "ABORT: stop: draw back, or wait for GO; the needle's tracker does not see it"),
        ("touched early", "ABORT: stop: draw back, or wait for GO; it went in before GO"),
        ("filter diverges", "all marks moved together, as when the camera is moved: look, then reset"),
        ("filter NaN", "INITIALISING: the estimate is INITIALISING"),
    ],
)
def test_what_the_loop_is_given_and_its_filter_may_fail(name, shown, onset, tmp_path, monkeypatch):
    """Within three frames it is shown, and GO is not; a needle that is drawn out, a filter of NaN: half a second on."""
    monkeypatch.setattr("experiments.studies.faults.scripts.LASTS_S", 0.6)
    found = lasting(name, 0.6).judged(SEED, tmp_path, duration_s=onset(3.0) + 1.4)
    assert shown in found.shown
    assert found.noticed_ms is not None
    assert found.noticed_ms <= 200.0
    assert found.go_shown_while_faulty == 0
    if name != "filter diverges":
        assert found.recovered_ms is not None
        assert found.recovered_ms <= 500.0


def test_a_run_is_a_row_of_the_study(monkeypatch):
    """What was judged, NaN for what never came; the case has the rest."""

    def judged(fault, seed, folder):
        assert folder.is_dir()
        return Judged(90.0, True, "LOST", None, 1.0, 2.0, 0, 9)

    monkeypatch.setattr(ScriptedFault, "judged", judged)
    row = run({"fault": "black", "seed": SEED})
    assert row.keys() == {field.name for field in fields(Judged)}
    assert (row["noticed_ms"], row["shown"], row["go"]) == (90.0, "LOST", 9)
    assert np.isnan(row["recovered_ms"])


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
            "ended": ["exit 0", "exit 2", ""],
            "lacks_s": [0.25, 0.5, np.nan],
        }
    )
    rows = summary(runs)
    assert list(rows["fault"]) == ["none", "blood"]
    blood = cells(rows)[1]
    assert blood[1:] == ["20 ms, 1 of 2", "COASTING", "x 3.0", "1 of 2", "400 ms", "3", "11", "exit 0; exit 2", "0.5 s"]
    assert cells(rows)[0][-2:] == ["–", "–"]
    quiet, bled, _, go = markdown(rows).splitlines()
    assert quiet == "- **no report**: no fault"
    blood = "blood as red as a mark runs over the picture"
    assert bled == f"- **COASTING**: {blood} (20 ms, 1 of 2, covered 1/2, GO wrong 3/11)"
    assert go == "GO wrong: 3 of 101."


def test_faults_that_show_the_same_share_a_line():
    seen = {"noticed": 2, "noticed_ms": 88.0, "seeds": 2, "covered": 2, "go_shown_while_faulty": 0, "go": 9}
    rows = pd.DataFrame([{"what": what, "shown": "LOST: the estimate is LOST", **seen} for what in ("dark", "bright")])
    assert by_shown(rows) == {"LOST": ["dark (88 ms)", "bright (88 ms)"]}


def test_the_page_shows_status_and_reason_without_advice():
    assert beginning("LOST: the estimate is LOST") == "LOST"
    assert beginning("TRACKING: a force on M1 goes on: look, then reset") == "TRACKING: a force on M1 goes on"
    assert beginning("ABORT: stop: draw back; now 47 %") == "ABORT: stop"
    assert (beginning("COASTING"), beginning("")) == ("COASTING", "")


def test_a_fault_that_there_is_not_is_refused(tmp_path):
    with pytest.raises(InputError, match="--only: expected one of none, unplugged"):
        study.faults_study(["flood"], range(1), tmp_path / "out", Workers(1))
    assert not (tmp_path / "out").exists()


def test_runs_that_take_place_in_real_time_are_done_first_and_one_by_one(tmp_path, monkeypatch):
    calls = []

    class Done:
        def checked(self):
            return pd.DataFrame({"fault": []})

    def run_study(_work, cases, folder, workers, _advance):
        folder.mkdir(exist_ok=True)
        calls.append(([(case["fault"], case["seed"]) for case in cases], workers.n_processes))
        return Done()

    monkeypatch.setattr(study, "run_study", run_study)
    study.faults_study(["KILL", "blood"], range(2), tmp_path / "some", Workers(4))
    every = [(name, seed) for name in ("KILL", "blood") for seed in range(2)]
    assert calls == [(every[:2], 1), (every, 4)]
    calls.clear()
    study.faults_study(["blood"], range(2), tmp_path / "others", Workers(4))
    assert calls == [(every[2:], 4)]
