"""Mesh files of other programs: bodies with their unit, fields and faces, and one line for each fault.

Volumes are those of the shapes: a box of 40 x 20 x 20 mm, a sphere of 30 mm.
"""

from pathlib import Path

import meshio
import numpy as np
import pytest

from dynamics.mesh import surface
from experiments.errors import InputError
from experiments.formats.mesh.body import Body, read_body
from experiments.formats.mesh.source import read_source
from tests.experiments.formats.mesh.shapes import box, sphere
from tests.experiments.rows import complaint

NODES, ELEMENTS = box((4, 2, 2), 10.0)


def written(path: Path, nodes, cells, **data) -> Path:
    meshio.write_points_cells(path, nodes, cells, **data)
    return path


def read(path: Path, nodes, cells, **data) -> Body:
    return read_body(written(path, nodes, cells, **data), "mm")


@pytest.mark.parametrize("ending", [".vtu", ".vtk", ".msh"])
def test_a_volume_is_read_with_its_fields(tmp_path: Path, ending: str) -> None:
    labels = np.where(np.arange(len(ELEMENTS)) < 30, 1, 2)
    data = {"point_data": {"gland": NODES[:, 0] / 40.0}, "cell_data": {"tissue": [labels]}}
    kept = {"file_format": "gmsh22"} if ending == ".msh" else {}
    body = read(tmp_path / f"body{ending}", NODES, {"tetra": ELEMENTS}, **data, **kept)
    assert body.mesh.volumes.sum() == pytest.approx(16e-6, rel=1e-9)
    np.testing.assert_allclose(body.fields["gland"], body.mesh.nodes[:, 0] / 0.04, atol=1e-12)
    np.testing.assert_array_equal(body.cell_fields["tissue"], labels)


@pytest.mark.parametrize(("unit", "size"), [("mm", 10.0), ("cm", 1.0), ("m", 0.01)])
def test_units(tmp_path: Path, unit: str, size: float) -> None:
    nodes, elements = box((4, 2, 2), size)
    body = read_body(written(tmp_path / "body.vtu", nodes, {"tetra": elements}), unit)
    np.testing.assert_allclose(np.ptp(body.mesh.nodes, axis=0), [0.04, 0.02, 0.02], rtol=1e-12)


def test_elements_that_are_all_flipped_are_the_order_of_the_file(tmp_path: Path) -> None:
    body = read(tmp_path / "body.vtu", NODES, {"tetra": ELEMENTS[:, [0, 2, 1, 3]]})
    assert (body.mesh.volumes > 0.0).all()


def test_nodes_of_no_element_are_left_out_with_their_numbers(tmp_path: Path) -> None:
    nodes = np.vstack([[[500.0, 0.0, 0.0], [np.nan, 0.0, 0.0]], NODES])
    data = {"point_data": {"x": np.arange(len(nodes), dtype=float)}}
    body = read(tmp_path / "body.vtu", nodes, {"tetra": ELEMENTS + 2}, **data)
    np.testing.assert_array_equal(body.fields["x"], np.arange(2, len(nodes)))
    assert len(body.mesh.nodes) == len(NODES)


def test_labels_of_faces_are_those_of_the_outside(tmp_path: Path) -> None:
    """The triangles at x = 0 have label 7; one that lies inside is left out."""
    body = read(tmp_path / "plain.vtu", NODES, {"tetra": ELEMENTS})
    faces = surface(body.mesh).faces
    wall = faces[(body.mesh.nodes[faces][:, :, 0] == 0.0).all(axis=1)]
    inside = ELEMENTS[0, [0, 1, 3]][None]
    cells = [("triangle", np.vstack([wall[:, ::-1], inside])), ("tetra", ELEMENTS)]
    labels = {"label": [np.full(len(wall) + 1, 7), np.zeros(len(ELEMENTS), dtype=int)]}
    labelled = read(tmp_path / "body.vtu", NODES, cells, cell_data=labels).faces
    at = labelled.nodes[labelled.fields["label"] == 7]
    assert {frozenset(face) for face in at.tolist()} == {frozenset(face) for face in wall.tolist()}
    assert np.isnan(labelled.fields["label"]).sum() == len(faces) - len(wall)


def flipped() -> np.ndarray:
    elements = ELEMENTS.copy()
    elements[3] = elements[3, [0, 2, 1, 3]]
    return elements


def flat() -> np.ndarray:
    nodes = NODES.copy()
    nodes[ELEMENTS[0, 0]] = nodes[ELEMENTS[0, 1:]].mean(axis=0)
    return nodes


BALL, SHELL = sphere(30.0)
INFINITE = np.where(np.arange(45)[:, None] == 8, np.inf, NODES)
QUADRATIC = np.concatenate([ELEMENTS, ELEMENTS, ELEMENTS[:, :2]], axis=1)
TWO = (np.vstack([NODES, NODES + np.array([60.0, 0.0, 0.0])]), np.vstack([ELEMENTS, ELEMENTS + len(NODES)]))


FAULTS_OF_A_VOLUME = [
    (NODES, flipped(), "elements: expected no flipped elements, whose volume is negative, found 1 of 96"),
    (flat(), ELEMENTS, "elements: expected no flat elements, found"),
    (*TWO, r"elements: expected one body, connected by faces, found 2 parts of \[96, 96\] elements"),
    (1e-3 * NODES, ELEMENTS, "expected a body of 20 mm to 1 m, found 0.04 mm with --unit mm"),
    (1500.0 * NODES, ELEMENTS, "expected a body of 20 mm to 1 m, found 60 m with --unit mm"),
    (INFINITE, ELEMENTS, "finite coordinates, found 1 without, the first node 8"),
    (NODES, ELEMENTS + 1, "expected nodes 0 to 44 in cells, found 1 to 45"),
    (NODES, QUADRATIC, "expected linear tetrahedra, or triangles of a surface, found 96 tetra10$"),
]


@pytest.mark.parametrize(("nodes", "elements", "expected"), FAULTS_OF_A_VOLUME)
def test_faults_of_a_volume_are_one_line(tmp_path: Path, nodes, elements, expected: str) -> None:
    kind = "tetra" if elements.shape[1] == 4 else "tetra10"
    with pytest.raises(InputError, match=rf"^{tmp_path / 'body.vtu'}: .*{expected}[^\n]*$"):
        read(tmp_path / "body.vtu", nodes, {kind: elements})


def test_without_a_unit_it_asks_with_the_extent_in_each(tmp_path: Path) -> None:
    path = written(tmp_path / "body.vtu", NODES, {"tetra": ELEMENTS})
    said = "--unit: expected the unit of body.vtu, mm, cm, m, found none; it is 40 mm in mm, 400 mm in cm, 40 m in m"
    assert complaint(read_body, path, None) == said


@pytest.mark.parametrize(
    ("vertex", "face"),
    [
        ("v {} {} {}", "f {0}//1 {1}//1 {2}//1"),
        ("v {} {} {} 0.5 0.5 0.5", "f {0}/1/1 {1}/2/1 {2}/1/1"),
        ("v {} {} {} 1.0", "f {0} \\\n {1} {2}"),
        ("v {} {} {}", "s off\nf {3} {4} {5}\nl 1 2"),
    ],
)
def test_the_forms_of_obj_are_read(tmp_path: Path, vertex: str, face: str) -> None:
    """Normals, texture coordinates of other counts, colours, continued lines, and indices from the end."""
    lines = ["o ball", "vt 0.5 0.5", "vt 0 1", "vn 0 0 1", *(vertex.format(*place) for place in BALL.tolist())]
    lines += [face.format(*(corners + 1).tolist(), *(corners - len(BALL)).tolist()) for corners in SHELL]
    (tmp_path / "ball.obj").write_text("\n".join(lines), encoding="utf-8")
    source = read_source(tmp_path / "ball.obj")
    np.testing.assert_allclose(source.points, BALL)
    np.testing.assert_array_equal(source.triangles.nodes, SHELL)


def test_a_polygon_of_obj_becomes_triangles(tmp_path: Path) -> None:
    (tmp_path / "face.obj").write_text("v 0 0 0\nv 1 0 0\nv 2 1 0\nv 1 2 0\nv 0 1 0\nf 1 2 3 4 5\n", encoding="utf-8")
    triangles = read_source(tmp_path / "face.obj").triangles.nodes
    np.testing.assert_array_equal(triangles, [[0, 1, 2], [0, 2, 3], [0, 3, 4]])


POLYDATA = "# vtk DataFile Version 5.1\nx\nASCII\nDATASET POLYDATA\n"


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("body.stp", "", "expected one of .vtk, .vtu, .msh, .stl, .obj, .ply, found .stp"),
        ("none.vtk", None, "expected a file, found none"),
        ("body.vtk", "no mesh\n", "expected a mesh of VTK, found "),
        ("body.vtk", POLYDATA, "expected an unstructured grid; a surface"),
        ("body.vtu", "<VTKFile", "expected a mesh of VTU, found "),
        ("body.msh", "", "expected a mesh of GMSH, found "),
        ("body.stl", "", "expected tetrahedra or triangles, found none; the file may be empty or truncated"),
        ("body.stl", "solid x\nendsolid x\n", "expected tetrahedra or triangles, found none; the file may be empty"),
        ("body.obj", "", "expected tetrahedra or triangles, found none; the file may be empty or truncated"),
        ("body.obj", "v 0 0 0\n", "expected tetrahedra, or triangles of a closed surface, found none"),
    ],
)
def test_files_that_are_no_mesh_are_one_line(tmp_path: Path, name: str, content: str | None, expected: str) -> None:
    if content is not None:
        (tmp_path / name).write_text(content, encoding="utf-8")
    with pytest.raises(InputError, match=rf"^{tmp_path / name}: {expected}[^\n]*$"):
        read_body(tmp_path / name, "mm")


def test_a_truncated_binary_stl_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "ball.stl"
    meshio.stl.write(path, meshio.Mesh(BALL, [("triangle", SHELL)]), binary=True)
    path.write_bytes(path.read_bytes()[:1000])
    said = f"{path}: expected a mesh of STL, found neither text nor a whole binary file; it may be truncated"
    assert complaint(read_body, path, "mm") == said


@pytest.mark.parametrize("ending", [".stl", ".vtu"])
def test_a_surface_is_filled(tmp_path: Path, ending: str, capfd, monkeypatch) -> None:
    """With elements of 8 mm the sphere has its volume to 6 %, and its nodes lie within 2 mm of it; no file is left."""
    monkeypatch.chdir(tmp_path)
    nodes, faces = sphere(30.0, 3)
    path = written(tmp_path / f"ball{ending}", nodes, {"triangle": faces[:, ::-1]})
    capfd.readouterr()
    mesh = read_body(path, "mm", 0.008).mesh
    assert capfd.readouterr() == ("", "")
    assert [file.name for file in tmp_path.iterdir()] == [path.name]
    assert mesh.volumes.sum() == pytest.approx(4.0 / 3.0 * np.pi * 0.03**3, rel=0.06)
    assert np.abs(np.linalg.norm(mesh.nodes[surface(mesh).nodes], axis=1) - 0.03).max() < 0.002
    edges = np.linalg.norm(np.diff(mesh.nodes[mesh.elements[:, [[0, 1], [0, 2], [0, 3]]]], axis=2), axis=3)
    assert 0.005 < edges.mean() < 0.012


def test_a_coarser_mesh_keeps_fields_and_labels(tmp_path: Path) -> None:
    """A field that is linear along x to an element's size, labels where they were."""
    nodes, elements = box((14, 7, 7), 2.0)
    middle = nodes[elements].mean(axis=1)[:, 0]
    data = {"point_data": {"x": nodes[:, 0]}, "cell_data": {"half": [np.where(middle < 14.0, 1, 2)]}}
    path = written(tmp_path / "body.vtu", nodes, {"tetra": elements}, **data)
    body = read_body(path, "mm", 0.005)
    assert len(body.mesh.nodes) < 0.5 * len(nodes)
    assert np.abs(body.fields["x"] - 1e3 * body.mesh.nodes[:, 0]).max() < 2.5
    centres = 1e3 * body.mesh.nodes[body.mesh.elements].mean(axis=1)[:, 0]
    away = np.abs(centres - 14.0) > 2.0
    np.testing.assert_array_equal(body.cell_fields["half"][away], np.where(centres < 14.0, 1, 2)[away])


def turned(faces: np.ndarray) -> np.ndarray:
    return np.vstack([faces[:1, ::-1], faces[1:]])


BALLS = (np.vstack([BALL, BALL + np.array([80.0, 0.0, 0.0])]), np.vstack([SHELL, SHELL + len(BALL)]))


@pytest.mark.parametrize(
    ("nodes", "faces", "expected"),
    [
        (BALL, SHELL[1:], r"expected a closed surface, found 1 hole, one of them at \[.*\] mm"),
        (BALL, turned(SHELL), "expected triangles that all face outward, found flipped ones at 3 edges, the first at"),
        (BALL, np.vstack([SHELL, SHELL[:1]]), "expected two triangles at each edge, found more at 3 edges"),
        (BALL, np.vstack([SHELL, [[0, 1, 0]]]), "expected no flat triangles, found 1 of 129, the first 128"),
        (*BALLS, r"expected one connected surface, found 2 parts of \[66, 66\] nodes"),
    ],
)
def test_faults_of_a_surface_are_one_line(tmp_path: Path, nodes, faces, expected: str) -> None:
    with pytest.raises(InputError, match=rf"^{tmp_path / 'ball.ply'}: {expected}[^\n]*$"):
        read(tmp_path / "ball.ply", nodes, {"triangle": faces})


def test_a_size_that_cannot_be_filled_is_one_line(tmp_path: Path) -> None:
    path = written(tmp_path / "ball.stl", BALL, {"triangle": SHELL})
    assert complaint(read_body, path, "mm", 0.06) == "--size-mm: expected 0.52 to 34.6 mm for ball.stl, found 60 mm"
