"""Marks on a soft breast in drawn pictures of two cameras: by both, by one, covered, wrong; and whole films."""

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2

import vision
from experiments.arrays import Floats
from experiments.errors import InputError
from experiments.formats.recording import read_recording
from experiments.formats.scenario import read_scenario
from experiments.formats.scene.scene import Scene, write_scene
from experiments.pipeline import track
from experiments.pipeline.identify import check_shown
from experiments.pipeline.line import FILTER, Line
from experiments.pipeline.sight.camera import AGAIN, PATIENCE
from experiments.pipeline.sight.space import SpaceSight
from experiments.simulation.film import draw_in_space
from experiments.simulation.simulate import simulate
from tests.experiments.command import softaim
from tests.experiments.in_space import breast, dome
from tests.vision.cameras.test_space_camera import camera_at
from vision import Exposure, LostMark, Reason, SpaceCamera

PAGE = Path(__file__).parents[4] / "docs" / "cameras-in-space.md"

SHIFT_M = np.array([0.002, -0.001, 0.0015])
"""Of the body from where its marks are expected."""

Predict = Callable[[str], tuple[Floats, Floats]]
PredictAll = Callable[[Sequence[str]], tuple[Floats, Floats]]


def pictures(
    scene: Scene,
    rng: np.random.Generator,
    *,
    covered: Sequence[str] = (),
    by: Sequence[str] = ("left", "right"),
    moved_m: Floats = SHIFT_M,
) -> Exposure:
    """What the named cameras of a scene see of the body, moved from its drawing."""
    positions, light = scene.network.positions + moved_m, vision.Lighting()
    cameras = [camera for camera in scene.space_cameras if camera.name in by]
    drawn = {one.name: draw_in_space(scene, one, positions, light, rng, covered=covered) for one in cameras}
    return Exposure(0.0, drawn)


def expected_in(scene: Scene, sd_m: float = 0.003) -> tuple[PredictAll, Predict]:
    """Marks expected where they are drawn, with this error an axis [m]; the same after an impulse."""
    x, index = scene.network.positions, scene.network.index
    return (
        lambda nodes: (x[[index(node) for node in nodes]], np.tile(sd_m**2 * np.eye(3), (len(nodes), 1, 1))),
        lambda node: (x[index(node)], sd_m**2 * np.eye(3)),
    )


def place(scene: Scene, node: str) -> Floats:
    return scene.network.positions[scene.network.index(node)] + SHIFT_M


def test_errors_are_those_of_the_page() -> None:
    """The table of docs/cameras-in-space.md: rms along x and y, and along z, the cameras' view, to a quarter.

    Covariances are not below the scatter: the sum of NEES of all marks by chi-square.
    """
    rows = re.findall(r"\| ([\d.]+) mm \| ([\d.]+) mm \|", PAGE.read_text(encoding="utf-8"))
    stated, detected = np.array(rows, dtype=float)
    scene, rng, away, nees = breast(), np.random.default_rng(6), [], []
    point = np.array([[0.0, 0.0, 0.05]])
    places = np.array([camera.project(point)[0] for camera in scene.space_cameras])
    cov = vision.triangulated(scene.space_cameras, places, np.tile(0.01 * np.eye(2), (2, 1, 1))).covs[0]
    sds_mm = 1e3 * np.sqrt(np.diag(cov))
    np.testing.assert_allclose([np.hypot(*sds_mm[:2]) / np.sqrt(2.0), sds_mm[2]], stated, rtol=0.25)
    for _ in range(8):
        shift = rng.normal(0.0, 0.001, 3)
        found = SpaceSight(scene).find(pictures(scene, rng, moved_m=shift), *expected_in(scene))
        assert len(found) >= 5
        for mark in found:
            off = mark.position - scene.network.positions[scene.network.index(mark.node)] - shift
            nees.append(off @ np.linalg.solve(mark.cov, off))
            if np.sqrt(mark.cov.trace()) < 0.001:  # by two cameras
                away.append(off)
    assert np.sum(nees) < chi2.ppf(0.999, 3 * len(nees))
    rms_mm = 1e3 * np.sqrt(np.mean(np.square(away), axis=0))
    np.testing.assert_allclose([np.hypot(*rms_mm[:2]) / np.sqrt(2.0), rms_mm[2]], detected, rtol=0.25)


def test_a_mark_that_one_camera_sees_has_no_depth() -> None:
    scene, rng = breast(), np.random.default_rng(1)
    sight = SpaceSight(scene)
    found = {m.node: m for m in sight.find(pictures(scene, rng, by=["left"]), *expected_in(scene))}
    left = scene.space_cameras[0]
    for node in ("S1", "S2"):
        way = place(scene, node) - left.centre_m
        way /= np.linalg.norm(way)
        away, across = found[node].position - place(scene, node), np.eye(3) - np.outer(way, way)
        assert np.linalg.norm(across @ away) < 0.0002
        assert np.sqrt(way @ found[node].cov @ way) > 0.1
        assert np.sqrt(np.trace(across @ found[node].cov @ across)) < 0.0003


def test_a_covered_mark_is_missing_until_it_is_seen_again() -> None:
    scene, rng = breast(), np.random.default_rng(2)
    sight, predict = SpaceSight(scene, explain=True), expected_in(scene)

    def names(**keys: Sequence[str]) -> set[str]:
        return {mark.node for mark in sight.find(pictures(scene, rng, **keys), *predict)}

    assert "S1" in names()
    for _ in range(PATIENCE + AGAIN):
        assert "S1" not in names(covered=["S1"])
        assert sight.lost["S1"].reason is Reason.FEW_PIXELS
    # the others are still there, by the fast path
    assert len(names(covered=["S1"])) >= 4
    assert any("S1" in names() for _ in range(AGAIN))
    assert "S1" not in sight.lost


def test_a_rejected_detection_of_one_camera_has_no_place_in_the_pictures_of_others() -> None:
    scene, large = breast(), breast(diameter_m=0.012)
    sight = SpaceSight(scene, explain=True)
    sight.find(pictures(large, np.random.default_rng(5)), *expected_in(scene))
    assert {Reason.SIZE} <= {one.reason for one in sight.lost.values()}
    assert any(one.candidate_px is not None for own in sight.cameras.values() for one in own.lost.values())
    assert all(one.candidate_px is None for one in sight.lost.values())


def test_a_camera_that_looks_away_sees_nothing() -> None:
    away = camera_at(np.array([0.0, 0.0, 0.5]), np.array([0.0, 0.05, 1.0]), breast().space_cameras[0].lens)
    scene = replace(breast(), space_cameras=(breast().space_cameras[0], replace(away, name="away")))
    sight = SpaceSight(scene)
    seen = pictures(scene, np.random.default_rng(3), by=["left", "away"])
    found = sight.find(seen, *expected_in(scene))
    assert len(found) >= 4
    assert sight.find(Exposure(0.0, {"away": seen.images["away"]}), *expected_in(scene)) == ()
    assert {one.reason for one in sight.lost.values()} == {Reason.OUTSIDE}


def test_two_cameras_that_disagree_give_no_mark() -> None:
    scene = breast()
    left, right = scene.space_cameras
    turned: SpaceCamera = replace(right, pose=right.pose.moved(np.array([0.01, 0.0, 0.0, 0.0, 0.0, 0.0])))
    sight = SpaceSight(replace(scene, space_cameras=(left, turned)))
    found = sight.find(pictures(scene, np.random.default_rng(4)), *expected_in(scene, 0.006))
    both = {"S1", "S2"}
    assert not both & {mark.node for mark in found}
    lost: dict[str, LostMark] = sight.lost
    assert {lost[node].reason for node in both} == {Reason.APART}


def test_a_stated_error_of_the_calibration_is_shared_and_explains_it() -> None:
    scene, step = breast(), np.zeros((1, 15))
    step[0, 9] = 0.01
    left, right = scene.space_cameras
    turned = replace(right, pose=right.pose.moved(step[0, 9:]), calibration=step)
    stated = replace(scene, space_cameras=(left, turned))
    assert stated.n_calibration == 1
    found = SpaceSight(stated).find(pictures(scene, np.random.default_rng(4)), *expected_in(scene, 0.006))
    marks = {mark.node: mark for mark in found}
    assert {"S1", "S2"} <= marks.keys()
    for mark in marks.values():
        assert mark.shared is not None
        away = mark.position - place(scene, mark.node)
        # seen by cameras that are turned back by one standard deviation
        assert away @ np.linalg.solve(mark.total_cov, away) < 9.0


def test_a_later_picture_of_another_size_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder's first picture alone is compared when the recording is read."""
    scene, rng = breast(), np.random.default_rng(6)
    small = Exposure(0.1, {"left": np.zeros((240, 320, 3), np.uint8)})
    monkeypatch.setattr(track, "exposures_of", lambda _films: iter([pictures(scene, rng), small]))
    recording = SimpleNamespace(marks=None, films=True, scene=scene)
    with pytest.raises(InputError, match=r"size_px: expected \[320, 240\], like the frames, found \[640, 480\]"):
        list(track.each_frame(Line(scene, baseline=False), recording))


def test_sixty_marks_of_three_hues_keep_their_names() -> None:
    """Moved by 3 mm, and each by 1 mm of its own; all that face a camera are found."""
    scene, rng = dome(), np.random.default_rng(5)
    sight = SpaceSight(scene, explain=True)
    for _ in range(3):
        own = rng.normal(0.0, 0.001, scene.network.positions.shape)
        shift = np.array([0.002, 0.002, -0.001])
        found = sight.find(pictures(scene, rng, moved_m=own + shift), *expected_in(scene))
        assert len(found) >= 44
        assert {one.reason for one in sight.lost.values()} == {Reason.AWAY}
        for mark in found:
            i = scene.network.index(mark.node)
            away = mark.position - (scene.network.positions[i] + own[i] + shift)
            assert away @ np.linalg.solve(mark.cov, away) < chi2.ppf(1.0 - 1e-6, 3), mark.node


SCENARIO = """version = 1
scene = "scene.toml"
seed = 3
duration_s = {duration_s}
frame_interval_s = 0.033333
[tremor]
acceleration_m_s2_sqrt_hz = 0.05
[pokes]
acceleration_m_s2 = 10.0
shortest_s = 0.2
longest_s = 0.4
pause_s = 0.2
[video]
stagger_s = {stagger_s}
"""


def recorded(folder: Path, scene: Scene, **keys: float) -> Path:
    write_scene(scene, folder / "scene.toml")
    (folder / "film.toml").write_text(SCENARIO.format(**{"duration_s": 0.3, "stagger_s": 0.0, **keys}), "utf-8")
    simulate(read_scenario(str(folder / "film.toml")), folder / "rec")
    return folder / "rec"


def test_constants_are_not_identified_from_films_that_do_not_show_the_target(tmp_path, capsys):
    """Refused before the films are searched, with the way to a recording that shows it."""
    folder = recorded(tmp_path, breast(), duration_s=0.1)
    assert softaim("identify", folder, "--out", tmp_path / "found.toml") == 2
    what = "marks.csv with the marks of T (softaim simulate --no-film)"
    found = "films of cameras in space, which show no inner marks"
    assert capsys.readouterr().err == f"softaim: {folder}: expected {what}, found {found}\n"
    check_shown(read_recording(folder), ["S1"])  # on the skin, which films show


def test_nis_counts_the_coordinates_that_cameras_measure() -> None:
    """Three of a mark that both cameras see, two of one that a single camera sees."""
    scene, rng = breast(), np.random.default_rng(8)
    line, degrees = Line(scene, baseline=False), []
    for k, by in enumerate([("left", "right"), ("left",)]):
        seen = pictures(scene, rng, by=by, moved_m=np.zeros(3))
        estimate = line.see_all(Exposure(k / 30.0, seen.images)).estimates[FILTER]
        assert line.space is not None
        assert estimate.degrees == 3 * estimate.marks_used - len(line.space.single)
        assert line.filter.health.innovations[-1][2] == estimate.degrees
        degrees.append(estimate.degrees / estimate.marks_used)
    assert degrees[0] > 2.5
    assert degrees[1] == 2.0
