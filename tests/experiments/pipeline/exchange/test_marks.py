"""Marks of a pose tracker's table are where the camera sees them, as sure as the camera makes them."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from experiments.errors import InputError
from experiments.formats.recording import read_recording
from experiments.formats.scene.scene import read_scene, write_scene
from experiments.pipeline.exchange.marks import import_table, plane_scale
from tests.experiments.command import softaim
from tests.experiments.pipeline.exchange.recordings import tilted

TAIL = ["tail=M4"]


pytestmark = pytest.mark.usefixtures("here")


def test_places_are_on_the_plane() -> None:
    """15 mm a pixel about the middle of 64x48 px; M1 of frame 1 is unlikely, the tail of frame 2 missing."""
    done = import_table(Path("deeplabcut.csv"), Path("scene.toml"), 30.0, renamed=TAIL)
    assert done.exposures_s.tolist() == [0.0, 1 / 30, 2 / 30]
    assert [[mark.node for mark in found] for found in done.marks] == [["M1", "M4"], ["M4"], ["M1"]]
    np.testing.assert_allclose(done.marks[0][0].position_m, [15e-3 * (18.25 - 31.5), -15e-3 * (10.5 - 23.5)])
    np.testing.assert_allclose(done.marks[1][0].position_m, [15e-3 * (41 - 31.5), -15e-3 * (30 - 23.5)])
    assert [mark.sd_m for found in done.marks for mark in found] == pytest.approx([15e-3] * 4)
    assert (done.unlikely, done.outside) == (1, 0)
    assert done.counts() == {"M1": 2, "M2": 0, "M3": 0, "M4": 2}


@pytest.mark.parametrize(
    ("scores", "kept", "manual"), [((0.9, 0.5), 1, 0), (("", 0.5), 1, 1), (("", ""), 2, 2), (("nan", 0.6), 2, 1)]
)
def test_a_place_without_a_likelihood_was_set_by_a_person(scores: tuple, kept: int, manual: int) -> None:
    """It is kept, whatever the least likelihood, and counted apart."""
    rows = "".join(f",{k},,{18 + k},10,{score}\n" for k, score in enumerate(scores))
    Path("poses.csv").write_text(f"track,frame_idx,instance.score,M1.x,M1.y,M1.score\n{rows}")
    done = import_table(Path("poses.csv"), Path("scene.toml"), 30.0)
    assert (done.counts()["M1"], done.manual, done.unlikely) == (kept, manual, 2 - kept)


def test_marks_set_manually_are_reported(capsys: pytest.CaptureFixture[str]) -> None:
    Path("poses.csv").write_text("track,frame_idx,M1.x,M1.y,M1.score\n,0,18,10,\n,1,18,10,0.9\n")
    assert softaim("import", "poses.csv", "--scene", "scene.toml", "--out", "rec", "--fps", "30", "--least", "1") == 0
    shown = capsys.readouterr().out
    assert "Positions omitted: 1 with likelihood below 1" in shown
    assert "Positions set manually, used without a likelihood: 1" in shown


def test_a_lens_and_a_tilt_are_undone() -> None:
    """Places and spreads as OpenCV projects them; the sd is the root of the ellipse's semi-axes' product."""
    (camera, pose), K = tilted(30.0, (-0.2, 0.05)), np.array([[60.0, 0, 31.5], [0, 60.0, 23.5], [0, 0, 1]])
    scene = read_scene(Path("scene.toml"))
    write_scene(replace(scene, cameras=(replace(camera, calibration_sd_px=0.3),)), Path("tilted.toml"))
    places_m = np.array([[-0.2, 0.15, 0.0], [0.25, -0.1, 0.0]])
    angle, bend = cv2.Rodrigues(pose.rotation)[0], np.array([-0.2, 0.05, 0.0, 0.0, 0.0])

    def seen(points: np.ndarray) -> np.ndarray:
        return cv2.projectPoints(points, angle, pose.translation_m, K, bend)[0].reshape(-1, 2)

    (u1, v1), (u4, v4) = seen(places_m)
    assert (seen(places_m) > 0).all()
    header = "track,frame_idx,M1.x,M1.y,M1.score,M4.x,M4.y,M4.score"
    Path("poses.csv").write_text(f"{header}\n,0,{u1},{v1},1,{u4},{v4},1\n")
    done = import_table(Path("poses.csv"), Path("tilted.toml"), 1.0, sd_px=0.4)
    step = 1e-6
    for mark, place in zip(done.marks[0], places_m, strict=True):
        np.testing.assert_allclose(mark.position_m, place[:2], atol=1e-7)
        J = np.stack([(seen(place[None] + e) - seen(place[None] - e))[0] / (2 * step) for e in step * np.eye(3)[:2]], 1)
        assert mark.sd_m == pytest.approx(0.5 / np.sqrt(abs(np.linalg.det(J))), rel=1e-4)  # 0.3 and 0.4 px together


def test_what_is_outside_of_the_picture_is_left_out_and_counted() -> None:
    text = Path("sleap.csv").read_text()
    Path("sleap.csv").write_text(text.replace("18.25", "63.6").replace("18.5", "63.4"))
    done = import_table(Path("sleap.csv"), Path("scene.toml"), 10.0)
    assert [[mark.node for mark in found] for found in done.marks] == [["M4"], [], ["M1"]]
    assert (done.unlikely, done.outside) == (0, 1)


def test_a_scale_takes_the_place_of_a_camera() -> None:
    """The pixel (10, 20) shows the origin, 0.5 mm a pixel: (18.25, 10.5) is 8.25 px right of it and 9.5 above."""
    scene = read_scene(Path("scene.toml"))
    write_scene(replace(scene, cameras=()), Path("scene.toml"))
    done = import_table(Path("sleap.csv"), Path("scene.toml"), 10.0, scale=plane_scale(0.5, (10.0, 20.0)))
    np.testing.assert_allclose(done.marks[0][0].position_m, [0.5e-3 * 8.25, 0.5e-3 * 9.5])
    assert done.marks[0][0].sd_m == pytest.approx(0.5e-3)


def test_all_names_without_a_node_are_reported_at_once() -> None:
    columns = [f"{part}.{of}" for part in ("head", "M1", "nose") for of in ("x", "y", "score")]
    Path("poses.csv").write_text(",".join(["track", "frame_idx", *columns]) + "\n,0,18,10,1,20,10,1,22,10,1\n")
    with pytest.raises(InputError) as fault:
        import_table(Path("poses.csv"), Path("scene.toml"), 10.0, renamed=["nose=M9"])
    expected = "a node with a mark (M1, M2, M3, M4); --rename head=NODE, or head= to leave it out"
    assert str(fault.value) == f'poses.csv: head, nose: expected {expected}, found "head", "M9"'


def test_a_part_without_a_node_is_left_out_where_asked() -> None:
    done = import_table(Path("deeplabcut.csv"), Path("scene.toml"), 30.0, renamed=["tail="])
    assert done.counts() == {"M1": 2, "M2": 0, "M3": 0, "M4": 0}
    assert done.unlikely == 1


@pytest.mark.usefixtures("without_pictures")
def test_the_recording_is_read_as_it_was_meant() -> None:
    """By the command, from a frames.csv, and tracked from then on as any other."""
    words = ["--scene", "scene.toml", "--out", "rec", "--frames", "marks/frames.csv", "--rename", *TAIL]
    assert softaim("import", "deeplabcut.csv", *words) == 0
    found = read_recording(Path("rec"))
    meant = import_table(Path("deeplabcut.csv"), Path("scene.toml"), Path("marks/frames.csv"), renamed=TAIL)
    assert found.exposures_s.tolist() == [0.0, 0.1, 0.2]
    for own, other in zip(found.marks, meant.marks, strict=True):
        assert [mark.node for mark in own] == [mark.node for mark in other]
        for mark, one in zip(own, other, strict=True):
            np.testing.assert_allclose(mark.position_m, one.position_m, atol=1e-7)
            assert mark.sd_m == pytest.approx(one.sd_m)
    inputs = json.loads(Path("rec/provenance.json").read_text(encoding="utf-8"))["inputs"]
    assert [one["path"] for one in inputs] == ["deeplabcut.csv", "scene.toml", "marks/frames.csv"]
    assert softaim("track", "rec", "--out", "result", "--json") == 0


def test_marks_beyond_the_horizon_are_refused() -> None:
    """A plane seen at a slant: v above 12.5 px is sky."""
    text = Path("scene.toml").read_text()
    before, _, _ = text.partition("plane_to_px")
    slanted = "plane_to_px = [[1.0, 0.315, 315.0], [0.0, 0.125, 235.0], [0.0, 0.01, 10.0]]"
    Path("scene.toml").write_text(f"{before}{slanted}\ncalibration_sd_px = 0.0\n")
    with pytest.raises(InputError, match=r"sleap.csv: camera front: expected points before the horizon"):
        import_table(Path("sleap.csv"), Path("scene.toml"), 10.0)


@pytest.mark.parametrize(
    ("mm_per_px", "sd_px", "message"),
    [
        (1e7, 1.0, "sleap.csv: expected places from -1e6 to 1e6 mm, found one beyond"),
        (0.5, 1e-9, "sleap.csv: expected standard deviations from 1e-6 to 1e6 mm, found one beyond"),
        (0.5, 1e9, "sleap.csv: expected standard deviations from 1e-6 to 1e6 mm, found one beyond"),
    ],
)
def test_marks_beyond_all_sense_are_refused(mm_per_px: float, sd_px: float, message: str) -> None:
    scale = plane_scale(mm_per_px, (0.0, 0.0))
    with pytest.raises(InputError, match=message):
        import_table(Path("sleap.csv"), Path("scene.toml"), 10.0, scale=scale, sd_px=sd_px)


def test_a_body_in_space_has_no_depth_in_a_picture() -> None:
    scene = Path(__file__).parents[2] / "hanging.toml"
    with pytest.raises(InputError, match=r"expected a flat scene: one picture has no depth, found a network in space"):
        import_table(Path("sleap.csv"), scene, 10.0)
