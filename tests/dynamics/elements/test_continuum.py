"""A mesh as a continuum of named points, against the whole finite-element model by SciPy."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.sparse import csc_array, diags_array
from scipy.sparse.linalg import eigsh, spsolve
from scipy.spatial.transform import Rotation
from scipy.special import gamma, kv

from dynamics import Stepper, parameter_forces, parameters, reaches, rest_shape, scale_parameters, state_matrix
from dynamics.elements import continuum, continuum_network, matern
from dynamics.mesh import MeshError, TetMesh, Tissue, lumped_masses, rest_stiffness, surface
from dynamics.network import NetworkError
from tests.dynamics.blocks import block

FAT, GLAND = Tissue("fat", 3e3, 0.4, 950.0, 0.05), Tissue("gland", 9e3, 0.4, 1050.0, 0.05)
POINTS = {
    "M1": np.array([0.06, 0.01, 0.02]),
    "M2": np.array([0.06, 0.035, 0.03]),
    "M3": np.array([0.031, 0.04, 0.02]),
    "target": np.array([0.033, 0.021, 0.019]),
}


@pytest.fixture(scope="module")
def mesh() -> TetMesh:
    whole = block((9, 6, 6), (0.06, 0.04, 0.04))
    middles = whole.nodes[whole.elements].mean(axis=1)
    return TetMesh(whole.nodes, whole.elements, (middles[:, 0] > 0.03).astype(int))


@pytest.fixture(scope="module")
def fixed(mesh: TetMesh) -> np.ndarray:
    return np.flatnonzero(mesh.nodes[:, 0] < 1e-9)


@pytest.fixture(scope="module")
def network(mesh, fixed):
    return continuum_network(mesh, (FAT, GLAND), fixed, POINTS)


@pytest.fixture(scope="module")
def whole(mesh, fixed):
    """Free nodes, stiffness and masses of all coordinates, and the points' weights."""
    free = np.setdiff1d(np.arange(len(mesh.nodes)), fixed)
    young = np.array([FAT.young_pa, GLAND.young_pa])[mesh.regions]
    density = np.array([FAT.density_kg_m3, GLAND.density_kg_m3])[mesh.regions]
    weights = continuum.points_of(mesh, surface(mesh), np.array(list(POINTS.values()))).weights
    rows = np.kron(weights.toarray()[:, free], np.eye(3))
    return free, rest_stiffness(mesh, young, 0.4, free), np.repeat(lumped_masses(mesh, density)[free], 3), rows


def test_matern_is_the_correlation_of_its_class() -> None:
    """By the Bessel function of its definition, nu = 3/2."""
    r, nu, length = np.array([0.05, 0.3, 1.0, 2.5]), 1.5, 0.4
    scaled = np.sqrt(2.0 * nu) * r / length
    np.testing.assert_allclose(
        matern(r, length), 2.0 ** (1.0 - nu) / gamma(nu) * scaled**nu * kv(nu, scaled), rtol=1e-12
    )


def test_points_are_where_they_were_put(network):
    np.testing.assert_allclose(network.positions[network.free], list(POINTS.values()), atol=1e-9)
    assert network.names[4:] == tuple(f"wall {k}" for k in range(1, 13))
    assert reaches(network)[3] == pytest.approx(0.033, abs=1e-3)
    np.testing.assert_array_equal(rest_shape(network), network.positions)


def test_a_mark_just_outside_the_mesh_stays_there_and_moves_as_the_surface_does(mesh, fixed, network):
    outside = POINTS | {"M2": POINTS["M2"] + [1e-3, 0.0, 0.0]}
    for driven in (False, True):
        other = continuum_network(mesh, (FAT, GLAND), fixed, outside, driven=driven)
        np.testing.assert_array_equal(other.positions[other.free], list(outside.values()))
    other = continuum_network(mesh, (FAT, GLAND), fixed, outside)
    moved, expected = (one.continuum.shapes @ one.continuum.forces for one in (other, network))
    np.testing.assert_allclose(moved, expected, atol=1e-9 * np.abs(expected).max())


def test_a_force_about_a_point_moves_all_points_as_in_the_whole_model(mesh, network, whole):
    free, K, _, _ = whole
    outside = surface(mesh)
    named = continuum.points_of(mesh, outside, np.array(list(POINTS.values())))
    weights = continuum.patch_weights(mesh, outside, named).toarray()
    np.testing.assert_allclose(weights.sum(axis=1), 1.0)
    np.testing.assert_allclose(weights @ mesh.nodes, list(POINTS.values()), atol=2e-3)
    rows = np.kron(weights[:, free], np.eye(3))
    force = np.zeros((4, 3))
    force[1] = [0.0, -0.02, 0.01]
    exact = rows @ spsolve(K, rows.T @ force.ravel())
    found = (rest_shape(network, force) - network.positions)[network.free].ravel()
    np.testing.assert_allclose(found, exact, rtol=1e-3, atol=1e-3 * np.abs(exact).max())


def test_the_slowest_modes_are_those_of_the_whole_model(network, whole):
    _, K, masses, _ = whole
    exact = eigsh(csc_array(K), k=5, M=csc_array(diags_array(masses)), sigma=0.0, return_eigenvectors=False)
    np.testing.assert_allclose(network.continuum.rates[:4], np.sort(exact)[:4], rtol=0.03)
    total = network.continuum.by_tissue.sum(axis=0)
    np.testing.assert_allclose(total, np.diag(network.continuum.rates), atol=1e-6 * total.max())


def test_a_smooth_pressure_moves_the_target_as_in_the_whole_model(mesh, network, whole):
    """One that is no sum of the fields by which the modes were chosen: a bump on the far end."""
    free, K, masses, rows = whole
    outside, solid = surface(mesh), network.continuum
    far = mesh.nodes[outside.nodes]
    bump = np.exp(-((far - POINTS["M1"]) ** 2).sum(axis=1) / 0.015**2) * outside.areas
    force = np.zeros((len(mesh.nodes), 3))
    force[outside.nodes] = 100.0 * bump[:, None] * [-1.0, 0.3, -0.5]
    exact = rows @ spsolve(K, force[free].ravel())
    moved = spsolve(K, force[free].ravel())
    modal = np.linalg.lstsq(solid.shapes, rows @ moved, rcond=None)[0]
    assert np.linalg.norm(solid.shapes @ modal - exact) < 0.1 * np.linalg.norm(exact)
    assert solid.mass == pytest.approx(masses.sum() / 3.0)


def test_a_change_of_gravity_moves_all_points_as_in_the_whole_model(mesh, fixed, whole):
    """Also with few modes, because the omitted modes respond statically."""
    _, K, masses, rows = whole
    exact = rows @ spsolve(K, masses[:, None] * np.tile(np.eye(3), (len(masses) // 3, 1)))
    few = continuum_network(mesh, (FAT, GLAND), fixed, POINTS, left_out=0.03).continuum
    np.testing.assert_allclose(few.accelerated, exact, atol=1e-3 * np.abs(exact).max())
    assert np.abs(few.omitted[:, :3]).max() > 1e-2 * np.abs(exact).max()


def test_a_tissue_may_be_made_stiffer(mesh, fixed, network):
    """As the continuum of the mesh with that tissue; in the shapes of before, so to three hundredths."""
    gland = parameters(network)[1]
    stiffer = Tissue("gland", 2.0 * GLAND.young_pa, 0.4, 1050.0, 0.05)
    exact = continuum_network(mesh, (FAT, stiffer), fixed, POINTS)
    found = scale_parameters(network, [gland], [np.log(2.0)])
    np.testing.assert_allclose(found.continuum.rates[:4], exact.continuum.rates[:4], rtol=0.06)
    force = np.zeros((4, 3))
    force[0] = [0.01, 0.02, 0.0]
    for moved in (lambda body: rest_shape(body, force)[3] - body.positions[3], lambda body: body.continuum.accelerated):
        one, other = moved(found), moved(exact)
        np.testing.assert_allclose(one, other, rtol=0.03, atol=0.03 * np.abs(other).max())
    alike = scale_parameters(network, parameters(network), np.log([2.0, 2.0])).continuum
    np.testing.assert_allclose(alike.omitted, 0.5 * network.continuum.omitted)


def test_forces_by_the_logarithm_of_a_stiffness_are_derivatives(network):
    """Of the force that keeps the points displaced, by central differences, in a displacement of the modes."""
    which = parameters(network)
    x = network.positions.copy()
    x[network.free] += (network.continuum.shapes @ (1e-3 / (1.0 + np.arange(len(network.continuum.rates))))).reshape(
        4, 3
    )
    found = parameter_forces(network, which, x, 0.0 * x)
    for k, one in enumerate(which):
        ends = [
            scale_parameters(network, [one], [change]).continuum.stiffness
            @ (x - network.positions)[network.free].ravel()
            for change in (1e-3, -1e-3)
        ]
        exact = -(ends[0] - ends[1]) / 2e-3
        assert np.linalg.norm(found[k] - exact) < 0.05 * np.linalg.norm(exact)


@pytest.mark.parametrize("driven", [(), (0,)])
def test_steps_follow_the_equations_of_motion(network, driven):
    """By the exponential of the state's matrix, whose driven rows are zero."""
    A = state_matrix(network, network.positions)
    half = network.n_state // 2
    state = np.r_[network.positions[network.free].ravel(), np.zeros(half)]
    state[:half] += 1e-3 * np.sin(np.arange(half))
    state[half : half + 3] = [0.01, 0.0, 0.02]
    rest = np.r_[network.positions[network.free].ravel(), np.zeros(half)]
    for node in driven:
        A[half + 3 * node : half + 3 * node + 3] = 0.0
    exact = rest + expm(A * 0.05) @ (state - rest)
    found = Stepper(network, 1e-4).advance(state[None], 0.05, driven=driven)[0]
    np.testing.assert_allclose(found[:half], exact[:half], atol=2e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"tissues": (FAT,)}, "regions: expected 0 to 0, found 0 to 1"),
        ({"fixed": "all"}, "fixed: expected free nodes beside those that are held, found none"),
        (
            {"points": {"far": np.array([0.1, 0.02, 0.02])}},
            r"points: expected each inside the mesh or near its surface, found \[100",
        ),
        ({"fixed": np.empty(0, dtype=int), "driven": True}, "driven: expected the nodes of a wall, found none"),
        ({"points": "wall"}, r"points: expected each where the mesh moves, found \["),
    ],
)
def test_what_cannot_be_is_an_error(mesh, fixed, change, message):
    given = {"tissues": (FAT, GLAND), "fixed": fixed, "points": POINTS} | change
    if isinstance(given["fixed"], str):
        given["fixed"] = np.arange(len(mesh.nodes))
    if isinstance(given["points"], str):
        given["points"] = POINTS | {"held": mesh.nodes[fixed[0]]}
    with pytest.raises(MeshError, match=message):
        continuum_network(mesh, **given)


def test_a_driven_wall_moves_the_body_as_a_whole_and_no_force_moves_it(mesh, fixed, network):
    """Truth: a turn of a hundredth about an axis, to its square; else the network with a fixed wall."""
    driven = continuum_network(mesh, (FAT, GLAND), fixed, POINTS, driven=True)
    solid, rest = driven.continuum, driven.positions[driven.free]
    turned = np.array([0.03, 0.01, 0.0]) + Rotation.from_rotvec([0.006, 0.0, -0.008]).apply(rest)
    found = np.linalg.lstsq(solid.shapes[:, :6], (turned - rest).ravel(), rcond=None)[0]
    np.testing.assert_allclose(solid.shapes[:, :6] @ found, (turned - rest).ravel(), atol=1e-5)
    np.testing.assert_array_equal(solid.shapes[:, 6:], network.continuum.shapes)
    np.testing.assert_allclose(solid.residual, network.continuum.residual, rtol=1e-9)
    assert not solid.forces[:6].any()
    scaled = scale_parameters(driven, parameters(driven)[1:], [np.log(2.0)]).continuum
    fixed_wall = scale_parameters(network, parameters(network)[1:], [np.log(2.0)]).continuum
    np.testing.assert_allclose(scaled.rates, np.r_[np.zeros(6), fixed_wall.rates], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(scaled.residual, fixed_wall.residual, rtol=1e-6, atol=1e-12)
    assert network.is_held
    assert not driven.is_held


def test_a_network_has_either_springs_or_a_continuum(network):
    with pytest.raises(NetworkError, match="continuum: expected no springs beside it, found 1"):
        replace(network, springs=np.array([[0, 1]]), stiffness=np.ones(1), rest_lengths=np.ones(1), damping=np.zeros(1))


def test_it_is_pickled_whole(network):
    again = pickle.loads(pickle.dumps(network))
    np.testing.assert_array_equal(again.continuum.shapes, network.continuum.shapes)
    assert not again.continuum.shapes.flags.writeable


def test_a_force_on_a_mark_is_spread_over_the_surface_alone(mesh):
    """Also where its place was rounded; one on a point inside is spread over the volume."""
    outside = surface(mesh)
    places = np.array([POINTS["M1"] - [1e-7, 0.0, 0.0], POINTS["target"]])
    weights = continuum.patch_weights(mesh, outside, continuum.points_of(mesh, outside, places)).toarray()
    inside = np.setdiff1d(np.arange(len(mesh.nodes)), outside.nodes)
    assert weights[0, inside].sum() == 0.0
    assert weights[1, inside].sum() > 0.5
