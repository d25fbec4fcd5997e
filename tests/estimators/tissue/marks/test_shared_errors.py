"""Errors that all marks of a frame share, a camera's calibration: correlated in the filter, as they are."""

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER, four_mass_phantom
from estimators import MarkMeasurement, UnifiedFilter
from estimators.tissue.update import stack_marks


def target_variance(shared: float, own: float) -> float:
    """Of a phantom at rest after ten frames whose marks are all off together and each by itself [m]."""
    network = four_mass_phantom()
    tissue = UnifiedFilter(network, HIDDEN, OUTER)
    for k in range(10):
        tissue.predict(k / 30.0)
        marks = [
            MarkMeasurement(
                node, network.positions[network.index(node)], own**2 * np.eye(2), shared * np.eye(2) if shared else None
            )
            for node in OUTER
        ]
        estimate = tissue.update(marks)
    assert estimate.cov is not None
    return float(np.trace(estimate.cov))


@pytest.mark.slow
def test_a_shift_that_all_marks_share_is_told_from_motion_by_the_anchors() -> None:
    together, apart = target_variance(4e-3, 1e-4), target_variance(0.0, np.hypot(4e-3, 1e-4))
    assert together < 0.5 * apart


def test_the_first_frame_takes_them_in_as_the_textbook_does() -> None:
    network = four_mass_phantom()
    tissue = UnifiedFilter(network, HIDDEN, OUTER)
    rng = np.random.default_rng(0)
    factors = {node: rng.normal(0.0, 2e-3, (2, 3)) for node in OUTER}
    places = {node: network.positions[network.index(node)] for node in OUTER}
    marks = [MarkMeasurement(node, places[node], 1e-6 * np.eye(2), factors[node]) for node in OUTER]
    coordinates = {node: network.coordinates(node) for node in OUTER}
    R = stack_marks(marks, coordinates, tissue.model).R
    F = np.vstack([factors[node] for node in OUTER])
    np.testing.assert_allclose(R, 1e-6 * np.eye(6) + F @ F.T, rtol=1e-12)
    np.testing.assert_allclose(marks[1].total_cov, R[2:4, 2:4], rtol=1e-12)


def test_another_dimension_is_refused() -> None:
    with pytest.raises(ValueError, match=r"mark M1 shared: expected 2 rows, found \(3, 1\)"):
        MarkMeasurement("M1", np.zeros(2), np.eye(2), np.zeros((3, 1)))
