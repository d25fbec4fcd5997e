"""Observation of positions of points of the body, such as marks and the target."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from estimators.arrays import Floats
from estimators.core.innovations import block_diagonal
from estimators.tissue.estimate import MarkMeasurement


class Places:
    """Observation of the positions of named points. The positions are linear in the state.

    Parameters
    ----------
    marks : sequence of MarkMeasurement
        One or more.
    maps : mapping of str to (dim, n)
        Matrix that maps the state to the position of a point, by the name of the point.
    calibration : slice, optional
        Indices of the states for the marks' shared errors. If None, shared errors are independent between frames.
    noise : float
        Factor on the standard deviation of each mark's own noise [1].

    Attributes
    ----------
    value, cov, noise_cov : (m,), (m, m), (m, m)
        Concatenated positions [m], covariance of their errors [m²], covariance of the marks' own noise alone [m²].
    """

    def __init__(
        self,
        marks: Sequence[MarkMeasurement],
        maps: Mapping[str, Floats],
        calibration: slice | None = None,
        noise: float = 1.0,
    ) -> None:
        dim = len(marks[0].position)
        self.names = tuple(mark.node for mark in marks)
        self.value = np.concatenate([mark.position for mark in marks])
        self.blocks = tuple(slice(k * dim, (k + 1) * dim) for k in range(len(marks)))
        shared = _shared(marks)
        self._rows = np.vstack([maps[mark.node] for mark in marks])
        self.noise_cov = noise**2 * block_diagonal([mark.cov for mark in marks])
        self.cov = self.noise_cov + shared @ shared.T if calibration is None else self.noise_cov.copy()
        if calibration is not None and shared.shape[1]:
            self._rows[:, calibration] = shared

    def linearize(self, state: Floats) -> tuple[Floats, Floats]:
        """Predicted positions (m,) at a state (n,), and their derivative (m, n)."""
        return self._rows @ state, self._rows


def _shared(marks: Sequence[MarkMeasurement]) -> Floats:
    """Shift of all marks per standard deviation of each shared error, (m, n_shared)."""
    dim, n = len(marks[0].position), max(0 if mark.shared is None else mark.shared.shape[1] for mark in marks)
    columns = np.zeros((len(marks) * dim, n))
    for k, mark in enumerate(marks):
        if mark.shared is None:
            continue
        if mark.shared.shape[1] != n:
            raise ValueError(f"mark {mark.node} shared: expected {n} directions, found {mark.shared.shape[1]}")
        columns[k * dim : (k + 1) * dim] = mark.shared
    return columns
