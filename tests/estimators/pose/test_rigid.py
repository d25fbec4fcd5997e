"""Rigid motions against SciPy's rotations and differences."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from estimators import RigidMotion

N_CHANGES = {2: 3, 3: 6}


def motion(dim: int, rng: np.random.Generator) -> RigidMotion:
    return RigidMotion.none(rng.normal(size=dim)).changed(rng.normal(size=N_CHANGES[dim]))


@pytest.mark.parametrize("dim", [2, 3])
def test_a_change_turns_as_scipy_does_and_is_found_again(dim):
    rng = np.random.default_rng(dim)
    change = rng.normal(size=N_CHANGES[dim])
    about = np.array([0.0, 0.0, change[-1]]) if dim == 2 else change[3:]
    made = RigidMotion.none(np.ones(dim)).changed(change)
    np.testing.assert_allclose(made.rotation, Rotation.from_rotvec(about).as_matrix()[:dim, :dim], atol=1e-14)
    first = motion(dim, rng)
    np.testing.assert_allclose(first.change_to(first.changed(change)), change, atol=1e-12)


@pytest.mark.parametrize("dim", [2, 3])
def test_points_are_moved_and_moved_back(dim):
    rng = np.random.default_rng(10 + dim)
    one, points = motion(dim, rng), rng.normal(size=(4, dim))
    direct = [one.rotation @ (x - one.centre) + one.centre + one.translation for x in points]
    np.testing.assert_allclose(one.moved(points), direct, atol=1e-14)
    np.testing.assert_allclose(one.back(one.moved(points)), points, atol=1e-14)


@pytest.mark.parametrize("dim", [2, 3])
def test_the_shift_by_a_small_change_is_its_difference_quotient(dim):
    rng, step = np.random.default_rng(20 + dim), 1e-6
    one, points = motion(dim, rng), rng.normal(size=(3, dim))
    moved = one.moved(points)
    for k, change in enumerate(step * np.eye(N_CHANGES[dim])):
        quotient = (one.changed(change).moved(points) - one.changed(-change).moved(points)) / (2.0 * step)
        np.testing.assert_allclose(one.change_of(moved)[:, :, k], quotient, atol=1e-9)
