"""Advice in the live loop: as `softaim advise` gives it, none where marks or frames stop, and by the breath."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from dynamics import HIDDEN, OUTER, four_mass_phantom, independent_uncertainty, parameters
from estimators import Advice, Guidance, NeedlePush, TissueFilter, guide, path_reach_s
from experiments.formats.needle_file import NeedleForces, NeedlePlan, read_needle
from experiments.formats.recording import Recording, read_recording
from experiments.formats.scene.scene import Scene
from experiments.pipeline.advise import advise, header, table
from experiments.pipeline.integrity import UNTESTED
from experiments.pipeline.live.advice import LiveAdvice, words
from experiments.pipeline.live.session import Session
from experiments.simulation.simulate import scene_of, simulate
from tests.experiments.command import softaim
from tests.experiments.pipeline.live import test_session
from tests.experiments.pipeline.live.test_session import INTERVAL, Clocked, frames_at, image
from tests.experiments.pipeline.tables import measured
from tests.experiments.webcam import coarse_webcam
from vision import Frame

__all__ = ["image"]

NEEDLE = "version = 1\nentry_mm = [0.0, 215.0]\ndirection = [0.0, -1.0]\nspeed_mm_s = 200.0\n"
NEEDLE += "[forces]\ncutting_N = 0.0\nfriction_N_m = 0.0\n"
NEEDLE += "[lesion]\nradius_mm = 2.5\n[advice]\ngo = 0.75\nhorizon_s = 0.3\n"


@pytest.fixture(scope="module")
def needle_file(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("needle") / "needle.toml"
    path.write_text(NEEDLE)
    return path


@pytest.fixture(scope="module")
def plan(needle_file) -> NeedlePlan:
    return read_needle(needle_file, 0.005, 2)


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Recording:
    """2.7 s of the poked phantom before a webcam."""
    folder = tmp_path_factory.mktemp("film") / "rec"
    webcam = coarse_webcam()
    pokes = webcam.pokes.model_copy(update={"pause_s": 0.2})
    simulate(webcam.model_copy(update={"duration_s": 2.7, "pokes": pokes}), folder)
    opened = read_recording(folder)
    return replace(opened, scene=known(opened.scene))


def known(scene: Scene) -> Scene:
    """The scene that says of its constants and its camera that they are as good as exact."""
    exact = independent_uncertainty(parameters(scene.network, ("stiffness",))[:1], 1e-9)
    return replace(scene, uncertainty=exact, cameras=tuple(replace(one, scale_sd=0.0) for one in scene.cameras))


def run(
    source: Clocked,
    folder: Path,
    plan: NeedlePlan,
    tested_s: float | None = -np.inf,
    attend: Callable[[Session], None] = lambda _session: None,
) -> tuple[Session, pd.DataFrame, list[tuple[float, str]]]:
    """The session, its forces tested, the rows of advice.csv, and what was shown when; attend: at each turn."""
    session, _, shown = test_session.run(source, folder, attend, known(scene_of(coarse_webcam())), plan, tested_s)
    return session, pd.read_csv(folder / "advice.csv"), shown


def test_it_is_the_advice_of_a_recording(tmp_path, recording, plan):
    """Frames at their exposure: rows as in `softaim advise`, except for the effect of tables on the path.

    Pokes come every 0.2 s here and turn springs: aims are some tenths of a millimetre apart, 95 of 100 within 1.5 mm,
    and of 81 frames 8 at most fall on the other side of a threshold.
    """
    with recording.open_frames() as frames:
        source = Clocked([(frame.exposure_s, frame) for frame in frames], [], 2.7)
    source.now = 0.0
    _, rows, _ = run(source, tmp_path, plan, tested_s=None)
    reported = table(advise(recording, plan))
    assert [*rows.columns, "observed"] == list(reported.columns)  # the truth is not known while frames come
    assert len(rows) == len(reported) == 81
    np.testing.assert_allclose(rows["time_s"], reported["time_s"], atol=1e-9)
    assert {"GO", "NO_GUIDANCE"} < set(reported["advice"])
    assert (rows["advice"] != reported["advice"]).sum() <= 8
    both = rows["p_hit"].notna() & reported["p_hit"].notna()
    assert both.sum() > 15
    for column, usual, most in (("p_hit", 0.02, 0.2), ("aim_x_mm", 0.3, 1.5), ("arrival_s", 3e-3, 1e-2)):
        off = (rows[column] - reported[column])[both].abs()
        assert off.median() < usual
        assert off.quantile(0.95) < most
    started = reported["reason"] == UNTESTED
    assert started.sum() >= 59
    assert (rows["reason"] == reported["reason"])[started].all()


def test_no_guidance_as_soon_as_frames_are_missing_and_again_some_after(tmp_path, plan, image):
    """Half a second of frames, 1 s of none, half a second again, with 20 ms to arrive; the rule is 0.1 s (stale_s)."""
    before, after = (np.round(at + INTERVAL * np.arange(15), 9) for at in (100.0, 101.5))
    source = Clocked(frames_at(before, image) + frames_at(after, image), [], 102.0)
    session, rows, shown = run(source, tmp_path, plan)
    gap = rows[(rows["time_s"] > before[-1]) & (rows["time_s"] < after[0])]
    assert set(gap["advice"]) == {"NO_GUIDANCE"}
    assert gap["reason"].iloc[0] == "the estimate is 0.12 s old, more than 0.1 s"
    assert len(gap) >= 9
    assert rows["advice"].iloc[14] in ("GO", "WAIT", "REALIGN")
    assert rows["advice"].iloc[-1] != "NO_GUIDANCE"
    silent = [t for t, text in shown if "NO GUIDANCE" in text and t > before[-1]]
    assert silent[0] == pytest.approx(before[-1] + 0.12, abs=1e-6)
    assert sum(session.advice.counts.values()) == len(rows)
    # a needle that starts now arrives later than one that starts at the exposure
    frame = rows.iloc[14]
    assert frame["arrival_s"] - frame["time_s"] - 0.02 == pytest.approx(frame["depth_mm"] / 200.0, abs=1e-6)


def test_an_impatient_needle_is_reported_sooner(tmp_path, plan, image):
    """stale_s of 50 ms: a frame is waited for no longer than that."""
    impatient = replace(plan, settings=replace(plan.settings, stale_s=0.05))
    source = Clocked(frames_at(100.0 + INTERVAL * np.arange(15), image), [], 101.0)
    _, rows, _ = run(source, tmp_path, impatient)
    assert rows["time_s"].iloc[15] == pytest.approx(100.0 + 14 * INTERVAL + 0.02 + 0.05)
    assert rows["advice"].iloc[15] == "NO_GUIDANCE"


def test_no_guidance_when_marks_vanish(tmp_path, plan, image):
    """Frames go on without marks: after 0.2 s (coasting_s) nothing is said of the needle."""
    times = 100.0 + INTERVAL * np.arange(30)
    blank = np.full_like(image, 128)
    frames = [(t + 0.02, Frame(k, t, image if k < 15 else blank)) for k, t in enumerate(times)]
    _, rows, shown = run(Clocked(frames, [], times[-1] + 0.021), tmp_path, plan)
    unseen = rows["time_s"] + 0.02 - times[14]
    assert set(rows["advice"][unseen > 0.2]) == {"NO_GUIDANCE"}
    assert "NO_GUIDANCE" not in set(rows["advice"][(unseen <= 0.2) & (unseen > -0.2)])
    assert rows["reason"][unseen > 0.2].iloc[0] == "no mark was seen for 0.22 s, more than 0.2 s"
    assert "NO GUIDANCE: " in shown[-1][1]


def at_rest(tissue):
    """Six estimates of marks that stand still, 30 a second."""
    for k in range(6):
        tissue.predict(k / 30.0)
        yield tissue.update(measured(tissue, OUTER, 1e-3))


def test_it_aims_at_where_the_target_is_once_the_needle_has_pushed_it(tmp_path, plan):
    """For a phantom at rest, the two aims differ by the push of this needle's forces, deeper along its line."""
    network = four_mass_phantom()
    tissue = TissueFilter(network, HIDDEN, OUTER)
    *_, estimate = at_rest(tissue)
    aims = []
    pushing = replace(plan, forces=NeedleForces())
    for k, one in enumerate((plan, pushing)):
        advice = LiveAdvice(one, tissue, tmp_path / f"advice{k}.csv")
        aims.append(advice.seen(tissue, estimate, estimate.time_s).aim)
        advice.table.close()
    shift = NeedlePush(network, HIDDEN, pushing.forces.planned(network)).shift(plan.insertion)
    assert shift[1] < -1e-3
    np.testing.assert_allclose(aims[1] - aims[0], shift, atol=1e-4)


def test_a_filter_with_unknown_constants_has_tables_too(tmp_path, plan):
    """At rest, where they are exact but for friction: aim and covariance are those of `guide`, 0.05 mm and 15 %."""
    network = four_mass_phantom()
    unsure = independent_uncertainty(parameters(network, ("stiffness",))[:1], 0.1)
    tissue = TissueFilter(network, HIDDEN, OUTER, uncertainty=unsure)
    advice = LiveAdvice(plan, tissue, tmp_path / "advice.csv")
    *_, said = (advice.seen(tissue, estimate, estimate.time_s) for estimate in at_rest(tissue))
    advice.table.close()
    exact = guide(
        tissue, tissue.predict_at(5 / 30.0), plan.insertion, plan.lesion, needle=plan.needle, settings=plan.settings
    )
    np.testing.assert_allclose(said.aim, exact.aim, atol=5e-5)
    assert np.sqrt(np.trace(said.cov) / np.trace(exact.cov)) == pytest.approx(1.0, abs=0.15)


def test_tables_reach_as_far_as_the_needle_and_no_further_than_they_must(plan):
    """27 mm and 15 mm of reach and 50 mm at 200 mm/s, 0.3 s of starts, 0.5 and 0.1 s; a crawling needle: 30 s."""
    tissue = TissueFilter(four_mass_phantom(), HIDDEN, OUTER)
    way_m = 0.215 - four_mass_phantom().positions[four_mass_phantom().index(HIDDEN), 1] + 0.015 + 0.05
    assert path_reach_s(tissue, plan.insertion, plan.needle, plan.settings) == pytest.approx(
        0.3 + way_m / 0.2 + 0.1, abs=1e-3
    )
    crawling = replace(plan.insertion, speed_m_s=1e-5)
    assert path_reach_s(tissue, crawling, plan.needle, plan.settings) == pytest.approx(30.4)


def test_words_say_what_where_and_why():
    said = Guidance(
        Advice.REALIGN, "why", 1.0, 0.6199, np.array([0.001, 0.1884]), None, 0.0021, 0.0421, np.radians(4.3)
    )
    assert words(said) == "REALIGN 61 %  aim (1.0, 188.4) mm, lateral 2.1 mm, turn 4.3 deg, 42.1 mm to go: why"
    assert words(Guidance(Advice.NO_GUIDANCE, "the estimate is LOST")) == "NO GUIDANCE: the estimate is LOST"


def test_the_command_writes_advice_beside_the_estimates(recording, tmp_path, needle_file, capsys):
    """A recording played live for a second; without --needle there is no advice."""
    out, plain, words = tmp_path / "out", tmp_path / "plain", ("live", "--source", recording.folder, "--no-page")
    assert softaim(*words, "--needle", needle_file, "--duration", 1.0, "--out", out) == 0
    rows, estimates = pd.read_csv(out / "advice.csv"), pd.read_csv(out / "estimates.csv")
    assert list(rows.columns) == header(2)
    assert set(estimates["time_s"]) <= set(rows["time_s"])
    printed = capsys.readouterr().out
    assert f"Advice in {out / 'advice.csv'}: GO {(rows['advice'] == 'GO').sum()}, WAIT" in printed
    assert softaim(*words, "--duration", 0.2, "--out", plain) == 0
    names = {path.name for path in plain.iterdir()}
    assert names == {"estimates.csv", "provenance.json", "scene.toml", "softaim.log"}
    assert "Advice" not in capsys.readouterr().out


def test_of_a_film_advice_has_its_own_times(tmp_path, recording, plan):
    """The same frames 60 s later on the clock: a needle's arrival is in the film's own time."""
    with recording.open_frames() as film:
        frames = list(film)[:20]
    own, later = (
        Clocked([(by_s + f.exposure_s, replace(f, exposure_s=by_s + f.exposure_s)) for f in frames], [], by_s + 0.65)
        for by_s in (0.0, 60.0)
    )
    own.now, later.now, later.origin_s = 0.0, 60.0, 60.0
    (tmp_path / "later").mkdir()
    first, second = run(own, tmp_path, plan)[1], run(later, tmp_path / "later", plan)[1]
    assert first["arrival_s"].notna().any()
    for column in ("time_s", "arrival_s"):
        np.testing.assert_allclose(second[column], first[column], rtol=0, atol=1e-6)


def test_a_tracked_needle_is_to_stop_when_frames_are_missing_and_it_is_inside(tmp_path, plan, image):
    """It is seen 5 mm below the stated entry before half a second without frames, and out again before its end."""
    before = np.round(100.0 + INTERVAL * np.arange(15), 9)
    source = Clocked(frames_at(before, image), [], 101.0)

    def tracked(session: Session) -> None:
        inside = 100.4 < source.now < 100.8
        session.needle_at(np.array([0.0, 0.21 if inside else 0.22]), np.array([0.0, -1.0]))

    rows = run(source, tmp_path, plan, None, tracked)[1]
    gap = rows[rows["time_s"] > before[-1] + 0.1]
    assert set(gap["advice"][gap["time_s"] < 100.8]) == {"ABORT"}
    assert gap["reason"].iloc[0].endswith("; the estimate is 0.12 s old, more than 0.1 s")
    assert set(gap["advice"][gap["time_s"] > 100.9]) == {"NO_GUIDANCE"}
    # it went in though it was not given GO
    assert set(rows["advice"][(rows["time_s"] > 100.42) & (rows["time_s"] <= before[-1])]) == {"ABORT"}
    assert "ABORT" not in set(rows["advice"][rows["time_s"] <= 100.4])


def test_of_a_needle_that_its_tracker_does_not_see_or_no_more_reports_there_is_no_advice(tmp_path, plan, image):
    """Unseen outside for 0.2 s, seen inside, unseen there for 0.2 s, seen outside; then inside, silent from 1.5 s on.

    A pose outside comes at 2.2 s; the rule is 0.4 s (needle_s).
    """
    source = Clocked(frames_at(np.round(100.0 + INTERVAL * np.arange(75), 9), image), [], 102.6)

    def tracked(session: Session) -> None:
        now = source.now - 100.0
        inside = 0.7 < now < 1.1 or 1.3 < now < 2.2
        if 0.4 < now < 0.6 or 0.8 < now < 1.0:
            session.needle_unseen()
        elif now < 1.5 or now > 2.2:
            session.needle_at(np.array([0.0, 0.21 if inside else 0.22]), np.array([0.0, -1.0]))

    plan = replace(plan, settings=replace(plan.settings, needle_s=0.4))
    rows = run(source, tmp_path, plan, attend=tracked)[1]
    times, reasons = rows["time_s"] - 100.0, rows["reason"].fillna("")
    unseen = reasons.str.endswith("the needle's tracker does not see it")
    assert set(rows["advice"][unseen & (times < 0.7)]) == {"NO_GUIDANCE"}
    assert set(rows["advice"][unseen & (times > 0.7)]) == {"ABORT"}
    assert unseen[times.between(0.44, 0.56) | times.between(0.84, 0.96)].all()
    assert not unseen[(times < 0.36) | times.between(0.62, 0.76) | (times > 1.02)].any()
    silent = reasons.str.contains(r"the needle's tracker has sent no pose for 0\.\d s, more than 0\.4 s$")
    assert silent[times.between(1.92, 2.18)].all()
    assert set(rows["advice"][silent]) == {"ABORT"}
    assert not silent[(times < 1.86) | (times > 2.24)].any()
