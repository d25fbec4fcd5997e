"""The table of lungs whose motion is known, and of the real ones where they are at hand."""

import numpy as np
import pytest
from scipy.stats import chi2

from experiments.studies.lungs import estimate
from experiments.studies.lungs.__main__ import main
from experiments.studies.lungs.estimate import SEEN, Inner, by_spline, errors_table, inner_landmarks
from experiments.studies.lungs.landmarks import read_lungs, read_person
from experiments.studies.lungs.model import LungConstants, edges_of, lung_network
from experiments.studies.lungs.table import markdown
from experiments.studies.zoo.scores import Followed
from tests.experiments.studies.lungs.breathing import landmarks, write_case
from tests.real_data import DATA

LUNGS = DATA / "lung"


def test_edges_of_a_bipyramid():
    """Two tetrahedra on one face: nine edges; the line between the two tips is none."""
    points = np.array([[1.0, 0, 0], [-0.5, 0.9, 0], [-0.5, -0.9, 0], [0, 0, 2], [0, 0, -2]])
    found = [tuple(edge) for edge in edges_of(points)]
    assert found == [(0, 1), (0, 2), (0, 3), (0, 4), (1, 2), (1, 3), (1, 4), (2, 3), (2, 4)]


def test_a_lung_rests_as_it_was_read_and_its_springs_are_strands_of_one_kind():
    points = 1e-3 * landmarks(3)[0, :20]
    constants = LungConstants()
    network = lung_network(points, constants)
    assert network.stiffness * network.rest_lengths == pytest.approx(np.full(len(network.springs), constants.strand_n))
    assert network.masses.sum() == pytest.approx(constants.mass_kg)
    assert not network.fixed.any()


def test_a_spline_follows_an_even_shrinking_exactly(tmp_path):
    """Heights shrink by 3 % each phase: nothing done misses that, the spline nothing but the rounding of the file."""
    write_case(tmp_path / "case1.csv", landmarks(1))
    lung = read_person(tmp_path / "case1.csv")[0]
    found = by_spline(lung, "ten")
    moved = np.abs(lung.positions[1:, lung.inner, 2] - lung.positions[0, lung.inner, 2])
    assert found.nothing == pytest.approx(moved)
    assert found.spline.max() < 1e-6


def test_the_table_has_means_of_the_last_phase_and_of_all():
    errors = np.array([[1e-3, 2e-3], [3e-3, 5e-3]])
    nees = np.array([[1.0, 9.0], [1.0, 1.0]])
    found = [Inner("case1 left", seen, np.array([4, 7]), 2 * errors, errors, errors, nees) for seen in SEEN]
    page = markdown(errors_table(found), found)
    assert page.splitlines()[2] == "| all of the hull | 8.00 | 4.00 | 4.00 | 100.0% | 2.75 | 2.75 | 75.0% |"


def test_what_the_filter_cannot_do_leaves_its_columns_empty_and_says_why():
    errors = np.ones((2, 2)) * 1e-3
    found = [Inner("case1 left", seen, np.array([4, 7]), errors, errors, failure="not possible yet") for seen in SEEN]
    page = markdown(errors_table(found), found)
    assert "| ten | 1.00 | 1.00 |  |  | 1.00 |  |  |" in page
    assert "- filter, 3 of 3 runs: not possible yet" in page


def test_the_study_prints_its_table(tmp_path, capsys, monkeypatch):
    """A filter that leaves every landmark where it was, 10 mm an axis."""

    def still(lung, *_):
        means = np.tile(lung.positions[0][lung.inner], (len(lung.positions), 1, 1))
        return Followed(means, np.tile(1e-4 * np.eye(3), (*means.shape[:2], 1, 1)))

    monkeypatch.setattr(estimate, "followed_lung", still)
    write_case(tmp_path / "case1.csv", landmarks(1, n=12, n_phases=2))
    assert main([str(tmp_path), "--processes", "1"]) == 0
    *_, six = capsys.readouterr().out.splitlines()
    _, seen, nothing, _, ours, covered, *_ = (entry.strip() for entry in six.split("|"))
    assert (seen, covered) == ("six", "100.0%")
    assert ours == nothing != "0.00"


real = pytest.mark.skipif(not LUNGS.is_dir(), reason="no landmarks of real lungs: set SOFTAIM_DATA to their folder")


@real
def test_the_spline_on_real_lungs():
    """The figures of docs/zoo.md: 1.51, 1.51 and 1.72 mm at the end of exhaling; nothing done, 5.19 mm."""
    lungs = read_lungs(LUNGS)
    spline = {}
    for seen in SEEN:
        found = [by_spline(lung, seen) for lung in lungs]
        spline[seen] = 1e3 * np.concatenate([one.spline[-1] for one in found]).mean()
    assert list(spline.values()) == pytest.approx([1.51, 1.51, 1.72], abs=0.005)
    assert 1e3 * np.concatenate([one.nothing[-1] for one in found]).mean() == pytest.approx(5.19, abs=0.005)


@real
def test_the_filter_on_real_lungs():
    """The left lung of a person, ten landmarks seen: as near as the spline within a twentieth, nine in ten covered."""
    (lung,) = (lung for lung in read_lungs(LUNGS) if lung.name == "case1 left")
    found = inner_landmarks(lung, "ten", LungConstants())
    assert found.filtered[-1].mean() < 1.05 * found.spline[-1].mean()
    assert (found.nees <= chi2.ppf(0.95, 3)).mean() >= 0.9
