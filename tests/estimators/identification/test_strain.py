"""The level of the discrepancy from the marks of a recording; truths by SciPy's integrator."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER, four_mass_phantom
from estimators import Budget, FilterSettings, IdentificationError, MarkMeasurement, TissueFilter, tune_strain
from tests.estimators.core.test_track import breath, seen, truth_of

SETTINGS = FilterSettings()


@pytest.fixture(scope="module")
def frames():
    """A second of a breath, marks to 1 mm."""
    return seen(truth_of(breath, 1.0), 1e-3)


def found(frames, network=None, **more):
    return tune_strain(network or four_mass_phantom(), frames, OUTER, HIDDEN, settings=SETTINGS, **more)


def test_a_model_that_is_exact_has_the_smallest_level_where_its_constants_were_found(frames):
    done = []
    result = found(frames, is_identified=True, advance=done.append)
    assert result.settings == replace(SETTINGS, discrepancy=0.002)
    assert result.names == ("strain",)
    assert result.values.tolist() == [0.002]
    assert result.log_likelihood > result.log_likelihood_before
    assert result.strains.tolist() == [0.002, 0.003, 0.01, 0.03]
    assert result.log_likelihoods[0] == result.log_likelihood > result.log_likelihoods.max() - 3.0
    assert (result.log_likelihoods[1:] < result.log_likelihoods.max() - 3.0).all()
    assert result.n_frames == len(frames)
    assert result.in_time
    assert done[: len(frames)] == pytest.approx(np.arange(1, len(frames) + 1) / (5 * len(frames)))
    assert done == sorted(done)
    assert done[-1] == pytest.approx(1.0)


def test_progress_counts_passes_of_other_processes_when_they_return(frames):
    """A budget that is sent to another process no longer counts here."""
    done = []

    def elsewhere(function, items):
        return map(pickle.loads(pickle.dumps(function)), items)

    found(frames[:8], is_identified=True, advance=done.append, workers=elsewhere)
    assert done == pytest.approx(np.arange(1, 6) / 5)


def test_of_guessed_constants_marks_do_not_show_how_well_the_target_follows(frames):
    assert found(frames).settings.discrepancy == 0.003


def test_a_wrong_model_has_a_larger_level(frames):
    """M3 drawn a tenth of the extent from where it is, and resting there."""
    network = four_mass_phantom()
    positions = network.positions.copy()
    positions[network.index("M3")] += [0.03, -0.03]
    lengths = np.linalg.norm(positions[network.springs[:, 0]] - positions[network.springs[:, 1]], axis=1)
    wrong = replace(network, positions=positions, rest_lengths=lengths)
    assert found(frames[:15], wrong, is_identified=True).settings.discrepancy >= 0.01


def test_a_mark_of_the_target_is_not_used(frames):
    """It is for scoring only: here it is where the target never was."""
    wrong = MarkMeasurement(HIDDEN, np.array([0.5, 0.5]), 1e-6 * np.eye(2))
    shown = [(time_s, [*marks, wrong]) for time_s, marks in frames[:8]]
    assert found(shown).log_likelihood == found(frames[:8]).log_likelihood


def test_too_little_time_is_said(frames):
    with pytest.raises(IdentificationError, match="expected more time, found 0 s"):
        found(frames, budget=Budget(1e-9))


def test_the_level_found_is_that_of_the_filter():
    tissue = TissueFilter(four_mass_phantom(), HIDDEN, OUTER, replace(SETTINGS, discrepancy=0.002))
    assert tissue.level.level == pytest.approx(0.002)
    assert len(TissueFilter(four_mass_phantom(), HIDDEN, OUTER, SETTINGS).level.levels) > 1
