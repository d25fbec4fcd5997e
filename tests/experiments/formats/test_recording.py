"""Recordings: what is read of a good one, and what is written for others to read."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from dynamics import build_network, four_mass_phantom
from experiments.errors import InputError
from experiments.formats.recording import (
    MarkRow,
    read_recording,
    write_frames_csv,
    write_marks_csv,
    write_truth_csv,
)
from experiments.formats.scene.scene import Mark, Scene, Target, write_scene
from tests.experiments.rows import complaint
from vision import VideoWriter, fronto_parallel_camera

SIZE_PX = (32, 24)
MARKED = ("M1", "M2", "M3")


def scene() -> Scene:
    marks = tuple(Mark(name, 0.0, 0.03, measured=name != "M2") for name in MARKED)
    camera = fronto_parallel_camera("front", SIZE_PX, (20.0, 20.0))
    return Scene(four_mass_phantom(), marks, Target("M2", 0.005), (camera,))


def scene_in_space() -> Scene:
    held = {"fixed": ["A"], "gravity": [0.0] * 3, "rest_lengths": "as drawn"}
    places = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]]
    network = build_network(["A", "B"], places, [("A", "B")], stiffness=1.0, masses=1.0, **held)
    return Scene(network, (Mark("B", 0.0, 0.01),), Target("B", 0.005), ())


def picture(k: int) -> np.ndarray:
    return np.full((SIZE_PX[1], SIZE_PX[0], 3), 20 * k, dtype=np.uint8)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a scene, for a marks.csv."""
    folder = tmp_path / "rec"
    folder.mkdir()
    write_scene(scene(), folder / "scene.toml")
    return folder


@pytest.fixture
def filmed(folder: Path) -> Path:
    """A recording of five frames, with a scene and nothing else."""
    with VideoWriter(folder / "video.avi", SIZE_PX, 30.0) as video:
        for k in range(5):
            video.write(picture(k))
    write_frames_csv(folder / "frames.csv", np.arange(5) / 30.0)
    return folder


def test_a_film_is_read_with_its_times(filmed: Path):
    recording = read_recording(filmed)
    assert recording.folder == filmed
    assert recording.scene.target.node == "M2"
    assert (recording.marks, recording.truth, recording.fixes) == (None, None, ())
    np.testing.assert_allclose(recording.exposures_s, np.arange(5) / 30.0, rtol=0, atol=1e-9)
    with recording.open_frames() as frames:
        seen = [(frame.index, frame.exposure_s, float(frame.image.mean())) for frame in frames]
    assert [index for index, _, _ in seen] == [0, 1, 2, 3, 4]
    assert [time_s for _, time_s, _ in seen] == recording.exposures_s.tolist()
    np.testing.assert_allclose([grey for _, _, grey in seen], 20.0 * np.arange(5), atol=2.0)  # JPEG


def test_another_scene_may_take_the_place_of_the_recording_s_own(filmed: Path, tmp_path: Path):
    (filmed / "scene.toml").rename(tmp_path / "other.toml")
    assert read_recording(filmed, tmp_path / "other.toml").scene.measured_nodes == ("M1", "M3")
    (filmed / "scene.toml").write_text("not read", encoding="utf-8")
    assert read_recording(filmed, tmp_path / "other.toml").scene.measured_nodes == ("M1", "M3")


def test_marks_take_the_place_of_a_film(folder: Path):
    (folder / "marks.csv").write_text(
        "time_s,node,x_mm,y_mm,sd_mm\n0.1,M1,1,2,0.5\n0.1,M2,3,4,0.5\n0.3,M1,-5,6.25,4.14\n", encoding="utf-8"
    )
    recording = read_recording(folder)
    np.testing.assert_array_equal(recording.exposures_s, [0.1, 0.3])
    assert recording.source is None
    assert [[row.node for row in rows] for rows in recording.marks] == [["M1", "M2"], ["M1"]]
    row = recording.marks[1][0]
    np.testing.assert_allclose(row.position_m, [-0.005, 0.00625], rtol=1e-15)
    assert row.sd_m == pytest.approx(0.00414, rel=1e-15)
    with pytest.raises(InputError, match=r"rec: expected a video or frames, found marks\.csv, which has no frames"):
        recording.open_frames()


@pytest.mark.parametrize("n_frames", [1, 2])
def test_marks_may_be_seen_in_no_frame(folder: Path, n_frames: int):
    write_marks_csv(folder / "marks.csv", np.empty(0), [], dim=2)
    write_frames_csv(folder / "frames.csv", np.arange(n_frames, dtype=float))
    assert read_recording(folder).marks == ((),) * n_frames


def test_truth_is_straight_between_its_times_and_unknown_outside(folder: Path):
    write_marks_csv(folder / "marks.csv", np.array([0.0]), [[MarkRow("M1", np.zeros(2), 0.001)]], dim=2)
    (folder / "truth.csv").write_text(
        "time_s,node,x_mm,y_mm\n0.1,M2,10,0\n0.2,In1,7,7\n0.2,M2,20,-4\n0.4,M2,0,-4\n", encoding="utf-8"
    )
    truth = read_recording(folder).truth
    assert set(truth.nodes) == {"M2", "In1"}
    inside, positions = truth.at(np.array([0.0, 0.1, 0.15, 0.3, 0.4, 0.5]), "M2")
    np.testing.assert_array_equal(inside, [False, True, True, True, True, False])
    expected = [[0.010, 0.0], [0.015, -0.002], [0.010, -0.004], [0.0, -0.004]]
    np.testing.assert_allclose(positions[inside], expected, rtol=0, atol=1e-12)
    assert np.isnan(positions[~inside]).all()
    inside, positions = truth.at(np.array([0.1, 0.2, 0.3]), "In1")
    np.testing.assert_array_equal(inside, [False, True, False])
    np.testing.assert_allclose(positions[1], [0.007, 0.007], rtol=1e-15)
    with pytest.raises(KeyError):
        truth.at(np.array([0.1]), "M9")


def test_fixes_are_read(filmed: Path):
    fixes = filmed / "fixes.csv"
    fixes.write_text("time_s,x_mm,y_mm,sd_mm\n", encoding="utf-8")
    assert read_recording(filmed).fixes == ()
    fixes.write_text("time_s,x_mm,y_mm,sd_mm\n0.5,1,2,0.25\n0.5,3,4,1\n", encoding="utf-8")
    first, second = read_recording(filmed).fixes
    assert (first.time_s, first.sd_m, second.sd_m) == (0.5, 0.00025, 0.001)
    np.testing.assert_allclose([first.position_m, second.position_m], [[0.001, 0.002], [0.003, 0.004]], rtol=1e-15)


places = st.lists(st.floats(-10.0, 10.0), min_size=2, max_size=2).map(np.array)
seen = st.dictionaries(st.sampled_from(MARKED), st.tuples(places, st.floats(1e-6, 1.0)), max_size=3)


@given(st.lists(st.tuples(st.integers(10**6, 5 * 10**9), seen), min_size=1, max_size=6))
@example([(8062697, {}), (10**6, {})])  # 1 ms apart but for rounding
@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_what_is_written_is_read_again(folder: Path, frames: list[tuple[int, dict[str, tuple[np.ndarray, float]]]]):
    """Times to 1e-9 s, positions to half of 1e-4 mm, deviations to nine digits."""
    times_s = 1e-9 * np.cumsum([step_ns for step_ns, _ in frames])
    marks = [[MarkRow(node, place, sd) for node, (place, sd) in rows.items()] for _, rows in frames]
    paths = {node: np.array([rows[node][0] if node in rows else [0.0, 0.0] for _, rows in frames]) for node in MARKED}
    write_frames_csv(folder / "frames.csv", times_s)
    write_marks_csv(folder / "marks.csv", times_s, marks, dim=2)
    write_truth_csv(folder / "truth.csv", times_s, paths)
    again = read_recording(folder)
    np.testing.assert_allclose(again.exposures_s, times_s, rtol=0, atol=0.51e-9)
    for rows, written in zip(again.marks, marks, strict=True):
        assert [row.node for row in rows] == [row.node for row in written]
        for row, own in zip(rows, written, strict=True):
            np.testing.assert_allclose(row.position_m, own.position_m, rtol=0, atol=0.51e-7)
            assert row.sd_m == pytest.approx(own.sd_m, rel=1e-8)
    assert set(again.truth.nodes) == set(MARKED)
    for node, positions in paths.items():
        np.testing.assert_allclose(again.truth.times_s[node], times_s, rtol=0, atol=0.51e-9)
        np.testing.assert_allclose(again.truth.positions[node], positions, rtol=0, atol=0.51e-7)


def test_what_could_not_be_read_again_is_not_written(tmp_path: Path):
    for times_s in ([0.0, 0.0], [0.0, 1e-10], [1.0, 0.0], [0.0, np.nan]):
        with pytest.raises(ValueError, match="times: expected finite ones that increase"):
            write_frames_csv(tmp_path / "frames.csv", np.array(times_s))
    for positions in (np.zeros((3, 2)), np.full((2, 2), np.nan)):
        with pytest.raises(ValueError, match="truth: expected finite positions at 2 times"):
            write_truth_csv(tmp_path / "truth.csv", np.array([0.0, 1.0]), {"M1": positions})
    for row in (MarkRow("M1", np.array([0.0, np.inf]), 0.1), MarkRow("M1", np.zeros(2), 0.0)):
        with pytest.raises(ValueError, match="marks: expected"):
            write_marks_csv(tmp_path / "marks.csv", np.array([0.0]), [[row]], dim=2)
    assert list(tmp_path.iterdir()) == []


COVS = {2: np.array([[4.0, 1.5], [1.5, 9.0]]), 3: np.array([[4.0, 1.5, 0.2], [1.5, 9.0, -2.0], [0.2, -2.0, 25.0]])}


@pytest.mark.parametrize("dim", [2, 3])
def test_marks_with_a_full_covariance_are_written_and_read_again(tmp_path: Path, dim: int):
    """Beside a mark of one deviation an axis, which then has one, too."""
    own, node = (scene(), "M1") if dim == 2 else (scene_in_space(), "B")
    write_scene(own, tmp_path / "scene.toml")
    place = np.arange(1.0, 1.0 + dim) / 10.0
    rows = [[MarkRow.of_cov(node, place, 1e-6 * COVS[dim])], [MarkRow(node, 2.0 * place, 3e-3)]]
    write_marks_csv(tmp_path / "marks.csv", np.array([0.0, 0.1]), rows, dim=dim)
    header = (tmp_path / "marks.csv").read_text().splitlines()[0]
    columns = {2: "x_mm,y_mm,cov_xx_mm2,cov_xy_mm2,cov_yy_mm2", 3: "x_mm,y_mm,z_mm,cov_xx_mm2,cov_xy_mm2,cov_yy_mm2"}
    assert header == f"time_s,node,{columns[dim]}" + (",cov_xz_mm2,cov_yz_mm2,cov_zz_mm2" if dim == 3 else "")
    marks = read_recording(tmp_path).marks
    np.testing.assert_allclose(marks[0][0].cov, 1e-6 * COVS[dim], rtol=1e-8)
    np.testing.assert_allclose(marks[1][0].cov, 9e-6 * np.eye(dim), rtol=1e-8, atol=1e-20)
    assert marks[0][0].sd_m == pytest.approx(1e-3 * np.sqrt(np.trace(COVS[dim]) / dim))


DEFINITE = "row 2: cov_mm2: expected a positive definite covariance (xx, xy, yy)"
COV_FAULTS = [
    ("cov_xx_mm2,cov_xy_mm2", "1,0", "row 1: expected one column cov_yy_mm2, found none"),
    ("cov_xx_mm2,cov_xy_mm2,cov_yy_mm2,sd_mm", "1,0,1,1", "row 1: expected only columns time_s, cov_xx_mm2"),
    ("cov_xx_mm2,cov_xy_mm2,cov_yy_mm2", "1,0,1e300", "row 2: cov_yy_mm2: expected -1e12 to 1e12, found 1e+300"),
    ("cov_xx_mm2,cov_xy_mm2,cov_yy_mm2", "1e-300,0,1e-300", DEFINITE),
    ("cov_xx_mm2,cov_xy_mm2,cov_yy_mm2", "1,nan,1", 'row 2: cov_xy_mm2: expected a finite number, found "nan"'),
    *(("cov_xx_mm2,cov_xy_mm2,cov_yy_mm2", entries, DEFINITE) for entries in ("1,2,1", "1,1,1", "-1,0,1", "0,0,0")),
]


@pytest.mark.parametrize(("columns", "entries", "message"), COV_FAULTS)
def test_a_covariance_that_is_none_is_refused(tmp_path: Path, columns: str, entries: str, message: str):
    write_scene(scene(), tmp_path / "scene.toml")
    (tmp_path / "marks.csv").write_text(f"time_s,node,x_mm,y_mm,{columns}\n0,M1,1,2,{entries}\n")
    assert complaint(read_recording, tmp_path).startswith(f"{tmp_path / 'marks.csv'}: {message}")
