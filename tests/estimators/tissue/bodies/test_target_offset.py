"""A target whose place in the tissue is not exact: the filter against the joint posterior, in closed form."""

from dataclasses import replace

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER, four_mass_phantom
from estimators import FilterSettings, FixBias, MarkMeasurement, TargetPoint, TissueFilter
from tests.estimators.conftest import followed

SD_M, BIAS_M, FIX_M = 6e-3, 1e-3, 0.5e-3
AT_S = 0.5
"""When the fix comes [s]."""


def made(sd_m: float, *, bias: FixBias | None = None, network=None) -> TissueFilter:
    settings = replace(FilterSettings(), fix_bias=bias)
    body = four_mass_phantom() if network is None else network
    return TissueFilter(body, TargetPoint((HIDDEN,), sd_m=sd_m), OUTER, settings)


def marks_at(tissue: TissueFilter, frame: int):
    """Marks that stand where they rest, each a little off, the same in every filter."""
    network, rng = tissue.network, np.random.default_rng(frame)
    return [
        MarkMeasurement(node, network.positions[network.index(node)] + 1e-3 * rng.normal(size=2), 1e-6 * np.eye(2))
        for node in OUTER
    ]


def tracked(tissue: TissueFilter, until_s: float = AT_S):
    frames = range(round(30 * until_s) + 1)
    return followed(tissue, [(frame / 30, marks_at(tissue, frame)) for frame in frames])[-1]


def test_a_fix_is_fused_as_the_joint_posterior_has_it():
    """Place o, tissue x and bias b: the fix sees x + o + b; of x + o the posterior by Bayes' rule for Gaussians."""
    before = tracked(made(0.0))
    tissue = made(SD_M, bias=FixBias(BIAS_M, lasting_s=1e9))
    tracked(tissue)
    seen = before.mean + np.array([5e-3, -3e-3])
    found = tissue.fix(seen, FIX_M**2 * np.eye(2))
    prior = before.cov + SD_M**2 * np.eye(2)
    gain = prior @ np.linalg.inv(prior + (BIAS_M**2 + FIX_M**2) * np.eye(2))
    np.testing.assert_allclose(found.mean, before.mean + gain @ (seen - before.mean), atol=2e-6)
    np.testing.assert_allclose(found.cov, prior - gain @ prior, rtol=1e-3, atol=1e-11)


def test_what_a_fix_showed_outlasts_a_gap_and_a_loss():
    """The body is forgotten in the gap, and found again by its marks; the lesion is where it was in it."""
    tissue = made(SD_M)
    tracked(tissue)
    rest = tissue.network.positions[tissue.network.index(HIDDEN)]
    tissue.fix(rest + np.array([5e-3, 0.0]), FIX_M**2 * np.eye(2))
    for frame in range(60):
        tissue.predict(30.0 + frame / 30)
        estimate = tissue.update(marks_at(tissue, frame))
    np.testing.assert_allclose(estimate.mean - rest, [5e-3, 0.0], atol=5e-4)
    assert np.sqrt(np.diag(estimate.cov)).max() < 1.5e-3


@pytest.mark.parametrize("sd_m", [-1e-3, np.nan, np.inf])
def test_a_place_known_to_no_number_is_refused(sd_m):
    with pytest.raises(ValueError, match="sd_m: expected 0 or more, finite"):
        TargetPoint((HIDDEN,), sd_m=sd_m)
