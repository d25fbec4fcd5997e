"""Meshes: what is refused, masses, surface, points in them, stiffness as scikit-fem has it."""

import numpy as np
import pytest

from dynamics.mesh import MeshError, TetMesh, locate, locate_on_surface, lumped_masses, patches, rest_stiffness, surface
from tests.dynamics.blocks import block
from tests.real_data import DATA

SIZE = (0.04, 0.05, 0.06)
BREAST = DATA / "breast" / "fine.vtu"


@pytest.fixture(name="mesh", scope="module")
def _mesh():
    return block((3, 4, 5), SIZE, regions=np.arange(360) % 2)


CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]) * 0.1
ONE = np.array([[0, 1, 2, 3]])

WRONG = {
    "in millimetres": (1e3 * CORNERS, ONE, "expected metres, an extent of at most 2 m, found 100 m"),
    "flat": (CORNERS * [1, 1, 0], ONE, "expected no flat elements, found 1 of 1, the first element 0"),
    "flipped": (CORNERS, ONE[:, [1, 0, 2, 3]], "expected no flipped elements, whose volume is negative, found 1 of 1"),
    "unused": (
        np.vstack([CORNERS, [[0.2, 0, 0]]]),
        ONE,
        "expected each in an element, found 1 in none, the first node 4",
    ),
    "loose": (np.vstack([CORNERS, CORNERS + 0.3]), np.vstack([ONE, ONE + 4]), r"found 2 parts of \[1, 1\] elements"),
    "joined at a node": (
        np.vstack([CORNERS, -CORNERS[1:]]),
        np.array([[0, 1, 2, 3], [0, 5, 4, 6]]),
        r"expected one body, connected by faces, found 2 parts of \[1, 1\] elements",
    ),
    "joined at an edge": (
        np.vstack([CORNERS, -CORNERS[1:3]]),
        np.array([[0, 1, 2, 3], [0, 4, 5, 3]]),
        r"found 2 parts of \[1, 1\] elements",
    ),
    "an element twice": (
        np.vstack([CORNERS, -CORNERS[3:]]),
        np.array([[0, 1, 2, 3], [0, 2, 1, 4], [0, 2, 1, 4]]),
        "expected each face in at most two, found 1 in more, such as duplicates, the first element 0",
    ),
    "not finite": (CORNERS * np.nan, ONE, "nodes: expected finite numbers"),
    "in the plane": (CORNERS[:, :2], ONE, r"expected finite numbers of shape \(n, 3\), found shape \(4, 2\)"),
    "triangles": (CORNERS, ONE[:, :3], r"elements: expected integers of shape \(m, 4\)"),
    "no elements": (CORNERS, np.empty((0, 4), dtype=int), r"elements: expected integers of shape \(m, 4\)"),
    "fractions": (CORNERS, ONE + 0.5, "elements: expected integers"),
    "beyond": (CORNERS, ONE + 1, "elements: expected nodes 0 to 3, found 1 to 4"),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_cannot_be_a_body_is_refused_in_one_line(case):
    nodes, elements, message = WRONG[case]
    with pytest.raises(MeshError, match=message) as caught:
        TetMesh(nodes, elements)
    assert isinstance(caught.value, ValueError)
    assert "\n" not in str(caught.value)


def test_regions_are_one_for_each_element():
    with pytest.raises(MeshError, match="regions: expected 1 integers"):
        TetMesh(CORNERS, ONE, np.array([1, 2]))


def test_masses_are_those_of_the_block(mesh):
    masses = lumped_masses(mesh, np.where(mesh.regions == 1, 1100.0, 900.0))
    np.testing.assert_allclose(mesh.volumes.sum(), np.prod(SIZE), rtol=1e-12)
    expected = 900.0 * np.prod(SIZE) + 200.0 * mesh.volumes[1::2].sum()
    np.testing.assert_allclose(masses.sum(), expected, rtol=1e-12)
    np.testing.assert_allclose(lumped_masses(TetMesh(CORNERS, ONE), 1e3), 1e3 * 0.1**3 / 24.0, rtol=1e-12)


def test_the_surface_is_that_of_the_block(mesh):
    outside = surface(mesh)
    a, b, c = SIZE
    on = (np.abs(mesh.nodes) < 1e-12) | (np.abs(mesh.nodes - SIZE) < 1e-12)
    np.testing.assert_array_equal(outside.nodes, np.flatnonzero(on.any(axis=1)))
    np.testing.assert_allclose(outside.areas.sum(), 2 * (a * b + b * c + c * a), rtol=1e-12)
    flat = on[outside.nodes].sum(axis=1) == 1
    expected = np.where(mesh.nodes[outside.nodes] < 1e-12, -1.0, 1.0) * on[outside.nodes]
    np.testing.assert_allclose(outside.normals[flat], expected[flat], atol=1e-12)
    corners = mesh.nodes[outside.faces]
    areas = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    # Gauss: the flux of x through a closed surface is three times the volume
    np.testing.assert_allclose(np.einsum("fd,fd->", areas, corners.mean(axis=1)), 3 * a * b * c, rtol=1e-12)


def test_points_are_their_weights_of_the_corners(mesh):
    points = np.random.default_rng(0).uniform(0.0, SIZE, (50, 3))
    elements, weights = locate(mesh, points)
    assert weights.min() >= -1e-9
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, rtol=1e-12)
    np.testing.assert_allclose(
        np.einsum("ka,kad->kd", weights, mesh.nodes[mesh.elements[elements]]), points, atol=1e-12
    )
    with pytest.raises(MeshError, match="point 1: expected a place inside the mesh"):
        locate(mesh, np.array([[0.01, 0.01, 0.01], [0.01, 0.01, -0.001]]))


def test_points_beside_the_surface_are_put_on_it(mesh):
    """The nearest place of a block is each coordinate clipped to its range."""
    points = np.random.default_rng(0).uniform(-0.03, np.array(SIZE) + 0.03, (80, 3))
    points = points[((points < 0.0) | (points > SIZE)).any(axis=1)]
    faces = surface(mesh).faces
    found, weights, distances = locate_on_surface(mesh, faces, points)
    nearest = np.clip(points, 0.0, SIZE)
    np.testing.assert_allclose(np.einsum("kc,kcd->kd", weights, mesh.nodes[faces[found]]), nearest, atol=1e-12)
    np.testing.assert_allclose(distances, np.linalg.norm(points - nearest, axis=1), atol=1e-12)
    assert weights.min() >= 0.0


def test_patches_are_neighbours_of_one_region():
    mesh = block((4, 4, 4), (0.04, 0.04, 0.04), regions=(np.arange(384) < 100).astype(int))
    patch = patches(mesh)
    sizes = np.bincount(patch)
    assert sizes.min() >= 9
    assert sizes.max() <= 16
    centres = mesh.nodes[mesh.elements].mean(axis=1)
    for k in range(len(sizes)):
        assert len(set(mesh.regions[patch == k])) == 1
        assert np.ptp(centres[patch == k], axis=0).max() < 0.035


def test_the_stiffness_at_rest_is_that_of_scikit_fem(mesh):
    skfem = pytest.importorskip("skfem")
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    basis = skfem.Basis(
        skfem.MeshTet(mesh.nodes.T.copy(), mesh.elements.T.copy()), skfem.ElementVector(skfem.ElementTetP1())
    )
    expected = linear_elasticity(*lame_parameters(3e3, 0.4)).assemble(basis).toarray()
    at = basis.nodal_dofs.T.ravel()
    free = np.flatnonzero(mesh.nodes[:, 0] > 0.0)[::-1]
    rows = (3 * free[:, None] + np.arange(3)).ravel()
    for own, chosen in ((rest_stiffness(mesh, 3e3, 0.4), at), (rest_stiffness(mesh, 3e3, 0.4, free), at[rows])):
        np.testing.assert_allclose(own.toarray(), expected[np.ix_(chosen, chosen)], rtol=0, atol=1e-10 * expected.max())
    assert own.format == "csc"


@pytest.mark.skipif(not BREAST.is_file(), reason="no fine.vtu: set SOFTAIM_DATA to the folder of real scans")
def test_a_real_breast_is_a_mesh():
    """226 x 131 x 31 mm, and of the lesions of the scan's page one is in fat, one in gland."""
    meshio = pytest.importorskip("meshio")
    read = meshio.read(BREAST)
    mesh = TetMesh(1e-3 * read.points, read.cells_dict["tetra"])
    np.testing.assert_allclose(np.ptp(mesh.nodes, axis=0), [0.226, 0.131, 0.031], atol=1e-3)
    elements, weights = locate(mesh, 1e-3 * np.array([[188.5, 41.2, 15.0], [140.6, 49.2, 15.0]]))
    in_fat, in_gland = (weights * read.point_data["glandularity"].ravel()[mesh.elements[elements]]).sum(axis=1)
    assert in_fat < in_gland
