"""The truths of soft bodies against finite elements at rest, and the study's figures."""

import json

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from dynamics.mesh import Tissue, lumped_masses, rest_stiffness
from experiments.studies.soft_bodies import __main__ as study
from experiments.studies.soft_bodies import bodies
from experiments.studies.soft_bodies.bodies import motion
from tests.dynamics.blocks import block

FAT = Tissue("fat", 3e3, 0.4, 950.0, 0.05)


def pushed(acceleration, times_s):
    """A block that is held at its lower face, all of it accelerated: where it is at these times [m], and the mesh."""
    mesh = block((3, 3, 3), (0.06, 0.05, 0.04))
    wall = np.flatnonzero(mesh.nodes[:, 2] < 1e-9)
    force = np.outer(lumped_masses(mesh, FAT.density_kg_m3), acceleration)
    return motion(mesh, [FAT], wall, times_s, lambda _t: force), mesh, wall, force


def test_a_small_lasting_force_ends_where_linear_elements_rest():
    places, mesh, wall, force = pushed([0.05, 0.0, 0.02], np.linspace(0.0, 2.0, 61))
    free = np.setdiff1d(np.arange(len(mesh.nodes)), wall)
    K = rest_stiffness(mesh, FAT.young_pa, FAT.poisson, free)
    rest = spsolve(K, force[free].ravel()).reshape(-1, 3)
    assert np.abs(rest).max() > 1e-5
    np.testing.assert_allclose((places[-1] - mesh.nodes)[free], rest, atol=0.01 * np.abs(rest).max())
    np.testing.assert_array_equal(places[:, wall], np.broadcast_to(mesh.nodes[wall], (61, len(wall), 3)))


def test_a_large_force_bends_it_less_than_linear_elements_say():
    """A tip that bends far comes down along an arc."""
    small, mesh, _, _ = pushed([0.05, 0.0, 0.0], np.linspace(0.0, 2.0, 61))
    large = pushed([20.0, 0.0, 0.0], np.linspace(0.0, 2.0, 61))[0]
    moved = [np.ptp((one[-1] - mesh.nodes)[:, 0]) for one in (small, large)]
    assert moved[1] > 0.01
    assert moved[1] < 0.98 * moved[0] * 20.0 / 0.05


def test_forces_without_a_solution_end_in_one_line():
    with pytest.raises(RuntimeError, match="expected a solution of a step"):
        pushed([0.0, 0.0, -1e5], np.linspace(0.0, 0.1, 4))


def test_the_target_of_a_soft_block_is_found_and_covered(monkeypatch):
    monkeypatch.setattr(bodies, "SECONDS", 4.0)
    found = study.run({"body": "block, 27 nodes", "seed": 20})
    assert found["moved_mm"] > 1.0
    assert found["filter_mm"] < 0.8 * found["thin_plate_mm"]
    assert found["covered"] > 0.85


def test_the_target_of_a_slab_with_marks_on_one_face_is_covered(monkeypatch):
    monkeypatch.setattr(bodies, "SECONDS", 2.0)
    recording = bodies.slab(6, 20)
    drawn = recording.positions[0]
    assert (drawn[:-1, 2] == bodies.SLAB_M[2]).all()
    assert drawn[-1, 2] < 0.6 * bodies.SLAB_M[2]
    found = study.run({"body": "slab, 6 marks", "seed": 20})
    assert found["moved_mm"] > 1.0
    assert found["covered"] > 0.85


def test_each_seed_has_its_own_truth_and_stiffness(monkeypatch):
    monkeypatch.setattr(bodies, "SECONDS", 0.5)
    one, other = (bodies.soft_block(3, seed) for seed in (1, 2))
    assert (one.network.continuum.rates != other.network.continuum.rates).all()
    assert not np.allclose(one.positions[-1], other.positions[-1])


def test_a_breast_is_moved_by_millimetres_at_thirty_frames_a_second(monkeypatch):
    monkeypatch.setattr(bodies, "SECONDS", 0.4)
    found = bodies.breast(1)
    np.testing.assert_allclose(np.diff(found.times_s), 1.0 / 30.0)
    assert 1e-3 < np.linalg.norm(found.positions - found.positions[0], axis=2).max() < 0.03


def test_the_study_writes_means_over_recordings(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(study, "run", stand_in)
    study.main(["--out", str(tmp_path), "--seeds", "2", "--bodies", "breast", "--processes", "1"])
    row = json.loads((tmp_path / "summary.json").read_text())["rows"]
    assert [(one["body"], one["n"], one["filter_mm"]) for one in row] == [("breast", 2, 20.5)]
    assert "| breast | 20.50 |" in capsys.readouterr().out == (tmp_path / "table.md").read_text()


def stand_in(case):
    """A run without a body: its seed as every figure."""
    return dict.fromkeys((*study.FIGURES, "ms"), float(case["seed"]))
