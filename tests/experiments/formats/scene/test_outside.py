"""The outside of a body: closed, of its volume, counter-clockwise from outside; of fewer faces, of the same shape."""

from types import SimpleNamespace

import numpy as np
import pytest

from dynamics.mesh import TetMesh
from experiments.formats.scene import outside
from experiments.formats.scene.outside import Outside, outside_of, wall_faces
from experiments.formats.scene.scene import read_scene
from tests.dynamics.blocks import block as solid
from tests.experiments.formats.scene.test_mesh import folder
from tests.experiments.plots.tracks import block

pytestmark = pytest.mark.usefixtures("mesh_cache")


def volume(of: Outside) -> float:
    """The volume inside a closed surface whose faces are counter-clockwise from outside."""
    a, b, c = (of.corners[of.faces[:, k]] for k in range(3))
    return float(np.einsum("ni,ni->", a, np.cross(b, c)) / 6.0)


def test_of_a_mesh_it_is_the_surface_and_of_springs_their_hull(tmp_path) -> None:
    """A box of 40 x 30 x 30 mm in cells of 10 mm, and a block of 60 x 60 x 40 mm."""
    mesh = outside_of(read_scene(folder(tmp_path)), 1000)
    assert volume(mesh) == pytest.approx(36e-6)
    assert len(mesh.faces) == 2 * 2 * (4 * 3 + 4 * 3 + 3 * 3)
    assert volume(outside_of(block(), 1000)) == pytest.approx(144e-6)


def test_the_wall_is_the_faces_whose_corners_are_held(tmp_path) -> None:
    """Those of the box at x = 0, 30 x 30 mm; none of a body of springs."""
    scene = read_scene(folder(tmp_path))
    mesh = outside_of(scene, 1000)
    held = wall_faces(scene, mesh)
    assert (mesh.corners[mesh.faces[held]][..., 0] == 0.0).all()
    assert 0.5 * np.linalg.norm(mesh.normals[held], axis=1).sum() == pytest.approx(900e-6)
    assert not wall_faces(block(), outside_of(block(), 1000)).any()


def test_nodes_inside_a_solid_do_not_shrink_it(tmp_path, monkeypatch) -> None:
    """A solid, half a cube and half a ball, of 4800 faces: in 1500 within 3 % of its volume; corners have faces."""
    cube = solid((20, 20, 20), (2.0, 2.0, 2.0))
    at = cube.nodes - 1.0
    by = np.abs(at).max(axis=1) / np.maximum(np.linalg.norm(at, axis=1), 1e-9)
    ball = TetMesh(at * (0.5 + 0.5 * by[:, None]), cube.elements)
    monkeypatch.setattr(outside, "mesh_of", lambda *_: SimpleNamespace(mesh=ball))
    scene = read_scene(folder(tmp_path))
    whole, drawn = outside_of(scene, 4800), outside_of(scene, 1500)
    assert len(whole.faces) == 4800
    assert len(drawn.faces) > 500
    assert volume(drawn) == pytest.approx(volume(whole), rel=0.03)
    for one in (whole, drawn):
        np.testing.assert_array_equal(np.unique(one.faces), np.arange(len(one.corners)))
