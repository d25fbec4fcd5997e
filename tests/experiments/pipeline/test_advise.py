"""`softaim advise`: from a recording and a needle's file to a table and a picture; faults of the file in one line."""

import shutil
from dataclasses import astuple
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest

from dynamics import OUTER, four_mass_phantom
from estimators import AdviceSettings, Hit, Needle
from experiments.formats.needle_file import read_needle
from experiments.formats.recording import read_recording
from experiments.formats.scene.reference import Reference
from experiments.formats.scene.scene import Mark, Scene, Target
from experiments.pipeline.advise import advise, observed_hits, push_m, reliability, table
from experiments.pipeline.integrity import UNTESTED
from tests.experiments.command import softaim
from tests.experiments.pipeline.tables import near, write_recording
from tests.experiments.rows import complaint

PHANTOM = four_mass_phantom()
MARKS, TARGET = tuple(Mark(node, 0.0, 0.03) for node in OUTER), Target("M2", 0.005, position_sd_m=0.0)
SCENE = Scene(PHANTOM, MARKS, TARGET, (), reference=Reference(drift_sd_m=0.0))
REST_MM = 1e3 * PHANTOM.positions[PHANTOM.index("M2")]
GOOD = (Path(__file__).parents[1] / "needle.toml").read_text(encoding="utf-8")
OUTSIDE = GOOD.replace("depth_mm = 2.0", "depth_mm = 0.0")
LEAST = "version = 1\nentry_mm = [0.0, 215.0]\ndirection = [0.0, -2.0]\nspeed_mm_s = 200.0\n"
COLUMNS = [
    *("time_s", "advice", "reason", "arrival_s", "p_hit", "aim_x_mm", "aim_y_mm"),
    *("lateral_mm", "depth_mm", "turn_deg", "p_turned", "best_in_s", "p_best"),
]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "needle.toml"


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Marks of the phantom at rest, to a micrometre, for three seconds, 30 frames/s, none from 2.5 to 2.8 s."""
    times, rng = np.arange(90) / 30, np.random.default_rng(0)
    frames = [(t, near(SCENE, OUTER, 1e-6, rng)) for t in times[(times < 2.5) | (times > 2.8)]]
    folder = write_recording(tmp_path_factory.mktemp("rest") / "rec", SCENE, frames, 1.0)
    pd.DataFrame({"frame": range(90), "exposure_s": times}).to_csv(folder / "frames.csv", index=False)
    return folder


@pytest.fixture(scope="module")
def with_truth(recording: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same, with a truth 3 mm beside the resting target."""
    folder = shutil.copytree(recording, tmp_path_factory.mktemp("truth") / "rec")
    truth = pd.DataFrame({"time_s": np.arange(91) / 30, "node": "M2", "x_mm": REST_MM[0] + 3.0, "y_mm": REST_MM[1]})
    truth.to_csv(folder / "truth.csv", index=False)
    return folder


def test_everything_that_the_file_says_is_taken(path):
    path.write_text(GOOD)
    plan = read_needle(path, 0.005, 2)
    assert plan.needle.hit is Hit.CORE
    assert astuple(plan.needle)[1:] == pytest.approx((6e-3, 18e-3, 4e-3, 0.4e-3, 0.03))
    assert plan.settings == AdviceSettings(0.8, 0.1, 0.4, 0.05, 0.15, 0.12, 0.7, 2e-3, 0.4, 0.3)
    assert (plan.insertion.speed_m_s, plan.insertion.depth_m) == (pytest.approx(0.2), pytest.approx(2e-3))
    np.testing.assert_allclose(plan.insertion.entry, [0.0, 0.215])
    np.testing.assert_allclose(plan.insertion.axis, [0.0, -1.0])
    np.testing.assert_allclose(plan.lesion.axes, 1e-3 * np.array([[6.0, 1.0], [0.0, 8.0]]))


def test_what_it_does_not_say_is_the_usual_and_the_scenes_radius(path):
    path.write_text(LEAST)
    plan = read_needle(path, 0.007, 2)
    assert (plan.needle, plan.settings) == (Needle(), AdviceSettings())
    np.testing.assert_allclose(plan.lesion.axes, 0.007 * np.eye(2))
    np.testing.assert_allclose(plan.insertion.axis, [0.0, -1.0])


@pytest.mark.slow
def test_a_recording_gets_advice_at_every_frame(recording, path, tmp_path, capsys):
    """No guidance before 2 s of marks and from 0.12 s after the last; else the target rests on the needle's line."""
    path.write_text(OUTSIDE)
    out = tmp_path / "out"
    assert softaim("advise", recording, "--needle", path, "--out", out) == 0
    rows = pd.read_csv(out / "advice.csv")
    assert list(rows.columns) == COLUMNS
    assert len(rows) == 90
    none = (rows["time_s"] < 1.99) | rows["time_s"].between(2.466 + 0.12, 2.8)
    assert set(rows["advice"][none]) == {"NO_GUIDANCE"}
    assert set(rows["advice"][~none]) <= {"GO", "WAIT"}
    assert rows.loc[none, COLUMNS[3:]].isna().all(axis=None)
    assert rows.loc[~none].notna().all(axis=None)
    assert UNTESTED in set(rows["reason"])
    assert any(reason.startswith("no mark was seen for") for reason in rows["reason"])
    sure = rows[~none].iloc[8]
    np.testing.assert_allclose(sure[["aim_x_mm", "aim_y_mm"]].astype(float), REST_MM, atol=12.0)
    assert sure["depth_mm"] == pytest.approx(215.0 - sure["aim_y_mm"] + 15.0, abs=1e-6)
    assert sure["lateral_mm"] == pytest.approx(abs(sure["aim_x_mm"]), abs=1e-6)
    assert sure["arrival_s"] - sure["time_s"] == pytest.approx(sure["depth_mm"] / 200.0, abs=1e-6)
    said = f"90 frames: GO {(rows['advice'] == 'GO').sum()}, WAIT {(rows['advice'] == 'WAIT').sum()}, REALIGN 0,"
    assert said in capsys.readouterr().out
    picture = cv2.imread(str(out / "advice.png"))
    assert picture.std() > 10.0
    # every 0.25 s: the first frame and each eighth after it; nothing is observed without a truth
    some = advise(read_recording(recording), read_needle(path, 0.005, 2), every_s=0.25)
    assert reliability(some)["predicted"] is None
    every = rows.iloc[::8].reset_index(drop=True)
    pd.testing.assert_frame_equal(table(some), every, check_dtype=False, rtol=0, atol=1e-6)


def test_a_needle_that_is_inside_is_to_stop_where_there_is_no_guidance(recording, path):
    """The same with its tip 2 mm deep: ABORT from the first frame on, and for `abort_s` after each reason for it."""
    path.write_text(GOOD)
    rows = table(advise(read_recording(recording), read_needle(path, 0.005, 2), every_s=0.1))
    aborted = (rows["time_s"] < 1.99 + 0.3) | rows["time_s"].between(2.466 + 0.12, 2.9)
    assert set(rows["advice"][aborted]) == {"ABORT"}
    assert "NO_GUIDANCE" not in set(rows["advice"])
    assert rows["reason"].iloc[0] == f"stop: draw back, or wait for new advice; {UNTESTED}"


def test_a_needle_beside_the_target_is_advised_to_turn(recording, path):
    """From 100 mm beside the resting target, straight down: by the angle between that and the way to the aim."""
    entry = REST_MM + np.array([100.0, 40.0])
    path.write_text(OUTSIDE.replace("[0.0, 215.0]", str(entry.tolist())).replace("go = 0.8", "go = 0.3"))
    last = table(advise(read_recording(recording), read_needle(path, 0.005, 2), every_s=0.2)).iloc[-1]
    way = last[["aim_x_mm", "aim_y_mm"]].to_numpy(dtype=float) - entry
    assert last["advice"] == "REALIGN"
    assert last["turn_deg"] == pytest.approx(np.degrees(np.arctan2(100.0, 40.0)), abs=5.0)
    assert last["lateral_mm"] == pytest.approx(-way[0], abs=1e-6)
    assert last["p_turned"] > 0.3 > last["p_hit"]
    assert f"turned by {last['turn_deg']:.1f} deg" in last["reason"]


BAD = {
    "still": ("speed_mm_s = 200.0", "speed_mm_s = 0.0", ": speed_mm_s: expected 0.01 or more, found 0.0"),
    "slow": ("speed_mm_s = 200.0", "speed_mm_s = 1e-300", ": speed_mm_s: expected 0.01 or more, found 1e-300"),
    "far": ("entry_mm = [0.0, 215.0]", "entry_mm = [0.0, 1e300]", ": entry_mm[1]: expected 1e+06 or less, found"),
    "long": ("direction = [0.0, -1.0]", "direction = [0.0, -1e300]", ": direction[1]: expected -1e+06 or more, found"),
    "short": ("direction = [0.0, -1.0]", "direction = [0.0, -1e-300]", ": direction: expected a non-zero vector,"),
    "vague": ("tip_sd_mm = 0.4", "tip_sd_mm = 1e200", ": tip_sd_mm: expected 1e+06 or less, found 1e+200"),
    "space": ("entry_mm = [0.0, 215.0]", "entry_mm = [0.0, 1.0, 2.0]", ": entry_mm: expected 2 numbers, as the scene"),
    "nowhere": ("direction = [0.0, -1.0]", "direction = [0.0, 0.0]", ": direction: expected a non-zero vector,"),
    "kind": ('hit = "CORE"', 'hit = "SIDE"', ": hit: expected 'TIP', 'NOTCH' or 'CORE', found \"SIDE\""),
    "core": ("core_mm = 4.0", "core_mm = 19.0", ": core_mm: expected no more than notch_length_mm (18), found 19"),
    "axes": ("[1.0, 8.0]]", "[12.0, 0.0]]", ": lesion.semi_axes_mm: expected 2 vectors of 2 numbers, none in the span"),
    "axes in space": ("[1.0, 8.0]]", "[1.0, 8.0, 0.0]]", ": lesion.semi_axes_mm: expected 2 vectors of 2 numbers,"),
    "both": ("[lesion]\n", "[lesion]\nradius_mm = 3.0\n", ": lesion: expected either radius_mm or semi_axes_mm, found"),
    "sure": ("go = 0.8", "go = 1.1", ": advice.go: expected 1 or less, found 1.1"),
    "never": ("step_s = 0.05", "step_s = 0.0", ": advice.step_s: expected 0.001 or more, found 0.0"),
}


@pytest.mark.parametrize("fault", BAD)
def test_faults_are_reported_in_one_line(path, fault):
    old, new, message = BAD[fault]
    assert old in GOOD
    path.write_text(GOOD.replace(old, new, 1))
    assert complaint(read_needle, path, 0.005, 2).startswith(f"{path}{message}")


def test_the_observed_rate_is_the_share_of_tips_in_the_true_lesion(with_truth, path):
    """The truth 3 mm beside the needle's line: of tips of 2 mm an axis, 20,000 drawn, so many lie within 5 mm of it.

    The push is known to 30 % at most.

    Where the truth ends before the needle arrives, nothing is known: 0.275 s to the target, of three seconds.
    """
    path.write_text(
        f"version = 1\nentry_mm = [{REST_MM[0]}, {REST_MM[1] + 55.0}]\ndirection = [0.0, -1.0]\nspeed_mm_s = 200.0\n"
        "hit = 'TIP'\ntip_sd_mm = 2.0\nbending_sd_mm_per_mm = 0.0\n"
        "[forces]\ncutting_N = 4.0\nfriction_N_m = 0.0\n[lesion]\nradius_mm = 5.0\n"
    )
    done = advise(read_recording(with_truth), plan := read_needle(path, 0.005, 2), every_s=0.06)
    true = observed_hits(done)
    rng = np.random.default_rng(0)
    pushed_mm = 1e3 * push_m(done.recording.scene, plan)
    assert np.linalg.norm(pushed_mm) > 10.0
    drawn = rng.normal([-3.0, 0.0], 2.0, (20_000, 2)) - 0.3 / np.sqrt(3.0) * rng.normal(size=(20_000, 1)) * pushed_mm
    share = float((np.linalg.norm(drawn, axis=1) <= 5.0).mean())
    known = np.isfinite(true)
    np.testing.assert_allclose(true[known], share, atol=0.02)
    arrivals = np.array([np.inf if one.arrival_s is None else one.arrival_s for one in done.guidance])
    np.testing.assert_array_equal(known, arrivals <= 3.0)
    assert known.sum() > 5
    found = reliability(done)
    assert found["insertions"] == known.sum()
    assert found["observed"] == pytest.approx(share, abs=0.02)
    assert np.isfinite(table(done)["observed"]).sum() == known.sum()
