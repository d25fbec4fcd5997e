"""`softaim new --mesh`: tissues, wall, marks and target of a box of 40 x 30 x 30 mm, and one line for each fault."""

import shlex
import shutil
from pathlib import Path

import meshio
import numpy as np
import pytest

from dynamics.mesh import TetMesh, locate_on_surface, surface
from dynamics.mesh.tissues import TISSUES
from experiments.formats.mesh import body as body_file
from experiments.formats.mesh.project_file import mesh_of
from experiments.formats.needle_file import read_needle
from experiments.formats.scenario import read_scenario
from experiments.formats.scene.scene import Scene, read_scene, usable_scene
from experiments.formats.scene.space_marks import outward
from experiments.projects.mesh_body import SHALLOWEST_MM, MeshChoice, _check_words
from experiments.projects.template import GROUP_SD
from tests.experiments.command import softaim
from tests.experiments.formats.mesh.shapes import box
from tests.experiments.projects.test_project import commands_of
from tests.experiments.rows import rows
from tests.test_words import findings

NODES, ELEMENTS = box((8, 6, 6), 5.0)
WALL = ("--unit", "mm", "--fixed", "x<1")


@pytest.fixture(scope="module")
def body(tmp_path_factory) -> Path:
    """The box with a field, labels of its elements, and labelled faces at y = 0."""
    path = tmp_path_factory.mktemp("body") / "body.vtu"
    faces = np.array([element[[0, 1, 2, 0, 1, 3, 0, 2, 3, 1, 2, 3]].reshape(4, 3) for element in ELEMENTS]).reshape(
        -1, 3
    )
    side = faces[(NODES[faces][:, :, 1] == 0.0).all(axis=1)]
    labels = np.where(NODES[ELEMENTS].mean(axis=1)[:, 2] < 15.0, 1, 2)
    meshio.write_points_cells(
        path,
        NODES,
        [("triangle", side), ("tetra", ELEMENTS)],
        point_data={"glandularity": NODES[:, 0] / 40.0, "height": NODES[:, 1]},
        cell_data={
            "label": [np.r_[5, 1, np.full(len(side) - 2, 5)], labels],
            "part": [np.r_[np.full(len(side) - 9, 1), np.full(9, 7)], np.full(len(labels), 0.5)],
        },
    )
    return path


@pytest.fixture(scope="module", autouse=True)
def _own_cache(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.getbasetemp() / "cache"))
        yield


def made(folder: Path, body: Path, *words: object) -> Scene:
    assert softaim("new", folder, "--kind", "mesh", "--mesh", body, *WALL, *words) == 0
    return read_scene(folder / "scene.toml")


def test_marks_lie_apart_on_the_free_surface_and_the_target_inside(tmp_path: Path, body: Path, capsys) -> None:
    scene = made(tmp_path / "made", body, "--marks", 8)
    counts = "441 nodes, 49 of them fixed, 1728 tetrahedra, 36 ml"
    box = "x is 0 to 40 mm, y is 0 to 30 mm, z is 0 to 30 mm"
    assert f"{counts}, {box}, from body.vtu" in capsys.readouterr().out
    places = np.array([scene.network.positions[scene.network.index(node)] for node in scene.measured_nodes])
    assert len(places) == 8
    outside = (places == 0.0) | np.isclose(places, [0.04, 0.03, 0.03], atol=1e-9)
    assert outside.any(axis=1).all()
    assert (places[:, 0] > 0.001).all()
    apart = np.linalg.norm(places[:, None] - places, axis=2) + np.eye(8)
    assert apart.min() > 0.015
    assert [mark.hue_deg for mark in scene.marks[:7]] == [0.0, 120.0, 240.0, 60.0, 180.0, 300.0, 0.0]
    target = scene.network.positions[scene.network.index(scene.target.node)]
    assert np.linalg.norm(target - [0.02, 0.015, 0.015]) < 0.005
    assert scene.target.node not in scene.measured_nodes
    assert scene.target.position_sd_m == 0.0


def test_the_simulated_tissue_differs_in_stiffness_and_damping_alone(tmp_path: Path, body: Path) -> None:
    scene = made(
        tmp_path / "made", body, "--marks", 6, "--region", "1=fat", "--region", "2=gland", "--fixed", "faces 5"
    )
    assert (scene.network.positions[scene.network.fixed, 1] == 0.0).all()
    assert scene.mesh.tissues == (TISSUES["fat"], TISSUES["gland"])
    truth = usable_scene(tmp_path / "made" / "truth" / "scene.toml")
    np.testing.assert_array_equal(truth.network.positions, scene.network.positions)
    for own, assumed in zip(truth.mesh.tissues, scene.mesh.tissues, strict=True):
        assert 0.0 < abs(np.log(own.young_pa / assumed.young_pa)) < 3.5 * GROUP_SD["stiffness"]
        assert 0.0 < abs(np.log(own.damping_s / assumed.damping_s)) < 3.5 * GROUP_SD["damping"]
        assert own.density_kg_m3 == assumed.density_kg_m3


def test_a_field_makes_four_mixtures_and_labelled_faces_hold_it(tmp_path: Path, body: Path) -> None:
    scene = made(tmp_path / "made", body, "--marks", 6, "--field", "glandularity", "--fixed", "faces part=1")
    names = [tissue.name for tissue in scene.mesh.tissues]
    assert names == ["gland 0-25", "gland 25-50", "gland 50-75", "gland 75-100"]
    densities = [tissue.density_kg_m3 for tissue in scene.mesh.tissues]
    np.testing.assert_allclose(densities, 911.0 + (np.arange(4) + 0.5) / 4.0 * 130.0)
    assert (scene.network.positions[scene.network.fixed, 1] == 0.0).all()
    assert scene.network.fixed.any()


def test_marks_of_a_file_are_moved_onto_the_surface(tmp_path: Path, body: Path) -> None:
    (tmp_path / "marks.csv").write_text("name,x_mm,y_mm,z_mm\nleft,41,12.5,11\nright,22,15,30.5\n", encoding="utf-8")
    scene = made(
        tmp_path / "made", body, "--marks", tmp_path / "marks.csv", "--target", "21,14,13", "--target-sd-mm", 2
    )
    places = {name: 1e3 * scene.network.positions[scene.network.index(name)] for name in ("left", "right", "T")}
    np.testing.assert_allclose(places["left"], [40.0, 12.5, 11.0], atol=1e-3)
    np.testing.assert_allclose(places["right"], [22.0, 15.0, 30.0], atol=1e-3)
    np.testing.assert_allclose(places["T"], [21.0, 14.0, 13.0], atol=1e-3)
    assert scene.target.position_sd_m == 0.002
    truth = usable_scene(tmp_path / "made" / "truth" / "scene.toml")
    assert truth.target.position_sd_m == 0.0
    actual = truth.network
    off = actual.positions[actual.index("T")] - 1e-3 * places["T"]
    assert 1e-3 < np.linalg.norm(off) < 8e-3  # drawn with 2 mm an axis
    for name in ("left", "right"):
        np.testing.assert_allclose(actual.positions[actual.index(name)], 1e-3 * places[name], atol=1e-9)


def test_marks_face_across_the_surface_of_the_mesh(tmp_path: Path, body: Path) -> None:
    """Four on the upper face: the hull of them and the target is a pyramid, whose corners would face aside."""
    rows = [f"{x}{y},{x},{y},30" for x in (10, 30) for y in (10, 20)]
    (tmp_path / "marks.csv").write_text("\n".join(["name,x_mm,y_mm,z_mm", *(f"S{row}" for row in rows), ""]))
    scene = made(tmp_path / "made", body, "--marks", tmp_path / "marks.csv")
    np.testing.assert_allclose(outward(scene, scene.measured_nodes), np.tile([0.0, 0.0, 1.0], (4, 1)), atol=1e-9)


def test_two_marks_at_one_place_are_refused_in_their_table(tmp_path: Path, body: Path, capsys) -> None:
    table = tmp_path / "marks.csv"
    table.write_text("name,x_mm,y_mm,z_mm\nA,10,10,30\nB,20,10,30\nC,10,10,30.1\n", encoding="utf-8")
    words = ("--kind", "mesh", "--mesh", body, *WALL, "--marks", table)
    assert softaim("new", tmp_path / "made", *words) == 2
    assert "marks.csv: row 4: x_mm: expected a place on the surface that no other mark has" in capsys.readouterr().err


@pytest.fixture(scope="module")
def soft(tmp_path_factory, body: Path) -> Path:
    """A project of one tissue of 4 kPa."""
    folder = tmp_path_factory.mktemp("soft") / "made"
    made(folder, body, "--marks", 6, "--young-kpa", 4)
    return folder


def test_its_files_are_read_and_explained(soft: Path) -> None:
    folder, scene = soft, read_scene(soft / "scene.toml")
    assert scene.mesh.tissues[0].young_pa == 4e3
    plan = read_needle(folder / "needle.toml", scene.target.radius_m, 3)
    target = scene.network.positions[scene.network.index("T")]
    way = target - plan.insertion.entry
    assert SHALLOWEST_MM < 1e3 * np.linalg.norm(way) < 50.0
    mesh = mesh_of(scene.mesh.content, Path(scene.mesh.file)).mesh
    away_m = locate_on_surface(mesh, surface(mesh).faces, plan.insertion.entry[None])[2]
    assert away_m[0] < 1e-4  # the file has tenths of a millimetre
    assert way @ plan.insertion.axis > 0.9 * np.linalg.norm(way)
    for name in ("still.toml", "calibration.toml", "scenario.toml"):
        read_scenario(str(folder / name))
    for page in folder.rglob("*.toml"):
        assert list(findings(page.read_text(encoding="utf-8"))) == [], page
    assert not any("--at-rest" in command for command in commands_of(folder))
    assert "only fast motion shows the stiffness" in (folder / "STEPS.md").read_text(encoding="utf-8")
    text = (folder / "scene.toml").read_text(encoding="utf-8")
    for key in ("file", "fixed", "region", "young_kpa", "poisson", "density_kg_m3", "damping_s", "position_mm"):
        first = next(line for line in text.splitlines() if line.startswith(f"{key} = "))
        assert "#" in first, key


FAULTS = """
--fixed x<-1 | --fixed: expected a part of the body, found none; x is 0 to 40 mm
--fixed x<99 | --fixed: expected 3 nodes or more, and not all, found 441 of 441; x is 0 to 40 mm
--fixed 'q < 3' | --fixed: expected "y < 6" [mm], "faces 2" or "region 1", found "q < 3"
--fixed 'faces 1' | expected one field with label 1, "faces label=1" or "faces part=1", found "faces 1"
--fixed 'region 2' --region 1=fat --region 2=gland | --fixed: expected a region, 0 (fat), 1 (gland), found "region 2"
--fixed 'faces 9' | --fixed: expected a label of faces in the file, found "9"; it has 1, 5, 7
--marks 0 | --marks: expected 1 or more, or a file of marks, found 0
--marks none.csv | none.csv: expected a file, found none
--target 60,10,10 | --target: expected a place inside body.vtu, found 60,10,10, which is outside; x is 0 to 40 mm
--fixed x<6 --target 4,9,9 | --target: expected a position that can move, found 4,9,9, which --fixed x<6
--target-sd-mm 1e5 | --target-sd-mm: expected an SD that leaves the target inside the body
--target 6,10 | --target: expected x,y,z [mm], found "6,10"
--field none | --field: expected a field of body.vtu, glandularity, height, label, part, found "none"
--field height | --field: expected height from 0 (fat) to 1 (gland), found 1.25 to 28.75
--region 1=fat | --region: expected a tissue for label 2 of label, found none
--region 3=fat | --region: expected a label of label, 1, 2, found "3=fat"
--region 1=fat --region 1=gland | --region: expected each label once, found "1=gland"
--region 1=fat --field part | whole numbers of the elements of body.vtu, found "part"; it has label, part with 0.5 in
    element 0
--region 1=bone | --region: expected LABEL=TISSUE with one of fat, gland, fibrous, skin, fascia, muscle
--field label --young-kpa 4 | --young-kpa: expected no --region and no --field with it
--nodes nodes.csv | --mesh: expected no --nodes beside it, found nodes.csv
--kind breast | --kind breast: expected no --mesh, found
"""


@pytest.mark.parametrize(("words", "message"), rows(FAULTS))
def test_faults_are_one_line(words: str, message: str, body: Path, tmp_path: Path, capsys) -> None:
    assert softaim("new", tmp_path / "made", "--kind", "mesh", "--mesh", body, *WALL, *shlex.split(words)) == 2
    err = capsys.readouterr().err
    assert message in err
    assert err.count("\n") == 1
    assert not (tmp_path / "made").exists()


def test_a_field_of_a_file_without_fields_is_one_line(tmp_path: Path, capsys) -> None:
    path = tmp_path / "bare.vtu"
    meshio.write_points_cells(path, NODES, [("tetra", ELEMENTS)])
    assert softaim("new", tmp_path / "made", "--kind", "mesh", "--mesh", path, *WALL, "--field", "glandularity") == 2
    expected = '--field: expected no --field, because bare.vtu has no fields, found "glandularity"\n'
    assert capsys.readouterr().err.endswith(expected)


@pytest.mark.parametrize(("value", "shown"), [(np.nan, "nan"), (np.inf, "inf"), (1.5, "1.5")])
def test_labels_that_are_no_whole_numbers_are_one_line(tmp_path: Path, capsys, value: float, shown: str) -> None:
    path, labels = tmp_path / "bad.vtu", np.ones(len(ELEMENTS))
    labels[3] = value
    meshio.write_points_cells(path, NODES, [("tetra", ELEMENTS)], cell_data={"label": [labels]})
    words = ("--kind", "mesh", "--mesh", path, *WALL, "--region", "1=fat")
    assert softaim("new", tmp_path / "made", *words) == 2
    expected = "--field: expected a field of whole numbers of the elements of bad.vtu, found none; it has label with"
    assert capsys.readouterr().err.endswith(f"{expected} {shown} in element 3\n")


def test_without_wall_or_mesh_it_asks(body: Path, tmp_path: Path, capsys) -> None:
    call = ("new", tmp_path / "made", "--kind", "mesh", "--mesh", body)
    assert softaim(*call, "--unit", "mm") == 2
    assert "found none; x is 0 to 40 mm, y is 0 to 30 mm, z is 0 to 30 mm" in capsys.readouterr().err
    assert softaim("new", tmp_path / "made", "--kind", "mesh", "--unit", "mm") == 2
    assert "--unit: expected --mesh beside it, found none" in capsys.readouterr().err


def test_a_recording_has_its_mesh(tmp_path: Path, soft: Path) -> None:
    folder = tmp_path / "made"
    shutil.copytree(soft, folder)
    scene = read_scene(folder / "scene.toml")
    text = (folder / "still.toml").read_text(encoding="utf-8").replace("duration_s = 2.0", "duration_s = 0.1")
    (folder / "still.toml").write_text(text, encoding="utf-8")
    assert softaim("simulate", folder / "still.toml", "--out", tmp_path / "still") == 0
    recorded = usable_scene(tmp_path / "still" / "scene.toml")
    assert recorded.network.names == scene.network.names
    assert (tmp_path / "still" / "mesh.npz").read_bytes() == (folder / "mesh.npz").read_bytes()
    assert softaim("identify", tmp_path / "still", "--at-rest", "--out", tmp_path / "rest.toml") == 2


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--fixed", "x<-1"], "--fixed: expected a part of the body, found none; x is 0 to 40 mm"),
        (["--fixed", "faces 5"], "--fixed: expected tetrahedra with labels in skin.stl, found a surface"),
        (["--marks", "none.csv"], "none.csv: expected a file, found none"),
    ],
)
def test_options_are_checked_before_a_surface_is_filled(words, message, tmp_path, capsys, monkeypatch):
    faces = surface(TetMesh(1e-3 * NODES, ELEMENTS)).faces
    meshio.write_points_cells(tmp_path / "skin.stl", NODES, [("triangle", faces)])
    monkeypatch.setattr(body_file, "filled", None)
    call = ("new", tmp_path / "made", "--kind", "mesh", "--mesh", tmp_path / "skin.stl", *WALL, *words)
    assert softaim(*call) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(("n", "words"), [(6, "found 6: the target is poorly"), (90, "more than 80, found 90")])
def test_a_number_of_marks_of_little_use_is_one_warning(caplog, n: int, words: str) -> None:
    _check_words(MeshChoice(Path("body.vtu"), marks=str(n)), None)
    (record,) = caplog.records
    assert words in record.message


def test_a_folder_with_files_is_refused_before_the_body_is_read(body: Path, tmp_path: Path, capsys) -> None:
    (tmp_path / "file").touch()
    call = ("new", tmp_path, "--kind", "mesh", "--mesh", body, "--unit", "m", "--fixed", "x<1")
    assert softaim(*call) == 2
    assert "expected an empty or new folder" in capsys.readouterr().err
