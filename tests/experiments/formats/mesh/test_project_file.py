"""The mesh of a scene: the same bytes for the same mesh, the nodes that are held, and the cache of its network."""

import io
from pathlib import Path

import numpy as np
import pytest

from dynamics import MassSpringNetwork
from dynamics.elements import continuum_network
from dynamics.mesh import Tissue
from experiments.errors import InputError
from experiments.formats.mesh.body import tetrahedra
from experiments.formats.mesh.project_file import ProjectMesh, extents, held, mesh_content, mesh_of
from experiments.formats.mesh.reduced import reduced
from tests.experiments.formats.mesh.shapes import box

NODES, ELEMENTS = box((4, 3, 3), 0.01)
MESH = ProjectMesh(tetrahedra(Path("box"), NODES, ELEMENTS), np.arange(4))
TISSUE = Tissue("fat", 5e3, 0.4, 1000.0, 0.01)
POINTS = {"M1": np.array([0.04, 0.015, 0.015]), "T": np.array([0.022, 0.013, 0.014])}


def test_a_file_has_the_mesh_and_the_same_mesh_the_same_bytes() -> None:
    content = mesh_content(MESH)
    assert content == mesh_content(MESH)
    read = mesh_of(content, Path("mesh.npz"))
    np.testing.assert_array_equal(read.mesh.nodes, NODES)
    np.testing.assert_array_equal(read.mesh.elements, MESH.mesh.elements)
    np.testing.assert_array_equal(read.wall, MESH.wall)


def saved(**arrays) -> bytes:
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()


GOOD = {"nodes_m": NODES, "elements": ELEMENTS, "regions": np.zeros(1, dtype=int), "wall": np.arange(3)}


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"no file", "expected the mesh of softaim new, found "),
        (saved(nodes_m=NODES), "expected an array elements of the mesh of softaim new, found none"),
        (saved(**{**GOOD, "regions": np.array(["a"])}), "expected an array regions of the mesh"),
        (saved(**{**GOOD, "wall": np.array([400])}), "expected node numbers 0 to 79 in wall, found others"),
        (saved(**{**GOOD, "elements": ELEMENTS[:, [0, 2, 1, 3]]}), "elements: expected no flipped elements"),
        (saved(**{**GOOD, "nodes_m": np.array([{}], dtype=object)}), "expected the mesh of softaim new, found "),
    ],
)
def test_faults_of_a_file_are_one_line(content: bytes, expected: str) -> None:
    with pytest.raises(InputError, match=rf"^mesh.npz: {expected}[^\n]*$"):
        mesh_of(content, Path("mesh.npz"))


@pytest.mark.parametrize(
    ("fixed", "nodes"),
    [
        ("x < 5", np.flatnonzero(NODES[:, 0] < 0.005)),
        ("z>25.0", np.flatnonzero(NODES[:, 2] > 0.025)),
        ("wall", np.arange(4)),
    ],
)
def test_held_nodes(fixed: str, nodes: np.ndarray) -> None:
    np.testing.assert_array_equal(held(MESH, fixed), nodes)


ALL = "^expected 3 nodes or more, and not all, found 80 of 80; x is 0 to 40 mm"


@pytest.mark.parametrize(
    ("fixed", "said"), [("region 0", ALL), ("y < -1", "found 0 of 80"), ("y = 3", 'found "y = 3"'), ("", 'found ""')]
)
def test_other_walls_are_one_line(fixed: str, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        held(MESH, fixed)


class Reduced:
    """The network of a key; calls: number of reductions."""

    def __init__(self) -> None:
        self.calls = 0

    def __call__(self, key: str = "box") -> MassSpringNetwork:
        return reduced({"mesh": key}, self._make)

    def _make(self) -> MassSpringNetwork:
        self.calls += 1
        return continuum_network(MESH.mesh, [TISSUE], held(MESH, "x < 5"), POINTS)


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Reduced:
    """The network of a key, with a cache of its own."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return Reduced()


def test_the_cache_has_the_same_network(made: Reduced) -> None:
    first, second = made(), made()
    assert made.calls == 1
    assert second.names == first.names
    np.testing.assert_array_equal(second.positions, first.positions)
    assert second.continuum.tissues == ("fat",)
    for field in ("shapes", "rates", "damping", "by_tissue", "forces", "stiffness", "dashpots"):
        np.testing.assert_array_equal(getattr(second.continuum, field), getattr(first.continuum, field))
    made("another")
    assert made.calls == 2


def test_a_file_of_the_cache_that_is_not_whole_is_made_again(made: Reduced, tmp_path: Path) -> None:
    made()
    (file,) = tmp_path.rglob("*.npz")
    file.write_bytes(file.read_bytes()[:-9])
    made()
    made()
    assert made.calls == 2


def test_a_file_of_the_cache_that_cannot_be_read_is_made_again(made: Reduced, monkeypatch: pytest.MonkeyPatch) -> None:
    made()

    def refuse(_path: Path) -> bytes:
        raise PermissionError

    monkeypatch.setattr(Path, "read_bytes", refuse)
    made()
    assert made.calls == 2


def test_without_a_cache_it_is_made_each_time(made: Reduced, tmp_path: Path) -> None:
    (tmp_path / "softaim").write_text("a file, and no folder", encoding="utf-8")
    made()
    made()
    assert made.calls == 2


def test_extents_are_rounded_relative_to_the_largest_one() -> None:
    corners = np.array([[-0.05983, 1.0, -1.323e-18], [0.0, 1.04982, 0.0300004]])
    assert extents(corners) == "x is -59.83 to 0 mm, y is 1000 to 1049.82 mm, z is 0 to 30 mm"
