"""One thread for linear algebra while a filter is at work or a mesh is reduced, as many as before afterwards."""

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER
from dynamics.elements import continuum_network
from dynamics.mesh import MeshCholesky, Tissue
from dynamics.threads import _libraries, one_blas_thread
from estimators import MarkMeasurement, TissueFilter
from tests.dynamics.blocks import block


class Counted:
    """A library's number of threads, in place of OpenBLAS."""

    def __init__(self, n: int) -> None:
        self.n = n

    def put(self, n: int) -> None:
        self.n = n

    def get(self) -> int:
        return self.n


@pytest.fixture
def counted(monkeypatch):
    libraries = Counted(4), Counted(1)
    monkeypatch.setattr("dynamics.threads._libraries", lambda: tuple((one.put, one.get) for one in libraries))
    return libraries


def test_threads_are_one_inside_and_as_before_outside(counted):
    with one_blas_thread():
        with one_blas_thread():
            assert [one.n for one in counted] == [1, 1]
        assert [one.n for one in counted] == [1, 1]
    assert [one.n for one in counted] == [4, 1]
    with pytest.raises(KeyError), one_blas_thread():
        raise KeyError
    assert [one.n for one in counted] == [4, 1]


def test_a_filter_works_in_one_thread(counted, phantom, monkeypatch):
    tissue, seen = TissueFilter(phantom, HIDDEN, OUTER), []
    tissue.predict(0.0)
    tissue.update([MarkMeasurement(n, phantom.positions[phantom.index(n)], 1e-6 * np.eye(2)) for n in OUTER])
    advance = tissue._advance
    monkeypatch.setattr(tissue, "_advance", lambda *given: seen.append(counted[0].n) or advance(*given))
    tissue.predict(0.1)
    tissue.predict_at(0.2)
    tissue.predict_path([0.2, 0.3])
    assert seen == [1, 1, 1, 1]
    assert counted[0].n == 4


def test_a_mesh_is_reduced_in_one_thread(counted, monkeypatch):
    seen, solve = [], MeshCholesky.solve
    monkeypatch.setattr(MeshCholesky, "solve", lambda *given: seen.append(counted[0].n) or solve(*given))
    mesh = block((1, 1, 1), (0.04, 0.04, 0.04))
    continuum_network(mesh, [Tissue("gel", 3e3, 0.3, 1e3, 0.01)], np.arange(4), {"M1": mesh.nodes[-1]})
    assert set(seen) == {1}
    assert counted[0].n == 4


def test_the_libraries_that_numpy_and_scipy_brought_are_asked():
    """Each says the number that it was given."""
    for put, get in _libraries():
        before = get()
        put(1)
        assert get() == 1
        put(before)
        assert get() == before
