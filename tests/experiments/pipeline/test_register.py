"""`softaim register`: the written scene is where the points were measured, and states the error at its target."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from estimators import RigidMotion
from experiments.formats.scene.mesh import outside_m
from experiments.formats.scene.moved import moved_scene
from experiments.formats.scene.reference import Reference, ReferenceMark
from experiments.formats.scene.scene import Scene, read_scene, write_scene
from experiments.formats.scene.schema import SceneError
from experiments.pipeline.events import is_identified
from tests.experiments.command import softaim
from tests.experiments.formats.scene.test_mesh import SCENE
from tests.experiments.formats.scene.test_mesh import folder as mesh_folder
from tests.experiments.in_space import breast

SPACE = Rotation.from_rotvec([0.4, -0.3, 1.0]).as_matrix(), np.array([0.3, -0.1, 0.8])
PLANE = Rotation.from_rotvec([0.0, 0.0, 0.1]).as_matrix()[:2, :2], np.array([0.02, -0.01])
RIG_M = (0.05, -0.06, 0.01)


@pytest.fixture(autouse=True)
def _in_own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def write_points(places: dict[str, np.ndarray], sd_mm: float = 0.5, *later: str) -> None:
    """A table of one row for each point, and later rows."""
    dim = len(next(iter(places.values())))
    rows = [f"0,{name},{','.join(f'{1e3 * x:.12f}' for x in place)},{sd_mm}" for name, place in places.items()]
    header = f"time_s,node,{','.join(('x_mm', 'y_mm', 'z_mm')[:dim])},sd_mm"
    Path("points.csv").write_text("\n".join([header, *rows, *later]) + "\n", encoding="utf-8")


def moved_points(scene: Scene, names: list[str], R: np.ndarray, t: np.ndarray) -> dict[str, np.ndarray]:
    return {name: R @ scene.network.positions[scene.network.index(name)] + t for name in names}


def register(*options: str) -> Scene:
    assert softaim("register", "scene.toml", "--points", "points.csv", "--out", "out.toml", *options) == 0
    return read_scene("out.toml")


def in_space() -> Scene:
    made = breast()
    marks = (ReferenceMark("R1", "W1"), ReferenceMark("R2", None, RIG_M))
    target = replace(made.target, offset_m=(0.001, -0.002, 0.003), position_sd_m=0.002)
    return replace(made, reference=Reference(marks), target=target)


def test_a_body_in_space_is_where_it_was_measured() -> None:
    R, t = SPACE
    scene = in_space()
    write_scene(scene, "scene.toml")
    write_points({**moved_points(scene, ["S1", "S2", "S4", "W1", "T"], R, t), "R2": R @ RIG_M + t})
    found = register()
    np.testing.assert_allclose(found.network.positions, scene.network.positions @ R.T + t, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.network.gravity, R @ scene.network.gravity, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.target.offset_m, R @ scene.target.offset_m, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.reference.marks[1].position_m, R @ RIG_M + t, rtol=0, atol=1e-9)
    assert found.reference.marks[0] == scene.reference.marks[0]
    np.testing.assert_array_equal(found.network.rest_lengths, read_scene("scene.toml").network.rest_lengths)
    for before, after in zip(scene.space_cameras, found.space_cameras, strict=True):  # in the world: they stay
        np.testing.assert_allclose(after.project(np.zeros((1, 3))), before.project(np.zeros((1, 3))), rtol=1e-9)
    assert [step.step for step in found.steps] == ["register"]


def planar_error_mm(drawn: np.ndarray, place: np.ndarray) -> float:
    """Error an axis of a registration by points with errors of 0.5 mm an axis, in the plane."""
    about, apart = drawn - drawn.mean(axis=0), place - drawn.mean(axis=0)
    return float(0.5 * np.sqrt(1.0 / len(drawn) + apart @ apart / (2.0 * np.sum(about**2))))


def test_the_error_at_the_target_joins_that_of_its_place(good: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """In closed form for equal errors in the plane: variance an axis s² (1/n + d² / (2 sum of r²))."""
    R, t = PLANE
    scene = read_scene(good / "scene.toml")
    places = moved_points(scene, ["M1", "M3", "M4", "In2"], R, t)
    drawn = np.array([scene.network.positions[scene.network.index(name)] for name in places])
    offset = np.array([0.03, -0.05])
    tre_mm = planar_error_mm(drawn, scene.network.positions[scene.network.index("M2")] + offset)
    scene = replace(scene, target=replace(scene.target, offset_m=tuple(offset.tolist())))
    for position_sd_m, before_mm in ((0.002, 2.0), (0.0, 0.0), (None, 3.0)):
        write_scene(replace(scene, target=replace(scene.target, position_sd_m=position_sd_m)), "scene.toml")
        write_points(places)
        found = register("--force")
        assert 1e3 * found.target.position_sd_m == pytest.approx(np.hypot(before_mm, tre_mm), rel=1e-6)
        shown = capfd.readouterr().out
        assert ("with 3 mm for the position, which was not stated" in shown) == (position_sd_m is None)


def test_a_wrong_point_is_named_and_widens_the_error(good: Path, capfd: pytest.CaptureFixture[str]) -> None:
    R, t = PLANE
    scene = read_scene(good / "scene.toml")
    write_scene(scene, "scene.toml")
    names = ["M1", "M2", "M3", "M4", "In1"]
    write_points(moved_points(scene, names, R, t))
    register("--json")
    right = json.loads(capfd.readouterr().out)
    assert right["suspect"] is None
    assert [point["name"] for point in right["points"]] == names
    assert max(point["left_out_mm"] for point in right["points"]) < 1e-6
    first, *others = (scene.network.positions[scene.network.index(name)] for name in names)
    expected_mm = np.sqrt(2.0 * (0.5**2 + planar_error_mm(np.array(others), first) ** 2))
    assert right["points"][0]["left_out_expected_mm"] == pytest.approx(expected_mm, rel=1e-6)
    assert right["angle_deg"] == pytest.approx(np.degrees(0.1))
    np.testing.assert_allclose(right["translation_mm"], 1e3 * t, atol=1e-6)
    places = moved_points(scene, names, R, t)
    places["M3"] = places["M3"] + [0.0, 0.01]
    write_points(places)
    register("--force", "--json")
    wrong = json.loads(capfd.readouterr().out)
    assert wrong["suspect"] == "M3"
    assert wrong["p_value"] < 1e-3
    assert wrong["points"][2]["left_out_mm"] == pytest.approx(10.0, abs=1e-6)
    assert softaim("check", "out.toml") == 0
    larger = np.sqrt(wrong["chi_square"] / wrong["degrees"])
    assert wrong["target_error_mm"] == pytest.approx(larger * right["target_error_mm"], rel=0.01)
    register("--force")
    assert "contradict the stated errors" in capfd.readouterr().out


def test_points_are_weighted_means_of_the_first_seconds(good: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """M1 at 0 and +3 mm with errors of 0.5 and 1 mm has its mean at 0.6 mm: 5 points of 0.5 mm, one of 0.447 mm."""
    scene = read_scene(good / "scene.toml")
    write_scene(scene, "scene.toml")
    places = moved_points(scene, ["M1", "M3", "M4", "In2"], np.eye(2), np.zeros(2))
    x, y = 1e3 * places["M1"]
    far = [f"5,{name},{1e3 * place[0] + 50:.9f},{1e3 * place[1]:.9f},0.1" for name, place in places.items()]
    write_points(places, 0.5, f"1,M1,{x + 3.0:.12f},{y:.12f},1.0", *far)
    register("--json")
    by_rows = json.loads(capfd.readouterr().out)
    rows = Path("points.csv").read_text(encoding="utf-8").splitlines()[1:5]
    rows[0] = f"0,M1,{x + 0.6:.12f},{y:.12f},{np.sqrt(0.2):.12f}"
    Path("points.csv").write_text("\n".join(["time_s,node,x_mm,y_mm,sd_mm", *rows]) + "\n", encoding="utf-8")
    register("--json", "--force")
    by_mean = json.loads(capfd.readouterr().out)
    np.testing.assert_allclose(by_rows["translation_mm"], by_mean["translation_mm"], atol=1e-6)
    assert by_rows["target_error_mm"] == pytest.approx(by_mean["target_error_mm"], rel=1e-6)


def test_a_mesh_is_written_beside_and_held_where_it_was(tmp_path: Path) -> None:
    R, t = SPACE
    mesh_folder(tmp_path)
    scene = read_scene("scene.toml")
    names = ["M1", "M2", "T", "wall 1"]
    write_points(moved_points(scene, names, R, t))
    found = register()
    assert (found.mesh.file, found.mesh.fixed) == ("out.npz", "wall")
    for name in names:
        place = found.network.positions[found.network.index(name)]
        np.testing.assert_allclose(place, moved_points(scene, [name], R, t)[name], rtol=0, atol=1e-9)
    held = (found.network.positions[found.network.fixed] - t) @ R  # of the plane x < 5 mm
    np.testing.assert_allclose(held[:, 0], 0.0, atol=1e-9)
    assert outside_m(found.mesh, np.array([[0.02, 0.015, 0.015]]) @ R.T + t) == 0.0
    assert found.network.continuum.mass == pytest.approx(scene.network.continuum.mass, rel=1e-9)  # without what is held
    assert softaim("check", "out.toml") == 0
    mesh = Path("out.npz").read_bytes()
    assert mesh != Path("mesh.npz").read_bytes()
    write_points(moved_points(scene, names, R, t + 0.01))
    Path("out.toml").unlink()
    assert softaim("register", "scene.toml", "--points", "points.csv", "--out", "out.toml") == 2
    assert Path("out.npz").read_bytes() == mesh
    drawn = Path("mesh.npz").read_bytes()
    assert softaim("register", "scene.toml", "--points", "points.csv", "--out", "mesh.toml", "--force") == 2
    assert Path("mesh.npz").read_bytes() == drawn
    again = register("--force")
    np.testing.assert_allclose(again.network.positions[0], found.network.positions[0] + 0.01, rtol=0, atol=1e-9)


def test_an_identified_scene_stays_identified(good: Path) -> None:
    assert softaim("simulate", good / "scenario.toml", "--out", "rec", "--no-film") == 0
    scene = read_scene("rec/scene.toml")
    write_scene(scene, "scene.toml")
    assert is_identified(scene)
    write_points(moved_points(scene, ["M1", "M3", "M4"], *PLANE))
    assert is_identified(register())


def test_an_anchor_of_a_mesh_that_is_another_one_after_the_move_has_no_reference_mark(tmp_path: Path) -> None:
    """Anchors of a box are at equal distances: which of them are shown changes with the turn."""
    R, t = SPACE
    scene = read_scene(mesh_folder(tmp_path, SCENE.replace('"x < 5"', '"x < 5"\ndriven = false')))
    motion = RigidMotion(R, t, np.zeros(3))
    moved = moved_scene(scene, motion, Path("moved.npz")).network.positions
    others = np.linalg.norm(moved - motion.moved(scene.network.positions), axis=1) > 1e-3
    node = scene.network.names[int(np.argmax(others))]
    marked = replace(scene, reference=Reference((ReferenceMark("R1", node),)))
    with pytest.raises(SceneError, match=re.escape(f'whose name changes as the mesh moves, found "{node}"')):
        moved_scene(marked, motion, Path("moved.npz"))
