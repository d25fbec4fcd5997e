"""`softaim check`: what it says of a scene, against closed forms and scenes each of which lacks one thing."""

import json
from contextlib import ExitStack
from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np
import pytest

from dynamics import build_network, four_mass_phantom, independent_uncertainty, parameters, rest_shape
from estimators import FilterSettings
from experiments.commands.run import Run
from experiments.errors import InputError
from experiments.formats.recording import MarkRow, write_frames_csv, write_marks_csv
from experiments.formats.scene.marks import Mark
from experiments.formats.scene.reference import Reference, ReferenceMark
from experiments.formats.scene.scene import Scene, usable_scene, write_scene
from experiments.formats.scene.target import Target
from experiments.log import Kept
from experiments.plain import plain
from experiments.projects.check import SceneCheck, _seen, checked
from experiments.projects.report import check_lines, check_report, missing
from experiments.simulation.film import draw
from tests.experiments.command import softaim
from tests.experiments.in_space import breast
from vision import Lighting, VideoWriter, fronto_parallel_camera

K, M, G = 400.0, 0.1, 9.81


def hanging(**changes) -> Scene:
    """Two masses on a cord from a hook, the upper one hidden, the lower one marked."""
    names, places = ["hook", "T", "M"], [[0.0, 0.0], [0.0, -0.1], [0.0, -0.2]]
    constants = {"stiffness": K, "masses": [0.0, M, M], "damping": 0.2, "rest_lengths": "as drawn"}
    network = build_network(names, places, list(pairwise(names)), gravity=[0.0, -G], fixed=["hook"], **constants)
    marks = (Mark("M", 0.0, 0.01), Mark("T", 120.0, 0.01, measured=False))
    camera = fronto_parallel_camera("front", (320, 240), (1.5, 1.5), (0.0, -0.1))
    return replace(Scene(network, marks, Target("T", 0.005, position_sd_m=5e-4), (camera,)), **changes)


def report_of(scene: Scene, tmp_path, **options):
    write_scene(scene, tmp_path / "scene.toml")
    return check_report(checked(tmp_path / "scene.toml", **options))


@pytest.fixture(scope="module")
def hung(tmp_path_factory) -> dict:
    return report_of(hanging(), tmp_path_factory.mktemp("hanging"))


def test_it_says_where_the_scene_rests_and_how_it_oscillates(hung) -> None:
    """T sags by 2 m g / k, M by m g / k more. Along the cord w² = (3 ± sqrt 5) / 2 k / m, damped by c w / 2 k."""
    sag = 1e3 * M * G / K
    offsets = {"offset_mm": pytest.approx(3 * sag), "target_offset_mm": pytest.approx(2 * sag)}
    assert hung["rest"] == {"node": "M", "drawn": False, **offsets}
    w = np.sqrt((3 - np.sqrt(5)) / 2 * K / M)
    motion = hung["motion"]
    k = int(np.argmin(np.abs(np.array(motion["frequencies_hz"]) - w / (2 * np.pi))))
    assert motion["frequencies_hz"][k] == pytest.approx(w / (2 * np.pi), rel=1e-6)
    assert motion["damping_ratios"][k] == pytest.approx(0.2 * w / (2 * K), rel=1e-4)
    assert motion["slowest_decay_s"] is None


def test_it_says_how_steps_and_marks_are(hung) -> None:
    """RK4 is stable up to 2.6 / w of the stiffest motion, w² = (3 + sqrt 5) / 2 k / m, and 4 k / m at most."""
    assert 2600.0 / np.sqrt(4 * K / M) <= hung["steps"]["stable_ms"] <= 2600.0 / np.sqrt((3 + 5**0.5) / 2 * K / M)
    assert hung["steps"]["filter_ms"] == pytest.approx(1e3 / 60.0)  # two to a frame
    assert hung["information_share"] == {"M": 1.0}
    sigma = hung["target_sigma_mm"]
    assert 0.0 < sigma["bound_quiet"] < min(sigma["bound_pushed"], sigma["filter_quiet"])
    assert sigma["frames_per_s"] == pytest.approx(30.0)


def test_finer_marks_and_more_of_them_lower_the_bound(hung, tmp_path) -> None:
    options = {"sd_mm": 2.0}, {"sd_mm": 2.0, "frames_per_s": 60.0}
    coarse, often = (report_of(hanging(), tmp_path, **one)["target_sigma_mm"] for one in options)
    assert coarse["marks_mm"] == pytest.approx(2.0)
    assert often["frames_per_s"] == pytest.approx(60.0)
    assert max(often["bound_quiet"], hung["target_sigma_mm"]["bound_quiet"]) < coarse["bound_quiet"]


def test_a_recordings_rate_and_marks_are_its_own(tmp_path) -> None:
    folder = tmp_path / "rec"
    folder.mkdir()
    write_scene(hanging(), folder / "scene.toml")
    times = np.arange(10) / 50.0
    rows = [[MarkRow("M", np.array([0.0, -0.2]), 3e-4 if k else 5e-2)] for k in range(10)]
    write_marks_csv(folder / "marks.csv", times, rows, dim=2)
    sigma = check_report(checked(folder))["target_sigma_mm"]
    assert sigma["frames_per_s"] == pytest.approx(50.0)
    assert sigma["marks_mm"] == pytest.approx(0.3)


def test_a_mark_for_scoring_may_be_covered_in_a_film_and_a_measured_one_not(tmp_path) -> None:
    folder = tmp_path / "rec"
    folder.mkdir()
    scene = complete()
    write_scene(scene, folder / "scene.toml")
    write_frames_csv(folder / "frames.csv", np.arange(3) / 30.0)
    camera = scene.cameras[0]
    shown = replace(scene, marks=(scene.marks[0], scene.marks[3]))
    image = draw(shown, scene.network.positions, Lighting(), np.random.default_rng(0), strays=[])
    with VideoWriter(folder / "video.avi", camera.size_px, 30.0) as film:
        for _ in range(3):
            film.write(image)
    assert list(checked(folder).unfound) == ["M3"]


def complete() -> Scene:
    """A scene that lacks nothing."""
    network = four_mass_phantom()
    marks = tuple(Mark(node, 0.0, 0.03, measured=node != "M2") for node in ("M1", "M2", "M3", "M4"))
    camera = fronto_parallel_camera("front", (640, 480), (1.25, 1.25), (0.0, 0.19))
    return Scene(
        network,
        marks,
        Target("M2", 0.005, position_sd_m=5e-4),
        (camera,),
        uncertainty=independent_uncertainty(parameters(network, ("stiffness",)), 0.02),
        settings=FilterSettings(discrepancy=0.002),
        reference=Reference((ReferenceMark("R", "In2", look=Mark("R", 240.0, 0.03)),)),
    )


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> SceneCheck:
    path = tmp_path_factory.mktemp("complete") / "scene.toml"
    write_scene(complete(), path)
    return checked(path)


def test_a_complete_scene_lacks_nothing(whole) -> None:
    assert missing(whole) == []
    assert check_lines(whole)[-1] == ("missing", "nothing")


LACKS = {
    "a move of the camera or tracker cannot be detected": lambda s: replace(s, reference=Reference()),
    "constants were not identified": lambda s: replace(s, uncertainty=None),
    "noise levels were not tuned": lambda s: replace(s, settings=FilterSettings()),
    "no camera: films cannot be simulated or read": lambda s: replace(s, cameras=()),
    "the accuracy of the target's position in the tissue is not stated": lambda s: replace(
        s, target=Target("M2", 0.005)
    ),
    "the target M2 has a measured mark": lambda s: replace(s, marks=tuple(replace(m, measured=True) for m in s.marks)),
    "the target M2 has no mark": lambda s: replace(s, marks=tuple(m for m in s.marks if m.node != "M2")),
    "1 free node without a mark, M4": lambda s: replace(s, marks=s.marks[:3]),
    "1 mark not found in the picture or table: M3; M3: too small in the picture (0.1 px across": lambda s: replace(
        s, marks=tuple(replace(m, diameter_m=1e-4) if m.node == "M3" else m for m in s.marks)
    ),
    "the target's accuracy is too low": lambda s: replace(s, target=Target("M2", 1e-4, position_sd_m=0.0)),
    "rest lengths do not fit the drawing": lambda s: replace(
        s, network=replace(s.network, rest_lengths=1.1 * s.network.rest_lengths)
    ),
    "rest lengths equal the drawn distances": lambda s: replace(
        s, network=replace(s.network, rest_lengths=spans(s.network))
    ),
}


def spans(network):
    return np.linalg.norm(network.positions[network.springs[:, 0]] - network.positions[network.springs[:, 1]], axis=1)


@pytest.mark.parametrize("words", LACKS)
def test_what_is_missing_is_said_alone(words: str, whole, tmp_path) -> None:
    """By the scene, its rest and its picture; the filter's estimate is the complete scene's."""
    write_scene(LACKS[words](complete()), tmp_path / "scene.toml")
    scene = usable_scene(tmp_path / "scene.toml")
    rest = rest_shape(scene.network)
    unfound = _seen(scene, rest, None, None)[2]
    found = [one.what for one in missing(replace(whole, scene=scene, rest=rest, unfound=unfound))]
    assert [line for line in found if line.startswith(words)], found
    assert len(found) == 1


def test_marks_outside_of_the_picture_are_reported_with_what_the_camera_sees(whole) -> None:
    """Pictures of 640x480 at 1.25 mm a pixel, whose middle sees a place 300 mm to the right of the body."""
    scene = complete()
    camera = fronto_parallel_camera("front", (640, 480), (1.25, 1.25), (0.3, 0.2))
    aside = replace(scene, cameras=(camera,))
    unfound = _seen(aside, rest_shape(scene.network), None, None)[2]
    (line,) = [one.next for one in missing(replace(whole, scene=aside, unfound=unfound)) if "not found" in one.what]
    assert line.endswith("the camera sees at most x -99 to 699 mm, y -99 to 499 mm; softaim register moves the body")
    (near,) = [one.next for one in missing(replace(whole, unfound={"M3": None})) if "not found" in one.what]
    assert "the camera sees" not in near


def test_marks_that_tell_nothing_are_said_to(tmp_path) -> None:
    """A long soft cord below a marked mass that is as good as fixed: what swings at its end is anybody's guess."""
    names, places = ["hook", "M", "T"], [[0.0, 0.0], [0.0, -0.05], [0.0, -0.35]]
    constants = {"stiffness": [2e4, 15.0], "masses": [0.0, 2.0, 0.02], "gravity": [0.0, -G]}
    network = build_network(names, places, list(pairwise(names)), fixed=["hook"], **constants)
    marks = (Mark("M", 0.0, 0.01), Mark("T", 0.0, 0.01, measured=False))
    scene = Scene(network, marks, Target("T", 0.005, position_sd_m=5e-4), ())
    found = [one["what"] for one in report_of(scene, tmp_path)["missing"]]
    assert any(line.startswith("the marks are too few or too far for an estimate") for line in found)


def test_the_command_prints_writes_and_draws(whole, tmp_path, capsys) -> None:
    write_scene(complete(), tmp_path / "scene.toml")
    assert softaim("check", tmp_path / "scene.toml", "--out", tmp_path / "out") == 0
    reported = capsys.readouterr().out
    subjects = [line.split()[0] for line in reported.splitlines() if line[:1].strip()]
    assert subjects == ["scene", "rest", "motion", "steps", "marks", "target", "errors", "missing", "Picture"]
    picture = cv2.imread(str(tmp_path / "out" / "check.png"))
    assert picture.std() > 10.0
    kept = json.loads((tmp_path / "out" / "check.json").read_text(encoding="utf-8"))
    expected = json.loads(json.dumps(plain(check_report(whole))))
    assert {**kept, "scene": None} == {**expected, "scene": None}


def string(n_free: int, dim: int) -> Scene:
    """A string of so many masses that hangs from an anchor, the first one marked."""
    names = ["A", *(f"N{k}" for k in range(n_free))]
    places = np.zeros((n_free + 1, dim))
    places[:, 0] = 0.01 * np.arange(n_free + 1)
    edges = list(pairwise(names))
    away = [1.0] + [0.0] * (dim - 1)
    network = build_network(names, places, edges, stiffness=100.0, masses=1e-3, gravity=away, fixed=["A"])
    return Scene(network, (Mark("N0", 0.0, 0.01),), Target(names[-1], 0.005), ())


@pytest.mark.parametrize(
    ("before", "dim", "most"), [("identify", 2, 30), ("tune", 3, 20), ("track", 2, 30), ("insert", 3, 20)]
)
def test_a_body_too_large_for_a_filter_is_refused_before_anything_is_computed(before, dim, most, monkeypatch) -> None:
    monkeypatch.setattr("experiments.pipeline.line.MOST_STATES", 120)
    run = Run("track", (), Kept(), ExitStack())
    run.use(string(most, dim), before)
    where = "in space" if dim == 3 else "in the plane"
    message = f"scene: network.node: expected at most {most} free nodes for a filter {where}, found {most + 1}"
    with pytest.raises(InputError, match=message):
        run.use(string(most + 1, dim), before)
    run.use(string(most + 1, dim), "simulate")
    run.use(string(most + 1, dim))


def refused(scene: Scene, folder, capsys) -> str:
    """What is said of a scene that cannot be checked, in one line."""
    write_scene(scene, folder / "scene.toml")
    assert softaim("check", folder / "scene.toml", "--out", folder / "out") == 2
    assert not (folder / "out").exists()
    (line,) = capsys.readouterr().err.splitlines()
    start = f"softaim: {folder / 'scene.toml'}: "
    assert line.startswith(start)
    return line.removeprefix(start)


def test_a_body_too_large_to_check_is_one_line(tmp_path, capsys, monkeypatch) -> None:
    monkeypatch.setattr("experiments.projects.check.rest_shape", None)
    monkeypatch.setattr("experiments.pipeline.line.MOST_STATES", 120)
    said = refused(string(21, 3), tmp_path, capsys)
    assert said == "network.node: expected at most 20 free nodes for a filter in space, found 21"


def test_a_scene_that_rests_nowhere_is_one_line(tmp_path, capsys) -> None:
    """A mass on two springs in line, pressed together: it buckles, and nothing is there to stop it."""
    places = [[-0.1, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.1, 0.0]]
    edges, held = [("A", "T"), ("B", "T"), ("T", "M")], {"gravity": [0.0, 0.0, -1e-9], "fixed": ["A", "B"]}
    constants = {"stiffness": [100.0] * 3, "masses": 0.1, "rest_lengths": [0.15, 0.15, 0.1]}
    network = build_network(["A", "B", "T", "M"], places, edges, **held, **constants)
    scene = Scene(network, (Mark("M", 0.0, 0.01),), Target("T", 0.005, position_sd_m=5e-4), ())
    assert refused(scene, tmp_path, capsys).startswith("network: rest shape: expected")


def test_marks_of_a_scene_in_space_are_seen_by_its_cameras() -> None:
    """Their covariance is that of the pictures, not a tracker's default; errors of the calibration are shared."""
    step = np.zeros((1, 15))
    step[0, 14] = 1e-3
    exact = breast()
    stated = replace(exact, space_cameras=tuple(replace(one, calibration=step) for one in exact.space_cameras))
    for scene, n_shared in ((exact, 0), (stated, 2)):
        marks, single, unfound = _seen(scene, scene.network.positions, None, None)
        assert unfound == {}
        assert single == {mark.node for mark in marks if mark.cov.trace() > 0.05**2}
        assert {mark.node for mark in marks} == set(scene.measured_nodes)
        near = next(mark for mark in marks if mark.node == "S1")
        assert np.sqrt(near.cov.trace() / 3.0) < 2e-4
        assert (0 if near.shared is None else near.shared.shape[1]) == n_shared
    default = _seen(replace(exact, space_cameras=()), exact.network.positions, None, None)[0][0]
    np.testing.assert_allclose(default.cov, 25e-8 * np.eye(3))


def test_marks_of_one_camera_are_counted_not_averaged(tmp_path) -> None:
    """Along its ray such a mark is known to the size of the body; the accuracy stated is that of the pictures."""
    write_scene(breast(), tmp_path / "scene.toml")
    done = checked(tmp_path / "scene.toml")
    report = check_report(done)
    assert report["marks"]["by_one_camera"] == [m.node for m in done.seen if m.cov.trace() > 0.05**2]
    assert 0.003 < report["target_sigma_mm"]["marks_mm"] < 0.2
    assert "2 others by one camera" in dict(check_lines(done))["target"]
    alone = replace(done, single=frozenset(mark.node for mark in done.seen))
    assert "across the ray" in dict(check_lines(alone))["target"]
