"""The breast of tetrahedra: its volume, its tissues, its points."""

import numpy as np
import pytest

from dynamics.mesh import surface
from dynamics.phantoms import breast_mesh, breast_points
from dynamics.phantoms.breast_mesh import SEMI_AXES_M, TISSUES


def test_it_is_nearly_half_an_ellipsoid():
    mesh, fixed = breast_mesh(12, 8)
    assert len(mesh.nodes) == 13 * 13 * 9
    assert mesh.volumes.sum() == pytest.approx(2.0 / 3.0 * np.pi * np.prod(SEMI_AXES_M), rel=0.2)
    np.testing.assert_allclose(mesh.nodes[fixed, 2], 0.0)
    assert set(mesh.regions) == set(range(len(TISSUES)))


def test_marks_are_apart_on_the_skin_and_the_target_lies_inside():
    mesh, fixed = breast_mesh(10, 7)
    points = breast_points(mesh, fixed, 20)
    marks = np.array([place for name, place in points.items() if name != "target"])
    skin = mesh.nodes[surface(mesh).nodes]
    assert all(np.linalg.norm(skin - mark, axis=1).min() < 1e-12 for mark in marks)
    apart = np.linalg.norm(marks[:, None] - marks, axis=2) + np.eye(len(marks))
    assert apart.min() > 0.015
    assert np.linalg.norm(points["target"] / SEMI_AXES_M) < 0.6
