"""Methods on lungs whose displacement is a known function."""

import numpy as np
import pytest

from experiments.studies.dense_lungs import methods
from experiments.studies.dense_lungs.data import read_person
from experiments.studies.dense_lungs.methods import METHODS, Body, DenseConstants, Task, by_field, by_filter
from tests.experiments.studies.dense_lungs.displaced import exhaled, landmarks, write_case


def task(folder, moved=exhaled, n=20, n_landmarks=150):
    before = landmarks(1, n_landmarks)
    write_case(folder / "case1.csv", before, moved(before))
    lung = read_person(folder / "case1.csv")[0]
    return Task(lung, lung.marks(n, "all"), DenseConstants())


def errors(given, found):
    return 1e3 * np.linalg.norm(found.means - given.lung.exhaled[given.lung.hidden], axis=1)


def affine(points):
    return points @ np.diag([1.0, 0.99, 0.95]) + [2.0, 0.0, -5.0]


@pytest.mark.parametrize("method", ["thin_plate", "linear", "field"])
def test_interpolations_follow_an_affine_motion(tmp_path, method):
    """Splines exactly but for the rounding of the file; the field to a fraction of the scatter that it assumes."""
    given = task(tmp_path, affine)
    assert errors(given, METHODS[method](given)).max() < (0.1 if method == "field" else 2e-3)


def test_hidden_landmarks_lie_between_their_nodes(tmp_path):
    given = task(tmp_path)
    body = Body.of(given)
    assert body.network.positions[:20] == pytest.approx(given.before)
    assert body.rows() @ body.network.positions == pytest.approx(given.wanted)
    assert body.weights.min() >= -1e-9
    point = body.point(3)
    nodes = [body.network.positions[body.network.index(name)] for name in point.nodes]
    assert point.weights @ np.array(nodes) == pytest.approx(given.wanted[3])


def test_the_field_is_the_conditional_normal_distribution(tmp_path, monkeypatch):
    """At the only level of 1 mm, by the joint covariance of marks and hidden landmarks; the trend by its functions."""
    monkeypatch.setattr(methods, "LEVELS_M", np.array([1e-3]))
    given = task(tmp_path)
    points = np.vstack([given.before, given.wanted])
    r = np.sqrt(3.0) * np.linalg.norm(points[:, None] - points, axis=2) / 0.06
    functions = np.column_stack([np.ones(len(points)), (points - given.before.mean(axis=0)) / 0.1])
    joint = functions @ functions.T + 1e-6 * (1.0 + r) * np.exp(-r)
    n = len(given.before)
    gain = np.linalg.solve(joint[:n, :n] + given.constants.scatter_m**2 * np.eye(n), joint[:n, n:]).T
    found = by_field(given)
    assert found.means == pytest.approx(given.wanted + gain @ (given.after - given.before), abs=1e-9)
    variances = (joint[n:, n:] - gain @ joint[:n, n:]).diagonal()
    assert found.covs[:, 1, 1] == pytest.approx(variances, rel=1e-6)


def test_the_filter_follows_a_displacement_that_it_does_not_know(tmp_path):
    """Hidden landmarks move by more than 2 mm in the mean; the estimate is within half the scatter of an axis."""
    given = task(tmp_path, n_landmarks=100)
    found = by_filter(given)
    truth = given.lung.exhaled[given.lung.hidden]
    assert 1e3 * np.linalg.norm(given.wanted - truth, axis=1).mean() > 2.0
    assert errors(given, found).mean() < 0.3
    assert found.covs is not None
    off = found.means - truth
    nees = np.einsum("ij,ij->i", off, np.linalg.solve(found.covs, off[..., None])[..., 0])
    assert (nees <= 7.81).mean() >= 0.9
