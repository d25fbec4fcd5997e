"""Errors that all marks of a frame share, a camera's calibration: correlated in the filter, as they are."""

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER, four_mass_phantom
from estimators import MarkMeasurement, TissueFilter


def target_variance(shared: float, own: float) -> float:
    """Of a phantom at rest after ten frames whose marks are all off together and each by itself [m]."""
    network = four_mass_phantom()
    tissue = TissueFilter(network, HIDDEN, OUTER)
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
    assert together < 0.8 * apart


def test_another_dimension_is_refused() -> None:
    with pytest.raises(ValueError, match=r"mark M1 shared: expected 2 rows, found \(3, 1\)"):
        MarkMeasurement("M1", np.zeros(2), np.eye(2), np.zeros((3, 1)))
