"""Fast predictions of the target for a live loop, with precomputed matrices of the motion about rest.

All modes have the same transition T; only the variance of their noise differs. The mean m and the covariance P of the
whole mixture are therefore predicted directly: `m <- T m`, and `P <- T P T' + sum over sources of E[variance] N`. N is
the noise covariance of a source at variance 1. The mode probabilities give E[variance]. H maps the state to the target,
and `G_k = H T^k`. After k steps, the covariance of the target is
`G_k P G_k' + sum over j of G_(k-j) (noise of step j) G_(k-j)'`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from estimators.arrays import Floats
from estimators.core.posterior import TissuePosterior


@dataclass(frozen=True, slots=True, eq=False)
class AheadTables:
    """Matrices that predict the target at n_times times with the interval cycle_s [s]. The first time is the present.

    Attributes
    ----------
    shape : (n_nodes, dim)
        Positions at rest [m].
    rest : (n,)
        State at rest.
    by_state : (n_times, dim, n)
        Derivative of the target with respect to the present state.
    by_noise : (n_times, n_sources, dim, dim)
        Covariance that one step of noise gives the target k steps later, for each source at variance 1. First index: k.
    by_push : (n_times, dim, n_free dim)
        Shift of the target k steps after the start of a step with a unit force [m/N]. The first index is k.
    """

    cycle_s: float
    n_times: int
    shape: Floats
    rest: Floats
    constant: Floats
    by_state: Floats
    by_noise: Floats
    by_push: Floats

    @classmethod
    def of(cls, tissue: TissuePosterior, n_times: int, cycle_s: float) -> AheadTables:
        """Compute the tables from the model of a filter; the filter's state has no effect.

        Raises ValueError for less than one time, and for an interval that is not positive.
        """
        if n_times < 1 or not 0.0 < cycle_s < np.inf:
            raise ValueError(f"n_times, cycle_s: expected 1 or more and more than 0, found {n_times} and {cycle_s}")
        process, network = tissue.process, tissue.network
        rest = np.zeros(process.n)
        rest[process.parts["position"]] = process.coordinates(tissue.rest)
        found = process.linearize(rest, cycle_s)
        rows = [tissue.rows_of(tissue.target)]
        for _ in range(n_times - 1):
            rows.append(rows[-1] @ found.matrix)
        G = np.array(rows)
        own = G[:, :, : found.noises.shape[1]]
        noises = [own @ noise @ own.swapaxes(1, 2) for noise in found.noises]
        noises += [(G * variances) @ G.swapaxes(1, 2) for variances in found.independent]
        unit = process.pushed(rest, cycle_s, np.eye(len(network.free) * network.dim))
        pushed = np.concatenate([np.zeros((1, len(G[0]), unit.shape[1])), G[:-1] @ unit])
        if tissue.flexibility is not None:
            pushed[1] += tissue.target.matrix @ tissue.flexibility
        return cls(
            cycle_s,
            n_times,
            tissue.rest,
            rest,
            tissue.target.constant,
            G,
            np.stack(noises, axis=1),
            pushed,
        )

    def shift(self, push: Floats) -> Floats:
        """Displacement of the target at each of the n_times times [m], (n_times, dim), by known forces.

        push: constant force on the free nodes in each step [N], (n_times - 1, n_free, dim). Other shapes: ValueError
        """
        forces, shifts = np.asarray(push, dtype=float).reshape(len(push), -1), np.zeros(self.by_push.shape[:2])
        if forces.shape != (self.n_times - 1, self.by_push.shape[2]):
            raise ValueError(f"push: expected shape ({self.n_times - 1}, n_free, dim), found {np.shape(push)}")
        for step, force in enumerate(forces):
            shifts[step + 1 :] += self.by_push[1 : self.n_times - step] @ force
        return shifts

    def parts(self, tissue: TissuePosterior) -> list[tuple[Floats, Floats, Floats]]:
        """For each of two or three cases: probability (n_times,), and mean and covariance of the target at each time.

        A case states what happens until a time. In the first case, no short force acts and no slow force becomes
        stronger. In the second case, which a continuum lacks, no force drags a node. In the last case, all may happen.
        """
        weights, chain = tissue.filter.weights, expm(tissue.filter.rates * self.cycle_s)  # mode changes in a step
        n_short = tissue.process.disturbances.n_short
        short, found = np.arange(len(weights)) % n_short, []  # state of the short forces in each mode
        for are_kept, changes in [(short == 0, np.tril(chain)), (short < 2, chain)][: max(1, n_short - 1)]:
            kept = np.where(np.outer(are_kept, are_kept), changes, 0.0)
            found.append(self._moments(tissue, np.where(are_kept, weights, 0.0), kept))
        return [*found, self._moments(tissue, weights, chain)]

    def times(self, tissue: TissuePosterior) -> Floats:
        """Times of the tables [s], (n_times,), from the filter's time on. Raises ValueError before the first frame."""
        if tissue.time_s is None:
            raise ValueError("ahead: expected a filter after its first frame, found no time")
        return tissue.time_s + self.cycle_s * np.arange(self.n_times, dtype=np.float64)

    def _moments(self, tissue: TissuePosterior, weights: Floats, chain: Floats) -> tuple[Floats, Floats, Floats]:
        """One case of `parts`. weights, chain: start probabilities and transition probabilities of the case's modes."""
        odds = [weights]
        for _ in range(self.n_times - 1):
            odds.append(odds[-1] @ chain)
        total = np.sum(odds, axis=1)
        shares = np.array(odds) / np.maximum(total, np.finfo(float).tiny)[:, None]
        mean, cov = tissue.filter.moments_by(shares[0])
        means = self.by_state @ (mean - self.rest) + self.by_state[0] @ self.rest + self.constant
        means[0] += tissue.constant_of(tissue.target) - self.constant
        by_cov = (self.by_state.reshape(-1, len(cov)) @ cov).reshape(self.by_state.shape)
        covs = by_cov @ self.by_state.swapaxes(1, 2)
        variances, steps = shares @ tissue.filter.variances, np.arange(self.n_times)
        since = steps[:, None] - steps  # number of steps from the noise to each time
        noise = np.where(since[..., None] > 0, variances[since], 0.0)
        return total, means, covs + np.tensordot(noise, self.by_noise, axes=2)
