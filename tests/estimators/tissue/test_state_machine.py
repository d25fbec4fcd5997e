"""Any calls in any order: the state stays valid, and a call that raises changes nothing.

`test_surface.py` and `marks/test_checked_input.py` have what cannot be taken in.
"""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import Bundle, RuleBasedStateMachine, initialize, invariant, rule

from dynamics import HIDDEN, OUTER, four_mass_phantom, independent_uncertainty, parameters
from estimators import FilterSettings, FixBias, MarkMeasurement, TissueFilter
from tests.estimators.states import digest

PHANTOM = four_mass_phantom()
AT = dict(zip(PHANTOM.names, PHANTOM.positions, strict=True))
SDS = st.sampled_from([1e-6, 1e-4, 1e-3, 4e-3, 0.1, 10.0])
GAPS_S = st.sampled_from([0.0, 1e-9, 1 / 120, 1 / 30, 1 / 30, 0.1, 0.35, 1.09, 60.0, 86_400.0, 1e9])
OFFSETS_M = st.sampled_from([0.0, 0.0, 1e-3, 0.03, 0.15, 1.0, 1e6])
ANGLES = st.floats(0.0, 6.28)
FINE = np.eye(2)


@st.composite
def marks(draw, nodes=OUTER):
    """A mark of one of these nodes, at its place at rest or off by up to 1,000 km."""
    node, sd, off, angle = draw(st.sampled_from(nodes)), draw(SDS), draw(OFFSETS_M), draw(ANGLES)
    shared = draw(st.sampled_from([None, 1e-3 * np.array([[1.0, 0.0], [0.5, 1.0]])]))
    position = AT[node] + off * np.array([np.cos(angle), np.sin(angle)])
    return MarkMeasurement(node, position, sd**2 * np.array([[1.0, 0.3], [0.3, 0.5]]), shared)


class Calls(RuleBasedStateMachine):
    """A filter of the phantom under any calls; short memory, so that long gaps are met often and cost little."""

    states = Bundle("states")

    @initialize(considered=st.booleans(), sigma_points=st.booleans())
    def start(self, considered: bool, sigma_points: bool) -> None:
        """With a bias of fixes, perhaps an uncertain calibration and constants, perhaps by sigma points."""
        usual = FilterSettings(fix_bias=FixBias(1e-3), forget_s=0.3, lost_s=0.2, sigma_points=sigma_points)
        constants = independent_uncertainty(parameters(PHANTOM, ("stiffness",))[:2], 0.1) if considered else None
        self.tissue = TissueFilter(
            PHANTOM, HIDDEN, OUTER, usual, uncertainty=constants, n_calibration=2 if considered else 0
        )

    def refuses(self, call: Callable[[], object]) -> None:
        """The call raises ValueError, and all is as before."""
        before = digest(self.tissue.snapshot())
        with pytest.raises(ValueError, match=r"expected"):
            call()
        assert digest(self.tissue.snapshot()) == before

    @rule(gap_s=GAPS_S)
    def predict(self, gap_s: float) -> None:
        self.tissue.predict((self.tissue.time_s or 0.0) + gap_s)

    @rule(seen=st.lists(marks(), max_size=4, unique_by=lambda mark: mark.node))
    def update(self, seen: list[MarkMeasurement]) -> None:
        if self.tissue.time_s is None:
            self.refuses(lambda: self.tissue.update(seen))
            return
        estimate = self.tissue.update(seen)
        assert estimate.marks_used <= len(seen)
        check_gaussian(estimate.mean, estimate.cov)

    @rule(off=OFFSETS_M, angle=ANGLES, sd=SDS)
    def fix(self, off: float, angle: float, sd: float) -> None:
        place = AT[HIDDEN] + off * np.array([np.cos(angle), np.sin(angle)])
        if self.tissue.time_s is None:
            self.refuses(lambda: self.tissue.fix(place, sd**2 * FINE))
            return
        estimate = self.tissue.fix(place, sd**2 * FINE)
        check_gaussian(estimate.mean, estimate.cov)

    @rule(target=states)
    def snapshot(self) -> object:
        now = self.tissue.snapshot()
        return now, digest(now)

    @rule(state=states)
    def restore(self, state: tuple) -> None:
        then, bits = state
        self.tissue.restore(then)
        assert digest(self.tissue.snapshot()) == digest(then) == bits

    @rule(gap_s=GAPS_S)
    def look_ahead(self, gap_s: float) -> None:
        """Predictions of the target leave the state."""
        if self.tissue.time_s is None:
            self.refuses(lambda: self.tissue.predict_at(1.0))
            return
        before = digest(self.tissue.snapshot())
        ahead = self.tissue.predict_at(self.tissue.time_s + gap_s)
        check_gaussian(ahead.mean, ahead.cov)
        assert digest(self.tissue.snapshot()) == before

    @invariant()
    def the_state_is_a_gaussian(self) -> None:
        """The mixture and each of its modes: finite, symmetric, positive definite where marks are looked for."""
        own = self.tissue.filter
        assert own.weights.min() >= 0.0
        assert own.weights.sum() == pytest.approx(1.0, abs=1e-9)
        assert self.tissue.is_finite
        np.testing.assert_allclose(own.covs, own.covs.swapaxes(1, 2), rtol=0, atol=1e-9 * np.abs(own.covs).max())
        for node in (*OUTER, HIDDEN):
            check_gaussian(*self.tissue.expected(node))
            rows = self.tissue.process.node(node)
            for mean, cov in zip(own.means @ rows.T, rows @ own.covs @ rows.T, strict=True):
                check_gaussian(mean, cov)


def check_gaussian(mean: np.ndarray, cov: np.ndarray) -> None:
    """Finite, symmetric, and with positive eigenvalues; of the correlations, so that units do not matter."""
    assert np.isfinite(mean).all()
    assert np.isfinite(cov).all()
    np.testing.assert_allclose(cov, cov.T, rtol=0, atol=1e-9 * np.abs(cov).max())
    assert np.diag(cov).min() > 0.0
    root = np.sqrt(np.diag(cov))
    assert np.linalg.eigvalsh(cov / np.outer(root, root))[0] > 0.0


Calls.TestCase.settings = settings(
    max_examples=8, stateful_step_count=20, deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
TestCalls = Calls.TestCase
