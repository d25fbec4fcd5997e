"""Deterministic ensemble Kalman filter of the tissue."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dynamics import MassSpringNetwork
from estimators.arrays import Floats
from estimators.baselines.baseline import Baseline
from estimators.process.target import TargetPoint
from estimators.tissue.settings import FilterSettings

N_MEMBERS = 200
"""Size n of the ensemble. The relative error of standard deviations is `1 / sqrt(2 n)`, or 5 %. With nine members per
state variable, localisation is unnecessary."""


class EnsembleKalmanFilter(Baseline):
    """Ensemble transform Kalman filter that assumes at all times that short forces (pokes) act.

    Noise is drawn at each step of at most 1/120 s. The update gives the ensemble the mean and covariance of the Kalman
    update, without perturbed marks, inflation or localisation. Source: [hunt2007], section 2.3.

    State: members (n_members, dim_x), besides the state of `Baseline`.
    """

    members: Floats

    def __init__(
        self,
        network: MassSpringNetwork,
        target: str | TargetPoint,
        marked: Sequence[str],
        settings: FilterSettings | None = None,
        *,
        rng: np.random.Generator,
        n_members: int | None = N_MEMBERS,
    ) -> None:
        super().__init__(network, target, marked, settings)
        if n_members is None:  # enough for any body
            n_members = max(N_MEMBERS, self.model.dim_x + 1)
        if n_members <= self.model.dim_x:
            raise ValueError(f"n_members: expected more than the {self.model.dim_x} states, found {n_members}")
        self._rng = rng
        self._n_members = n_members

    def _start(self, mean: Floats, cov: Floats) -> None:
        self.members = mean + self._drawn(cov)

    def _drawn(self, cov: Floats) -> Floats:
        return self._rng.standard_normal((self._n_members, len(cov))) @ np.linalg.cholesky(cov).T

    def _advance(self, dt: float) -> None:
        mode = self.settings.poked
        n = self.model.stepper.n_steps(dt)
        Q = self.model.noise(dt / n, mode)
        for _ in range(n):
            self.members = self.model.propagate(self.members, dt / n, mode) + self._drawn(Q)

    def _take(self, z: Floats, rows: NDArray[np.int64], R: Floats) -> float:
        mean = self.members.mean(axis=0)
        A = (self.members - mean) / np.sqrt(self._n_members - 1)  # P = A' A
        C = np.linalg.cholesky(R)
        y = np.linalg.solve(C, z - mean[rows])
        # deviations of the members at the marks, in units of the marks' noise: S = U (s² + 1) U'
        U, s, Vt = np.linalg.svd(np.linalg.solve(C, A[:, rows].T), full_matrices=False)
        moved = mean + (s / (1.0 + s**2) * (U.T @ y)) @ Vt @ A
        narrowed = A - (Vt.T * (1.0 - 1.0 / np.sqrt(1.0 + s**2))) @ (Vt @ A)
        self.members = moved + np.sqrt(self._n_members - 1) * narrowed
        return float(((U.T @ y) ** 2 / (1.0 + s**2)).sum() + y @ y - ((U.T @ y) ** 2).sum())

    def _moments(self) -> tuple[Floats, Floats]:
        part = self.members[:, : self.model.network.n_state // 2]
        return part.mean(axis=0), np.cov(part, rowvar=False)
