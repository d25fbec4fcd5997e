"""Films of runs: one frame for each of the recording's, what they show where the projection says, the worst frames."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest

from dynamics.elements import continuum_network
from dynamics.mesh import Tissue
from estimators import Advice, Guidance
from experiments.film.overlay import Fate
from experiments.film.views import ground_camera, labels, overlay_of
from experiments.formats.mesh.body import tetrahedra
from experiments.formats.needle_file import read_needle
from experiments.formats.recording import read_recording
from experiments.formats.scenario import read_scenario
from experiments.formats.scene.scene import write_scene
from experiments.pipeline.line import FILTER, Line
from experiments.pipeline.track import each_frame
from experiments.simulation.simulate import simulate
from tests.experiments.command import softaim
from tests.experiments.formats.mesh.shapes import box
from tests.experiments.in_space import breast
from tests.experiments.pipeline.sight.test_space import recorded
from tests.experiments.plots.tracks import block, phantom
from vision import Pose, Reason, VideoFileFrames

pytestmark = pytest.mark.usefixtures("without_pictures")
NEEDLE = "version = 1\nentry_mm = [0.0, 300.0]\ndirection = [0.0, -1.0]\nspeed_mm_s = 100.0\n"


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recordings") / "rec"
    simulate(read_scenario("webcam").model_copy(update={"duration_s": 0.5, "pokes": None}), folder)
    return folder


def frames_of(film: Path) -> list[np.ndarray]:
    with VideoFileFrames(film) as frames:
        return [frame.image for frame in frames]


def test_what_is_drawn_is_what_was_estimated_seen_and_expected(recording) -> None:
    opened = read_recording(recording)
    camera = opened.scene.cameras[0]
    line = Line(opened.scene, explain=True)
    for _, step in each_frame(line, opened):
        overlay = overlay_of(line, step, camera)
    estimate = step.estimates[FILTER]
    assert overlay.target_px == pytest.approx(camera.project(estimate.mean[None])[0])
    scale = 1e3 / 1.25  # px a metre, square to the plane
    assert overlay.target_cov_px2 == pytest.approx(scale**2 * np.diag([1, -1]) @ estimate.cov @ np.diag([1, -1]))
    for drawn in overlay.marks:
        (seen,) = [mark for mark in step.marks if mark.node == drawn.name]
        assert drawn.fate is Fate.FOUND
        assert drawn.center_px == pytest.approx(camera.project(seen.position[None])[0])
        assert np.abs(drawn.shape_px) == pytest.approx(12.0 * np.eye(2))  # 30 mm across at 1.25 mm a pixel
        assert np.abs(drawn.expected_px - drawn.center_px).max() < 5.0
    truth = pd.read_csv(recording / "truth.csv").query("node == 'M1'").iloc[-1]
    own = overlay.nodes_px[opened.scene.network.index("M1")]
    assert np.abs(own - camera.project([[1e-3 * truth.x_mm, 1e-3 * truth.y_mm]])[0]).max() < 1.0
    assert overlay.facts.startswith(f"{estimate.time_s:.2f} s, 3 of 3 marks, sigma ")


@pytest.fixture(scope="module")
def filmed(recording, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("filmed") / "out"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("experiments.plots.track.write_track_plots", lambda *_, **__: [])
        assert softaim("track", recording, "--out", out, "--film") == 0
    return out


def test_track_writes_a_film_of_every_frame_and_the_worst(recording, filmed) -> None:
    frames = frames_of(filmed / "film.avi")
    assert len(frames) == 15
    assert frames[0].shape == (480, 640, 3)
    plain = frames_of(next(recording.glob("video.*")))
    assert np.abs(frames[10].astype(int) - plain[10]).max() > 100
    assert cv2.imread(str(filmed / "worst.png")) is not None
    assert cv2.VideoCapture(str(filmed / "film.avi")).get(cv2.CAP_PROP_FPS) == pytest.approx(30.0, rel=1e-3)


def test_without_a_film_the_estimates_are_the_same(recording, filmed, tmp_path) -> None:
    assert softaim("track", recording, "--out", tmp_path / "plain") == 0
    assert not (tmp_path / "plain" / "film.avi").exists()
    for name in ("estimates.csv", "estimates.open-loop.csv"):
        assert (tmp_path / "plain" / name).read_bytes() == (filmed / name).read_bytes()


def test_a_mark_of_another_diameter_than_stated_is_blamed_on_that(recording, tmp_path, capsys) -> None:
    scene = read_recording(recording).scene
    marks = tuple(replace(mark, diameter_m=0.09) if mark.node == "M3" else mark for mark in scene.marks)
    write_scene(replace(scene, marks=marks), tmp_path / "large.toml")
    assert softaim("track", recording, "--scene", tmp_path / "large.toml", "--out", tmp_path / "out", "--film") == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "Mark M3: not found in 100 % of frames: wrong size: check diameter_mm and the scale" in said
    reported = json.loads((tmp_path / "out" / "summary.json").read_text())["filter"]["marks"]["M3"]
    shares = {"found": 0.0, "refused": 0.0, "lost": 1.0, "reason_share": 1.0}
    assert reported == {"measured": True, "reason": Reason.SIZE, **shares}


def test_marks_of_another_tracker_are_drawn_on_a_plain_ground(recording, tmp_path) -> None:
    folder = tmp_path / "marks"
    folder.mkdir()
    truth = pd.read_csv(recording / "truth.csv").query("node != 'M2'")
    truth.assign(sd_mm=0.5).to_csv(folder / "marks.csv", index=False)
    (folder / "scene.toml").write_bytes((recording / "scene.toml").read_bytes())
    (tmp_path / "needle.toml").write_text(NEEDLE)
    out = tmp_path / "out"
    assert softaim("advise", folder, "--needle", tmp_path / "needle.toml", "--out", out, "--film") == 0
    frames = frames_of(out / "film.avi")
    assert len(frames) == truth["time_s"].nunique()
    opened = read_recording(folder)
    camera = ground_camera(opened.scene)
    corners = camera.project(opened.scene.network.positions)
    assert corners.min() >= 0.0
    assert (corners <= [639.0, 479.0]).all()
    at_m1 = camera.project(opened.scene.network.positions[[opened.scene.network.index("M1")]])[0].round().astype(int)
    around = frames[-1][at_m1[1] - 30 : at_m1[1] + 30, at_m1[0] - 30 : at_m1[0] + 30].astype(int)
    assert (around[:, :, 2] - around[:, :, 0] > 100).any()  # its red circle
    assert abs(int(np.median(frames[-1][:, :, 0])) - 60) < 3


def test_there_is_no_film_of_given_marks_in_space(tmp_path, capsys) -> None:
    folder = tmp_path / "rec"
    folder.mkdir()
    write_scene(block(), folder / "scene.toml")
    (folder / "marks.csv").write_text("time_s,node,x_mm,y_mm,z_mm,sd_mm\n0.0,N2,0.0,0.0,40.0,1.0\n")
    assert softaim("track", folder, "--out", tmp_path / "out", "--film") == 2
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert said.startswith("softaim: --film: expected a flat scene, or cameras with lens and pose in it")
    assert not (tmp_path / "out").exists()


@pytest.fixture(scope="module")
def in_space(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded(tmp_path_factory.mktemp("space"), breast(), duration_s=0.19)


def test_in_space_each_camera_has_a_film(in_space, tmp_path) -> None:
    assert softaim("track", in_space, "--out", tmp_path / "out", "--film") == 0
    assert sorted(path.name for path in (tmp_path / "out").glob("*.avi")) == ["film.left.avi", "film.right.avi"]
    for name in ("left", "right"):
        frames = frames_of(tmp_path / "out" / f"film.{name}.avi")
        plain = frames_of(next(in_space.glob(f"video.{name}.*")))
        assert len(frames) == len(plain) == 6
        assert np.abs(frames[-1].astype(int) - plain[-1]).max() > 100
    assert (tmp_path / "out" / "worst.png").exists()


def test_in_space_each_camera_shows_what_it_can_see(in_space) -> None:
    """Marks where the pictures have their hue, a target with the projected covariance, no mark on the far side."""
    opened = read_recording(in_space)
    line = Line(opened.scene, explain=True)
    *_, (exposure, step) = each_frame(line, opened)
    estimate, n_drawn = step.estimates[FILTER], 0
    for camera in opened.scene.space_cameras:
        overlay = overlay_of(line, step, camera)
        assert overlay.facts.startswith(f"{camera.name}: ")
        assert " marks by all cameras" in overlay.facts
        slopes = (camera.project(estimate.mean + 1e-6 * np.eye(3)) - camera.project(estimate.mean)).T / 1e-6
        assert overlay.target_px == pytest.approx(camera.project(estimate.mean)[0])
        assert overlay.target_cov_px2 == pytest.approx(slopes @ estimate.cov @ slopes.T, rel=1e-3)
        hsv = cv2.cvtColor(exposure.images[camera.name], cv2.COLOR_BGR2HSV)
        for drawn in overlay.marks:
            u, v = drawn.center_px.round().astype(int)
            assert abs((2.0 * hsv[v, u, 0] - drawn.hue_deg + 180.0) % 360.0 - 180.0) < 20.0, drawn.name
            n_drawn += 1
    assert n_drawn > len(opened.scene.measured_nodes)
    turned = Pose(np.diag([1.0, -1.0, -1.0]) @ camera.pose.rotation, np.array([0.0, 0.0, -0.5]))
    behind = overlay_of(line, step, replace(camera, pose=turned))
    assert behind.marks == ()
    assert behind.target_cov_px2 is None


def test_wall_points_of_a_mesh_have_no_label() -> None:
    nodes, elements = box((3, 3, 3), 0.01)
    mesh = tetrahedra(Path("box"), nodes, elements)
    points = {"M1": np.array([0.03, 0.015, 0.015]), "T": np.array([0.02, 0.015, 0.015])}
    network = continuum_network(mesh, [Tissue("fat", 5e3, 0.4, 1000.0, 0.01)], np.flatnonzero(nodes[:, 0] == 0), points)
    assert "wall 1" in network.names
    assert [name for name in labels(network, "T") if name] == ["M1", "T"]
    springs = phantom().network
    assert labels(springs, "M2") == springs.names


def test_in_space_a_needle_from_outside_the_picture_is_drawn_up_to_its_edge(in_space, tmp_path) -> None:
    """A needle above the target that begins 0.5 m away, behind the cameras: its tip, and the edge of the picture."""
    opened = read_recording(in_space)
    line = Line(opened.scene, explain=True)
    *_, (_, step) = each_frame(line, opened)
    entry = step.estimates[FILTER].mean + np.array([0.0, 0.0, 0.03])
    words = f"version = 1\nentry_mm = {(1e3 * entry).tolist()}\ndirection = [0.0, -0.6, -0.8]\nspeed_mm_s = 100.0\n"
    (tmp_path / "needle.toml").write_text(words)
    plan = read_needle(tmp_path / "needle.toml", opened.scene.target.radius_m, 3)
    guidance = Guidance(Advice.GO, "hit", depth_m=1.0)
    for camera in opened.scene.space_cameras:
        needle = overlay_of(line, step, camera, guidance, plan).needle
        tip = camera.project(entry)[0]
        assert needle.shaft_px[1] == pytest.approx(tip)
        assert needle.ahead_px[0] == pytest.approx(tip)
        to_edge = np.minimum(needle.shaft_px[0], np.array(camera.size_px) - 1.0 - needle.shaft_px[0]).min()
        assert -0.5 <= to_edge < 10.0
