"""Tetrahedra: slopes of their energy, exact at constant strains, objective, of second order, free of locking."""

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve
from scipy.spatial.transform import Rotation

from dynamics.elements import Assembly, Tetrahedra, TissueConstants
from dynamics.mesh import patches, rest_stiffness
from tests.dynamics.blocks import block
from tests.dynamics.conftest import slope

LAWS = ("linear", "corotated", "neo-hookean")
TURNED = Rotation.from_rotvec([0.5, -1.0, 0.3]).as_matrix()

every_law = pytest.mark.parametrize("law", LAWS)
patched_or_not = pytest.mark.parametrize("patched", [False, True])


def body(law, patched=True, counts=(2, 2, 3), constants=None):
    """A block of some cm, of every constant different, all of its nodes free."""
    mesh = block(counts, (0.04, 0.05, 0.06))
    rng, m = np.random.default_rng(2), len(mesh.elements)
    own = TissueConstants(rng.uniform(1e3, 5e3, m), rng.uniform(0.2, 0.48, m), rng.uniform(0.01, 0.05, m))
    return mesh, Tetrahedra(mesh, law, constants or own, patches(mesh) if patched else None)


def in_motion(mesh):
    """Turned, strained by some 10 %, and moving."""
    rng = np.random.default_rng(3)
    x = (mesh.nodes + 1e-3 * rng.normal(size=mesh.nodes.shape)) @ TURNED.T
    return x, 0.1 * rng.normal(size=x.shape)


@patched_or_not
@every_law
def test_force_and_tangents_are_slopes_in_motion(law, patched):
    """Five-point rule, of all coordinates of a patch: relative error (h / 1 cm)⁴ about 1e-10 at 3e-5 m."""
    mesh, element = body(law, patched, (1, 1, 2))
    x, v = (field[element.nodes] for field in in_motion(mesh))
    force = element.force(x, np.zeros_like(v))
    by_energy = -slope(lambda at: element.energy(at).sum(), x, 3e-5).reshape(x.shape)
    np.testing.assert_allclose(by_energy, force, rtol=0, atol=1e-7 * np.abs(force).max())
    for found, of, at in zip(element.tangents(x, v), ("x", "v"), (x, v), strict=True):
        full = -slope(lambda at, of=of: element.force(*((at, v) if of == "x" else (x, at))), at, 3e-5)
        own = np.einsum("ncdnef->ncdef", full.reshape(*x.shape, *x.shape))
        np.testing.assert_allclose(found, own, rtol=0, atol=1e-7 * np.abs(own).max())
        np.testing.assert_allclose(np.abs(full).sum(), np.abs(own).sum(), rtol=1e-9)  # none by another patch


@every_law
def test_derivatives_by_constants_are_slopes_of_the_force(law):
    mesh, element = body(law)
    x, v = (field[element.nodes] for field in in_motion(mesh))
    found = element.by_log_constants(x, v)
    assert set(found) == set(TissueConstants._fields)
    for name, derivative in found.items():

        def force(log, name=name):
            grown = getattr(element.constants, name) * np.exp(log)
            return body(law, constants=element.constants._replace(**{name: grown}))[1].force(x, v)

        expected = slope(force, np.zeros(1), 2e-4)[..., 0]
        np.testing.assert_allclose(derivative, expected, rtol=0, atol=1e-7 * np.abs(expected).max())


@patched_or_not
@every_law
def test_the_tangents_at_rest_are_the_linear_stiffness_and_its_share(law, patched):
    """Against the vectorised NumPy of `rest_stiffness`, which scikit-fem confirms."""
    mesh, element = body(law, patched, constants=TissueConstants(3e3, 0.4, 0.02))
    K, C = Assembly(mesh.nodes, np.arange(len(mesh.nodes)), [element]).tangents(
        mesh.nodes.ravel(), np.zeros(mesh.nodes.size)
    )
    expected = rest_stiffness(mesh, 3e3, 0.4, patch=patches(mesh) if patched else None).toarray()
    np.testing.assert_allclose(K.toarray(), expected, rtol=0, atol=1e-10 * expected.max())
    np.testing.assert_allclose(C.toarray(), 0.02 * expected, rtol=0, atol=1e-10 * expected.max())


@patched_or_not
@pytest.mark.parametrize("law", LAWS[1:])
def test_a_body_that_turns_feels_nothing(law, patched):
    mesh, element = body(law, patched)
    x = mesh.nodes @ TURNED.T + [0.1, -0.2, 0.3]
    spin = np.cross([1.0, 2.0, 3.0], x)
    assert np.abs(element.force(x[element.nodes], spin[element.nodes])).max() < 1e-12  # moduli times areas: 1 N
    assert np.abs(element.energy(x[element.nodes])).max() < 1e-15


def stress_of(law, F, E, nu):
    """First Piola-Kirchhoff stress by the textbook's formulas [Pa]; the rotation by singular values."""
    lam, mu, one = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu)), np.eye(3)
    if law == "linear":
        return mu * (F + F.T - 2 * one) + lam * np.trace(F - one) * one
    if law == "corotated":
        U, s, V = np.linalg.svd(F)
        return 2 * mu * (F - U @ V) + lam * (s.sum() - 3) * U @ V
    J, inverse = np.linalg.det(F), np.linalg.inv(F).T
    return mu * (F - inverse) + lam * (J - 1) * J * inverse


@patched_or_not
@every_law
def test_patch_test_constant_strain_has_the_textbooks_stress(law, patched):
    """Inner nodes stay where an even strain puts them; a face is pulled by its stress times its area."""
    mesh, element = body(law, patched, constants=TissueConstants(3e3, 0.4))
    F = TURNED @ (np.eye(3) + 0.2 * np.random.default_rng(4).normal(size=(3, 3)))
    x, n = mesh.nodes @ F.T, len(mesh.nodes)
    force = np.zeros_like(x)
    np.add.at(force, element.nodes, element.force(x[element.nodes], np.zeros((*element.nodes.shape, 3))))
    inner = ((mesh.nodes > 1e-9) & (mesh.nodes < np.ptp(mesh.nodes, axis=0) - 1e-9)).all(axis=1)
    assert 0 < inner.sum() < n
    np.testing.assert_allclose(force[inner], 0.0, atol=1e-10)
    # Of all boundary forces: sum of f_i X_j is minus P times the volume
    stress = -np.einsum("ni,nj->ij", force, mesh.nodes) / (0.04 * 0.05 * 0.06)
    expected = stress_of(law, F, 3e3, 0.4)
    np.testing.assert_allclose(stress, expected, rtol=0, atol=1e-10 * np.abs(expected).max())


def settled(assembly, q, load=0.0):
    """Rest under a load, by Newton's method."""
    for _ in range(20):
        step = spsolve(assembly.tangents(q, 0.0 * q)[0].tocsc(), assembly.force(q, 0.0 * q) + load)
        q = q + step
        if np.abs(step).max() < 1e-12:
            return q
    raise AssertionError("no rest found")


@pytest.mark.parametrize("law", LAWS[1:])
def test_second_order_against_a_manufactured_solution(law):
    """Displacements of small sines, and the body force div P by differences; L2 error by the square of the mesh."""
    size, E, nu = np.full(3, 0.1), 3e3, 0.3

    def displaced(X):
        s = np.sin(np.pi * X / 0.1)
        return X + 2e-3 * np.stack([s[..., 0] * s[..., 1], s[..., 1] * s[..., 2], s[..., 2] * s[..., 0]], axis=-1)

    def gradient(X):
        return np.stack([(displaced(X + e) - displaced(X - e)) / 2e-6 for e in 1e-6 * np.eye(3)], axis=-1)

    def pushed(X):
        h = 1e-4
        rows = [
            (stress_of(law, gradient(X + h * e), E, nu) - stress_of(law, gradient(X - h * e), E, nu)) @ e / (2 * h)
            for e in np.eye(3)
        ]
        return -np.sum(rows, axis=0)

    errors = []
    for n in (4, 8):
        mesh = block((n, n, n), size, 0.1)
        x = np.broadcast_to(displaced(mesh.nodes), mesh.nodes.shape)  # read-only, as a mesh's nodes are
        free = np.flatnonzero(((mesh.nodes > 1e-9) & (mesh.nodes < 0.0999)).all(axis=1))
        masses = np.bincount(mesh.elements.ravel(), np.repeat(mesh.volumes / 4.0, 4))
        load = np.stack([masses[i] * pushed(mesh.nodes[i]) for i in free]).ravel()
        element = Tetrahedra(mesh, law, TissueConstants(E, nu))
        q = settled(Assembly(x, free, [element]), x[free].ravel(), load)
        errors.append(np.sqrt(np.mean((q - x[free].ravel()) ** 2)))
    assert 1.7 < np.log2(errors[0] / errors[1]) < 2.4


def test_a_nearly_incompressible_beam_bends_as_timoshenko_says():
    """At nu = 0.499, four cells high; constant strains leave a fifth, as they do at nu = 0.3; locked, nine tenths."""
    length, height, E, nu, load = 0.1, 0.02, 3e3, 0.499, 1e-4
    mesh = block((20, 4, 4), (length, height, height))
    element = Tetrahedra(mesh, "neo-hookean", TissueConstants(E, nu), patches(mesh))
    free = np.flatnonzero(mesh.nodes[:, 0] > 1e-9)
    tip = mesh.nodes[free, 0] > length - 1e-9
    weight = np.zeros((len(free), 3))
    weight[tip, 2] = -load / tip.sum()
    rest = mesh.nodes[free].ravel()
    q = settled(Assembly(mesh.nodes, free, [element]), rest, weight.ravel())
    sunk = -(q - rest).reshape(-1, 3)[tip, 2].mean()
    shear = E / (2 * (1 + nu)) * 5 / 6 * height**2
    theory = load * length**3 / (3 * E * height**4 / 12) + load * length / shear
    assert 0.75 < sunk / theory < 1.0


def test_a_neo_hookean_tetrahedron_inside_out_has_no_finite_energy():
    mesh, element = body("neo-hookean")
    x = (mesh.nodes * [-1.0, 1.0, 1.0])[element.nodes]
    assert np.isinf(element.energy(x)).all()
    assert np.isnan(element.force(x, 0.0 * x)).any()


def test_patches_may_have_any_numbers():
    mesh = block((1, 1, 1), (0.1, 0.1, 0.1))
    own, constants = np.arange(len(mesh.elements)) // 3, TissueConstants(3e3, 0.4)
    found, other = (Tetrahedra(mesh, "linear", constants, patch) for patch in (own, 7 * own - 2))
    x = 1.1 * mesh.nodes[found.nodes]
    assert found.energy(x).min() > 0.0
    np.testing.assert_array_equal(found.energy(x), other.energy(x))


@pytest.mark.parametrize(("law", "n", "said"), [("rubber", 6, "law: expected one of linear"), ("linear", 5, "patch: ")])
def test_another_law_and_patches_of_another_mesh_are_refused(law, n, said):
    with pytest.raises(ValueError, match=said):
        Tetrahedra(block((1, 1, 1), (0.1, 0.1, 0.1)), law, TissueConstants(3e3, 0.4), np.zeros(n, dtype=int))


@pytest.mark.parametrize("wrong", [{"modulus": 0.0}, {"poisson": 0.5}, {"damping": -0.1}, {"modulus": np.nan}])
def test_constants_that_no_tissue_has_are_refused(wrong):
    mesh = block((1, 1, 1), (0.1, 0.1, 0.1))
    with pytest.raises(ValueError, match="constants: expected"):
        Tetrahedra(mesh, "linear", TissueConstants(3e3, 0.4)._replace(**wrong))
