"""Bodies of given nodes: as stiff as the continuum that they stand for, as heavy as water, at rest where drawn."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from dynamics import NetworkError, elastic_body, elastic_stiffness, on_hull, potential_energy, rest_shape, to_outside
from dynamics.phantoms.lattice import delaunay_springs

YOUNG = 20e3


def grid(dim: int, per_side: int = 3, spacing: float = 0.02):
    """Nodes of a square or a cube, shaken a little so that the triangulation is one; the lowest row is fixed."""
    x = spacing * np.array(list(product(range(per_side), repeat=dim)), dtype=float)
    inside = ((x > 0.5 * spacing) & (x < (per_side - 1.5) * spacing)).all(axis=1)
    x[inside] += 0.1 * spacing * np.random.default_rng(dim).normal(size=(int(inside.sum()), dim))
    return x, x[:, 1] < 0.5 * spacing


def named(x):
    return [f"n{i}" for i in range(len(x))]


@pytest.mark.parametrize(("dim", "poisson"), [(2, 1 / 3), (3, 1 / 4)])
def test_swollen_it_holds_the_energy_of_an_elastic_body(dim: int, poisson: float) -> None:
    """U = 3/2 E / (1 - 2 v) e² V of a body, E t / (1 - v) e² A of a sheet (plane stress), all lengths grown by e."""
    x, fixed = grid(dim)
    body = elastic_body(named(x), x, fixed, YOUNG)
    body = replace(body, gravity=np.zeros(dim), rest_lengths=lengths(body))
    e, side = 0.01, 0.04
    if dim == 3:
        expected = 1.5 * YOUNG / (1.0 - 2.0 * poisson) * e**2 * side**3
    else:
        expected = YOUNG * 0.010 / (1.0 - poisson) * e**2 * side**2
    found = potential_energy(body, (1.0 + e) * x)
    # springs between two anchors are left out of the network, and so is their share
    everything = delaunay_springs(x, np.zeros(len(x), dtype=bool))
    share = (lengths(body) ** 2).sum() / (spans(x, everything) ** 2).sum()
    stiffness = elastic_stiffness(x, everything, YOUNG * (1.0 if dim == 3 else 0.010))
    assert found * stiffness / body.stiffness[0] == pytest.approx(expected * share, rel=1e-9)


def lengths(body):
    return spans(body.positions, body.springs)


def spans(x, pairs):
    return np.linalg.norm(x[pairs[:, 0]] - x[pairs[:, 1]], axis=1)


@pytest.mark.parametrize(("dim", "mass"), [(2, 1000.0 * 0.04**2 * 0.010), (3, 1000.0 * 0.04**3)])
def test_it_weighs_what_water_does_and_rests_where_it_is_drawn(dim: int, mass: float) -> None:
    x, fixed = grid(dim)
    body = elastic_body(named(x), x, fixed, YOUNG)
    assert body.masses[~fixed].sum() == pytest.approx(mass, rel=1e-9)
    np.testing.assert_allclose(rest_shape(body), x, atol=1e-9)
    assert body.gravity.tolist() == [0.0, -9.81, 0.0][:dim]


def test_without_anchors_it_floats_with_springs_at_ease() -> None:
    x, _ = grid(3)
    body = elastic_body(named(x), x, np.zeros(len(x), dtype=bool), YOUNG)
    assert not body.gravity.any()
    np.testing.assert_allclose(body.rest_lengths, lengths(body))


def test_springs_do_not_bridge_a_hollow_nor_join_anchors() -> None:
    """Two squares far apart."""
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=float)
    x = np.vstack([square, square + np.array([9.0, 0.0])])
    fixed = np.array([True, True, *[False] * 6])
    pairs = {tuple(pair) for pair in delaunay_springs(x, fixed).tolist()}
    assert (0, 1) not in pairs
    assert {(1, 2), (2, 3), (0, 3), (4, 5), (5, 6), (6, 7), (4, 7)} <= pairs
    assert not any(i < 4 <= j for i, j in pairs)


def test_a_body_too_soft_for_its_weight_and_nodes_in_a_line_are_refused() -> None:
    x, fixed = grid(3)
    with pytest.raises(NetworkError, match=r"expected to rest where it was seen"):
        elastic_body(named(x), x, fixed, 100.0)
    line = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 0.0]])
    with pytest.raises(NetworkError, match=r"nodes: expected 3 or more, not all in a line or plane"):
        delaunay_springs(line, np.zeros(4, dtype=bool))
    with pytest.raises(NetworkError, match=r"found a body without volume"):
        elastic_stiffness(line, np.array([[0, 1], [1, 2]]), YOUNG)
    with pytest.raises(NetworkError, match=r"found a body without volume"):
        on_hull(line)
    with pytest.raises(NetworkError, match=r"found a body without volume"):
        to_outside(line, line[1], np.array([0.0, 1.0]))


def test_the_way_out_of_a_square() -> None:
    """From (0.25, 0.5) of the unit square: 0.75 to the right, 0.5 up, sqrt(2) / 2 along the diagonal."""
    x = np.array(list(product((0.0, 1.0), repeat=2)))
    start = np.array([0.25, 0.5])
    assert to_outside(x, start, np.array([1.0, 0.0])) == pytest.approx(0.75)
    assert to_outside(x, start, np.array([0.0, 1.0])) == pytest.approx(0.5)
    assert to_outside(x, start, np.full(2, np.sqrt(0.5))) == pytest.approx(np.sqrt(0.5))


def test_corners_of_the_hull() -> None:
    x = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0], [0.4, 0.6]])
    assert on_hull(x).tolist() == [True, True, True, True, False]
