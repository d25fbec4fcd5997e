"""Worlds that differ from their scene: what each does to marks, body and scene, a quick run, and the table."""

import itertools
import json
import tomllib

import numpy as np
import pandas as pd
import pytest

from dynamics import node_forces, rest_shape
from experiments.errors import InputError
from experiments.formats.scene.schema import SceneFile
from experiments.studies.faults.judge import ONSET_S, Moment
from experiments.studies.faults.world import BEGAN_S, INTERVAL_S, Motion
from experiments.studies.faults.wrong_worlds.__main__ import main, markdown, rows_of
from experiments.studies.faults.wrong_worlds.rows import WORLDS
from experiments.studies.faults.wrong_worlds.run import counted, run, stated_text, words_of
from experiments.studies.faults.wrong_worlds.simulated import (
    AS_STATED,
    BODIES,
    ScriptedMarks,
    Truth,
    lines_of,
    motion_of,
    scene_of_body,
    seen_of,
)

SEED = 7000


def seen(body: str = "four masses", duration_s: float = 7.0):
    """Marks of a body that rests."""
    scene = scene_of_body(body)
    times = np.arange(0.0, duration_s + 0.1, INTERVAL_S)
    motion = Motion(times, np.tile(scene.network.positions, (len(times), 1, 1)))
    return seen_of(scene, scene.measured_nodes, motion, SEED)


def displaced_mm(name: str, body: str = "four masses"):
    """By how much a world displaces each mark in each frame [mm], (n, n_marks), and the frames' times [s]."""
    before = seen(body)
    after = WORLDS[name].seen(before, np.random.default_rng(SEED))
    return 1e3 * np.linalg.norm(after.places - before.places, axis=2), before.exposed_s


@pytest.mark.parametrize("body", BODIES)
@pytest.mark.parametrize(
    ("name", "at_s", "mm"),
    [
        ("the camera drifts by 1 mm/s", 6.0, 2.0),
        ("the camera is moved by 10 mm", 6.0, 10.0),
        ("all marks move by 8 mm for half a second", 4.2, 8.0),
        ("all marks move by 8 mm for half a second", 4.6, 0.0),
    ],
)
def test_a_camera_that_moves_displaces_all_marks_alike(name, at_s, mm, body):
    by, times = displaced_mm(name, body)
    np.testing.assert_allclose(by[times < ONSET_S], 0.0, atol=1e-9)
    np.testing.assert_allclose(by[np.argmin(np.abs(times - at_s))], mm, atol=0.05)


@pytest.mark.parametrize("body", BODIES)
def test_a_turned_camera_keeps_distances_and_turns_by_two_degrees(body):
    """From the trace of the turn that fits best: of 2 degrees 2 cos in the plane, 1 + 2 cos in space."""
    before = seen(body)
    after = WORLDS["the camera is turned by 2 degrees"].seen(before, np.random.default_rng(SEED))
    a, b = before.places[-1], after.places[-1]
    left, _, right = np.linalg.svd((a - a.mean(axis=0)).T @ (b - b.mean(axis=0)))
    turn = right.T @ np.diag([*np.ones(len(right) - 1), np.linalg.det(right.T @ left.T)]) @ left.T
    assert np.trace(turn) == pytest.approx(2.0 * np.cos(np.deg2rad(2.0)) + len(turn) - 2.0, abs=1e-9)
    np.testing.assert_allclose(b - b.mean(axis=0), (a - a.mean(axis=0)) @ turn.T, atol=1e-12)


@pytest.mark.parametrize(
    ("name", "at_s", "mm"),
    [("a mark slides by 8 mm in 2 s", 5.0, 4.0), ("a mark is reattached 5 mm away", 5.0, 5.0)],
)
def test_one_mark_alone_is_displaced(name, at_s, mm):
    by, times = displaced_mm(name)
    assert sorted(by[np.argmin(np.abs(times - at_s))]) == pytest.approx([0.0, 0.0, mm], abs=0.1)


def test_values_freeze_to_the_last_digit_while_times_go_on():
    lines = lines_of(WORLDS["positions freeze for 2 s, times advance"].seen(seen(), np.random.default_rng(SEED)), 1e-3)
    frames = [json.loads(line) for _, line in lines]
    frozen = [one for one in frames if ONSET_S - 1e-6 <= one["time_s"] - BEGAN_S < ONSET_S + 2.0 - 1e-6]
    assert len(frozen) == 60
    assert all(one["marks"] == frozen[0]["marks"] for one in frozen)
    times = [one["time_s"] for one in frames]
    assert np.diff(times) == pytest.approx(INTERVAL_S)
    moving = [one for one in frames if one["time_s"] - BEGAN_S < ONSET_S - 0.05]
    assert all(one["marks"] != other["marks"] for one, other in itertools.pairwise(moving))


def test_times_are_late_fast_or_lack_and_marks_are_exchanged_or_astray():
    rng, before = np.random.default_rng(SEED), seen()
    late = WORLDS["an unstated delay of 100 ms"].seen(before, rng)
    np.testing.assert_allclose(late.stated_s - before.exposed_s, 0.1)
    np.testing.assert_allclose(late.arrive_s, late.stated_s)
    fast = WORLDS["the tracker's clock is 2 % fast"].seen(before, rng)
    assert fast.stated_s[-1] / fast.arrive_s[-1] == pytest.approx(1.02)
    half = WORLDS["half of the frames are lost"].seen(before, rng)
    assert 0.35 < len(half.places) / len(before.places) < 0.65
    swapped = WORLDS["two marks are exchanged"].seen(before, rng)
    np.testing.assert_array_equal(swapped.places[-1], before.places[-1][[1, 0, 2]])
    wild = np.linalg.norm(WORLDS["one mark in twenty has 10 mm error"].seen(before, rng).places - before.places, axis=2)
    assert 0.02 < (wild > 5e-3).mean() < 0.08
    assert wild.max() == pytest.approx(10e-3)


@pytest.mark.parametrize("body", BODIES)
@pytest.mark.parametrize("world", [name for name, one in WORLDS.items() if one.truth != AS_STATED])
def test_every_true_body_begins_at_rest(world, body):
    """At rest, which is stable, no node feels more than a thousandth of its weight."""
    network = WORLDS[world].truth.network(scene_of_body(body), np.random.default_rng(SEED))
    still = np.zeros_like(network.positions)
    forces = np.linalg.norm(node_forces(network, network.positions, still)[network.free], axis=1)
    assert (forces < 1e-3 * 9.81 * network.masses[network.free]).all()
    np.testing.assert_allclose(rest_shape(network), network.positions, atol=1e-5)


def test_a_truth_that_has_no_rest_is_no_scene_that_is_refused(monkeypatch):
    def fails(*_args):
        raise InputError("no rest")

    monkeypatch.setattr("experiments.studies.faults.wrong_worlds.simulated.moved", fails)
    with pytest.raises(RuntimeError, match="truth: no rest"):
        motion_of(scene_of_body("breast"), Truth(onset_s=0.5), SEED, 1.0)


@pytest.mark.parametrize("body", BODIES)
def test_every_scene_that_is_stated_has_the_form_of_a_scene_file(body):
    scene = scene_of_body(body)
    texts = [stated_text(world, scene) for world in WORLDS.values()]
    for text in set(texts):
        SceneFile.model_validate(tomllib.loads(text))
    assert len(set(texts)) >= 5  # friction, gravity twice, masses and stiffness; as it is


def test_a_target_rests_so_far_from_where_it_is_drawn():
    scene = scene_of_body("four masses")
    target = scene.network.index(scene.target.node)
    network = WORLDS["a target position error of 10 mm"].truth.network(scene, np.random.default_rng(1))
    away = np.linalg.norm(network.positions - scene.network.positions, axis=1)
    assert away[target] == pytest.approx(10e-3, abs=1e-6)
    assert np.delete(away, target).max() < 1e-6


def test_other_pushes_move_the_body_otherwise():
    """Of the same seed, by more than a millimetre; both begin at rest."""
    scene = scene_of_body("light phantom")
    usual = motion_of(scene, AS_STATED, SEED, 3.0).positions
    poked = motion_of(scene, WORLDS["the target is also poked"].truth, SEED, 3.0).positions
    breathing = motion_of(scene, WORLDS["a second breathing force, sideways"].truth, SEED, 3.0).positions
    apart = np.linalg.norm(poked - usual, axis=2).max(axis=1)
    assert apart[0] == 0.0
    assert apart.max() > 1e-3
    assert np.linalg.norm(breathing - usual, axis=2).max() > 1e-3


def test_keys_that_a_row_adds_stand_in_their_tables():
    world = WORLDS["a stated target position error of 10 mm"]
    lines = stated_text(world, scene_of_body("breast")).splitlines()
    assert lines[lines.index("[target]") + 1] == "position_sd_mm = 10.0"
    breast, drift = scene_of_body("breast"), WORLDS["the camera drifts by 1 mm/s, with reference marks"]
    assert stated_text(drift, breast).count("[[reference.mark]]") == int(breast.network.fixed.sum())


def test_a_script_gives_each_line_when_it_comes_and_ends_after_the_last():
    scene = scene_of_body("four masses")
    lines = lines_of(seen(duration_s=0.2), 1e-3)
    frames = ScriptedMarks(scene, lines)
    times, gaps = [], 0
    while not frames.ended:
        frame = frames.next(0.01)
        gaps += frame is None
        times += [] if frame is None else [frame.exposure_s - BEGAN_S]
    frames.close()
    np.testing.assert_allclose(times, INTERVAL_S * np.arange(len(lines)), atol=1e-9)
    assert gaps > 2 * len(lines)  # three waits of 10 ms between two frames


def moment(**changes) -> Moment:
    usual = {"status": "TRACKING", "advice": "GO", "error_m": 1e-3, "covered": True, "wrong": False}
    of_faults = {"time_s": 5.0, "age_s": 0.02, "why": "", "sigma_m": 1e-3, "well": True}
    return Moment(**usual | of_faults | changes)


def test_moments_are_counted():
    wrong, between = moment(wrong=True, covered=False, error_m=9e-3), moment(of_frame=False, wrong=True)
    moments = [moment()] * 5 + [wrong, between]
    moments += [moment(advice="NO_GUIDANCE", status="LOST", said="no mark for 1.5 s")] * 2
    found = counted(moments)
    expected = {"frames": 8, "tracking": 6, "tracking_wrong": 1, "covered": 5, "go": 7, "go_wrong": 2}
    assert {key: found[key] for key in expected} == expected
    assert found["error_mm"] == pytest.approx(1.0)
    assert (found["shown"], words_of(moments[-1])) == ("GO", "LOST: no mark for … s")


def test_a_row_of_which_any_body_is_beyond_half_a_percent_is_marked():
    usual = {"frames": 300, "tracking": 290, "tracking_wrong": 0, "covered": 280, "error_mm": 1.0, "shown": "GO"}
    runs = pd.DataFrame(
        [
            {"world": "nothing", "body": "breast", "go": 200, "go_wrong": 1, "refused": False, **usual},
            {"world": "a scale error of 3 %", "body": "breast", "go": 100, "go_wrong": 1, "refused": False, **usual},
            {"world": "masses stated in g", "body": "breast", "go": 0, "go_wrong": 0, "refused": True, **usual},
        ]
    )
    good, refused, marked = markdown(rows_of(runs)).splitlines()[2:5]
    assert good == "| nothing | 1/200 | 1.0 | 96.6% |"
    assert marked.startswith("| **a scale error of 3 %** | **1/100** |")
    assert refused.startswith("| masses stated in g | 0/0, refused 1/1 |")


def test_harmless_worlds_are_named_below_the_table():
    seen = {"body": "breast", "frames": 300, "tracking": 290, "tracking_wrong": 0, "go": 1200, "go_wrong": 0}
    seen |= {"refused": False, "shown": "GO", "covered": 288}  # 99.3 %
    errors = {"nothing": 0.3, "a scale error of 3 %": 1.2, "half of the frames are lost": 1.04}
    runs = pd.DataFrame([{"world": world, "error_mm": error_mm, **seen} for world, error_mm in errors.items()])
    assert markdown(rows_of(runs)).splitlines()[2:] == [
        "| a scale error of 3 % | 0/1200 | 1.2 | 99.3% |",
        "",
        "Differences with error ≤ 1 mm, coverage ≥ 99 %, no wrong GO: no difference; half of the frames are lost.",
        "",
        "Wrong GO: 0 of 3,600.",
    ]


def test_two_rows_are_run_and_written_and_a_row_counts_from_its_onset_on(tmp_path, capsys):
    """Of 4.5 s 135 frames count where nothing is wrong, 15 of a camera that is moved at 4 s; one more or less."""
    moved = "the camera is moved by 10 mm"
    options = ["--bodies", "light phantom", "--seeds", "1", "--first-seed", str(SEED), "--seconds", "4.5"]
    options += ["--out", str(tmp_path / "out"), "--processes", "1"]
    assert main([*options, "--only", "nothing", "--only", moved]) == 0
    rows = pd.read_csv(tmp_path / "out" / "wrong_worlds.csv").set_index("world")
    assert rows.loc["nothing", "frames"] == pytest.approx(135, abs=1)
    assert rows.loc[moved, "frames"] == pytest.approx(15, abs=1)
    assert rows.loc["nothing", "tracking"] > 120
    assert rows.loc["nothing", "go"] > 60  # of 75 after the first two seconds
    assert (rows.loc["nothing", "tracking_wrong"], rows.loc["nothing", "go_wrong"]) == (0, 0)
    assert (tmp_path / "out" / "wrong_worlds.md").read_text(encoding="utf-8") == capsys.readouterr().out


@pytest.mark.parametrize("body", BODIES)
@pytest.mark.parametrize("name", ["masses stated in g", "stiffness stated in N/mm"])
def test_a_scene_that_is_refused_counts_as_refused(name, body):
    found = run({"world": name, "body": body, "seed": SEED})
    assert (found["refused"], found["frames"], found["go"]) == (True, 0, 0)
    assert found["shown"].startswith("scene.toml: network.")
