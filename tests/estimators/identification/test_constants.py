"""Constants from a calibration recording: found to their standard errors, and what is not determined is reported."""

from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
import pytest

from dynamics import independent_uncertainty, pack, parameters, rest_shape, scale_parameters
from estimators import (
    Budget,
    FilterSettings,
    ForceMode,
    IdentificationError,
    MarkMeasurement,
    TissueFilter,
    identify_constants,
    principal_uncertainty,
)
from estimators.identification.constants import IdentificationSettings, _searched
from estimators.identification.filter_pass import pass_through
from estimators.identification.groups import ConstantGroup
from estimators.identification.search import followed as followed_from
from tests.estimators.conftest import driven, followed
from tests.estimators.identification.passes import pass_of
from tests.networks import build_network

SD = 5e-4
PRIOR = {"stiffness": 0.3, "rest_length": 0.03}
ONE_START = IdentificationSettings(n_starts=1)
SETTINGS = FilterSettings(poked=ForceMode(0.1, 2.0, 0.2))


def chain(double=False):
    """Two masses in a row between two anchors, hung aslant; `double`: two equal springs side by side in the middle."""
    springs, stiffness = [(0, 1), (1, 2), (2, 3)], [60.0, 60.0, 60.0]
    if double:
        springs, stiffness = [*springs, (1, 2)], [60.0, 30.0, 60.0, 30.0]
    positions = [[0.0, 0.0], [0.1, -0.02], [0.2, -0.03], [0.3, 0.0]]
    constants = {"drag": [0.0, 0.3, 0.3, 0.0], "rest_lengths": 0.09, "damping": 0.3, "gravity": [0.0, -9.81]}
    names = ("A", "near", "far", "B")
    network = build_network(positions, springs, (0, 3), names, stiffness=stiffness, **constants)
    return replace(network, positions=rest_shape(network))


def identified(network, frames, prior_sd=PRIOR):
    return identify_constants(network, frames, ("near",), "far", prior_sd=prior_sd, settings=SETTINGS, search=ONE_START)


@pytest.fixture(scope="module")
def recorded():
    """Frames of 3 s at 20 frames/s of the chain, the near mass pushed now and then, both seen; truth by DOP853."""
    network, rng = chain(), np.random.default_rng(0)
    forces = 0.2 * 0.1 * np.sqrt(120.0) * rng.normal(size=(3 * 120, 2, 2))
    for start in (1.0, 2.1):
        now = slice(int(120 * start), int(120 * (start + 0.25)))
        forces[now, 0] += 0.5 * np.sin(np.linspace(0.0, np.pi, 30))[:, None] * rng.choice([-1.0, 1.0], 2)
    start = pack(network.positions[1:3], np.zeros((2, 2)))
    states = driven(network, start, forces)[::6]
    cov = SD**2 * np.eye(2)
    frames = []
    for k, state in enumerate(states):
        places = state[:4].reshape(2, 2) + rng.normal(0.0, SD, (2, 2))
        frames.append((k / 20.0, [MarkMeasurement(n, p, cov) for n, p in zip(("near", "far"), places, strict=True)]))
    return frames, states[:, 2:4]


def wrong(network, seed=3):
    """The chain with stiffness off by 20 % and rest lengths by 2 %, and by how much, in logarithms."""
    which = parameters(network, tuple(PRIOR))
    sd = np.array([0.2 if one.kind == "stiffness" else 0.02 for one in which])
    change = sd * np.random.default_rng(seed).normal(size=len(which))
    return scale_parameters(network, which, change), change


@pytest.fixture(scope="module")
def found(recorded):
    """From every other frame."""
    reported, change = wrong(chain())
    return identified(reported, recorded[0][::2]), change


def test_constants_are_found_to_their_standard_errors(found):
    """Chi-square of the error, six constants, below its 99.9 % point; most of the wrong is gone; damping stays."""
    result, change = found
    error = result.change + change
    assert error @ np.linalg.solve(result.cov, error) < 22.5
    assert result.converged
    assert 2 <= result.passes <= 12
    assert np.abs(error[:3]).max() < 0.1 < np.abs(change[:3]).max()
    assert result.sd[:3].max() < 0.2
    np.testing.assert_array_equal(result.network.damping, chain().damping)
    names = [(one.kind, one.index) for one in result.parameters]
    assert names == [("stiffness", 0), ("stiffness", 1), ("stiffness", 2)] + [("rest_length", s) for s in range(3)]


def test_the_hidden_mass_is_predicted_better_with_what_was_found(recorded, found):
    """The far mass's mark left out: mean error below half of what the wrong constants leave."""
    frames, truth = recorded[0][:60], recorded[1][:60]
    errors = []
    for network, uncertainty in ((wrong(chain())[0], None), (found[0].network, found[0].uncertainty)):
        tissue = TissueFilter(network, "far", ("near",), SETTINGS, uncertainty=uncertainty)
        means = [one.mean for one in followed(tissue, [(time_s, marks[:1]) for time_s, marks in frames])]
        errors.append(np.linalg.norm(np.array(means) - truth, axis=1)[20:].mean())
    assert errors[1] < 0.5 * errors[0]


def test_springs_side_by_side_are_determined_together_and_not_apart(recorded):
    """Two springs between the same nodes: their difference is the worst direction, nothing of its prior gone.

    Directions are by prior standard deviations, equal here: (1, -1) / sqrt 2 on the two stiffnesses.
    """
    both = identified(chain(double=True), recorded[0][:12], {"stiffness": 0.3})
    left, directions = both.identifiable()
    assert left[0] == pytest.approx(1.0, abs=1e-6)
    assert left[1] < 0.5
    expected = np.array([0.0, 1.0, 0.0, -1.0]) / np.sqrt(2.0)
    assert abs(directions[0] @ expected) == pytest.approx(1.0, abs=1e-4)
    sd = np.sqrt(np.diag(both.cov))
    assert sd[0] < 0.15 < sd[1]


def test_a_group_that_the_recording_does_not_determine_keeps_its_value(recorded):
    """Stiffness off by some 20 % is found; drag, known to a tenth before, is hardly better known after 3 s."""
    reported, change = wrong(chain())
    found = identified(reported, recorded[0][::2], {"stiffness": 0.3, "drag": 0.1})
    assert found.kept.tolist() == [False, False, False, True, True]
    np.testing.assert_array_equal(found.network.drag, reported.drag)
    assert (found.sd[3:] > 0.08).all()
    assert np.abs(found.change[:3]).max() > 0.1
    assert (np.abs(found.change[:3] + change[:3]) < 3.0 * found.sd[:3]).all()
    assert np.abs(found.change[1:3] + change[1:3]).max() < 0.06  # of the springs of the hidden mass


def test_the_directions_kept_carry_the_targets_variance(recorded, found):
    """What is left out of the covariance is nothing to the target: its columns' variance falls by 1 - kept at most."""
    frames, _ = recorded
    wide = independent_uncertainty(found[0].parameters, found[0].prior_sd)
    few = principal_uncertainty(found[0].network, wide, frames[:20], ("near",), "far", SETTINGS)
    assert len(few.directions) < len(wide.directions)
    lost = wide.cov - few.cov
    assert np.linalg.eigvalsh(lost)[0] > -1e-12
    variances = []
    for uncertainty in (wide, few):
        tissue = TissueFilter(found[0].network, "far", ("near",), SETTINGS, uncertainty=uncertainty)
        total = 0.0
        for time_s, marks in frames[:20]:
            tissue.predict(time_s)
            tissue.update(marks[:1])
            own = tissue.process.parts["constants"]
            columns = tissue.filter.moments_by(tissue.filter.weights)[1][:, own]
            total += float(((tissue.rows_of(tissue.target) @ columns) ** 2).sum())
        variances.append(total)
    assert variances[1] == pytest.approx(variances[0], rel=3.0 * (1.0 - IdentificationSettings().kept))


@dataclass
class PartMisleads:
    """One constant: 100 of 150 frames are likeliest at 3, all of them at 0.5, and near 3 far less so."""

    budget: Budget = field(default_factory=Budget)

    network, n_passes = chain(), 6
    groups, sd = (ConstantGroup("stiffness", (0,), "stiffness"),), np.ones(1)

    def planned(self, frames, n_starts):
        return n_starts, frames

    def at(self, theta, frames):
        peak, lost = (3.0, 0.0) if len(frames) <= 100 else (4.0, 1e5) if theta[0] > 2.0 else (0.5, 0.0)
        return pass_of(np.full(len(frames), peak - theta[0]), lost=lost)

    def followed(self, frames, start):
        return followed_from(partial(self.at, frames=frames), start, self.sd)


def test_constants_that_explain_a_part_alone_are_not_gone_on_from():
    """Maximum of the posterior of all frames, 150 * 0.5 / 151; the starts, at 3 by the part, do not agree with it."""
    frames = [(0.01 * k, [MarkMeasurement("far", np.zeros(2), np.eye(2))]) for k in range(150)]
    ended = _searched(PartMisleads(), frames, 2, map, lambda _share: None)
    assert ended.best.theta[0] == pytest.approx(75.0 / 151.0, rel=1e-6)
    assert ended.best.log_posterior > ended.before.log_likelihood
    assert ended.n_agreeing == 0
    assert len(ended.used) == 150


def test_a_target_that_is_never_seen_is_refused(recorded):
    frames = [(t, marks[:1]) for t, marks in recorded[0][:5]]
    with pytest.raises(IdentificationError, match="expected the mark of far in a frame, found it in none of 5 frames"):
        identify_constants(chain(), frames, ("near",), "far")


def test_what_is_found_is_most_probable_with_its_prior(recorded):
    """Few frames and a firm prior: the log posterior falls to both sides along the change found."""
    reported, _ = wrong(chain())
    frames = recorded[0][:40:2]
    found = identified(reported, frames, {"stiffness": 0.1, "rest_length": 0.003})

    def posterior(share):
        change = share * found.change
        network, none = scale_parameters(reported, found.parameters, change), independent_uncertainty((), 1.0)
        passed = pass_through(network, none, frames, (("near",), "far"), SETTINGS, Budget())
        return passed.log_likelihood - 0.5 * np.sum((change / found.prior_sd) ** 2)

    best = posterior(1.0)
    assert posterior(0.7) < best - 0.1
    assert posterior(1.3) < best - 0.1
