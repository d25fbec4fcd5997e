"""An extended Kalman filter of large or stiff networks whose gains are then fixed: its predictions as a simulation.

With the gains of one pass fixed, another network's predictions cost a simulation, so that sensitivities to some dozen
groups of constants are differences of simulations. Source: the prediction-error method, [ljung1999].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.stats import chi2

from dynamics import (
    MassSpringNetwork,
    NetworkError,
    Stepper,
    damping_matrix,
    equilibrium_with_fixed,
    mirrored_shapes,
    reaches,
    rest_shape,
    stiffness_matrix,
)
from estimators.arrays import Floats
from estimators.filters.unscented import CovarianceError
from estimators.identification.budget import Budget
from estimators.tissue.estimate import MarkMeasurement
from estimators.tissue.settings import FilterSettings

Frames = Sequence[tuple[float, Sequence[MarkMeasurement]]]

POKE_LEVEL = 1e-3
"""Probability of a frame's marks without a poke below which there was one; choice."""

TURNED = 0.1
"""Change of a spring by its length [1] beyond which the motion is linearised again; choice."""

GRAVITY = 9.81
"""A body that falls through its own reach is as fast as bodies are at a start [m/s²]."""

UNRESOLVED = float(np.pi)
"""Phase of a spring's own oscillation between two frames [rad] beyond which frames do not show it: Nyquist's limit."""

MOST_DIFFERENCED = 40
"""States up to which the transition matrix is that of the motion itself, by differences: a link that turns fast is not
linear over a frame. Beyond, the cost of simulating every state's difference is that of all else."""

OFFSET = 1e-6
"""Half the width of a central difference [m, m/s]: rounding is 1e-10 of a slope."""

TERMS = 8
"""Of the Taylor series of a step's transition; with a norm of at most 1/2 the next is below 1e-8."""


@dataclass(frozen=True, slots=True, eq=False)
class Correction:
    """What a frame's marks did: z (m,) at rows of the state, gain (n_state, m), root of S (m, m), S = root root'.

    dt: since the frame before [s]; poked: whether forces of pokes were allowed for
    """

    dt: float
    z: Floats
    rows: Sequence[int]
    gain: Floats
    root: Floats
    poked: bool


@dataclass(frozen=True, slots=True, eq=False)
class Gains:
    """One pass of the filter: its first state, the corrections of all later frames, and their log likelihood."""

    start: Floats
    corrections: tuple[Correction, ...]
    log_likelihood: float


class LinearFilter:
    """Extended Kalman filter of a network, white forces on every node, stronger ones on marked nodes in poked frames.

    State: x (n_state,), P (n_state, n_state), and the last linearisation.
    """

    def __init__(self, network: MassSpringNetwork, marked: Sequence[str], settings: FilterSettings) -> None:
        self.network, self.stepper = network, Stepper(network)
        n = network.n_state
        self._inverse_mass = np.repeat(1.0 / network.masses[network.free], network.dim)
        self._rows = {name: range(n)[network.coordinates(name)] for name in (network.names[i] for i in network.free)}
        calm, poke = np.zeros(n), np.zeros(n)
        calm[n // 2 :] = settings.quiet.white**2
        for node in marked:
            # the density at low frequencies of a force that is correlated over lasting_s
            poke[n // 2 + np.array(self._rows[node])] = 2.0 * settings.poked.poke**2 * settings.poked.lasting_s
        self._densities = (calm, poke)
        self._about: tuple[float, Floats] | None = None
        self._found: tuple[Floats, Floats, Floats] = (np.eye(n), np.zeros((n, n)), np.zeros((n, n)))
        self.x, self.P = np.zeros(n), np.zeros((n, n))

    def stack(self, marks: Sequence[MarkMeasurement]) -> tuple[Floats, list[int], Floats]:
        """Marks as one measurement: z (m,), rows of the state, covariance R (m, m)."""
        rows = [i for mark in marks for i in self._rows[mark.node]]
        R = np.zeros((len(rows), len(rows)))
        dim = self.network.dim
        for k, mark in enumerate(marks):
            R[k * dim : (k + 1) * dim, k * dim : (k + 1) * dim] = mark.total_cov
        return np.concatenate([mark.position for mark in marks]), rows, R

    def start(self, shape: Floats, marks: Sequence[MarkMeasurement]) -> None:
        """Set the state to a shape of all nodes [m], (n_nodes, dim), with marks, in motion as a body that fell."""
        network = self.network
        half, reach = network.n_state // 2, float(reaches(network).max())
        z, rows, R = self.stack(marks)
        speed = GRAVITY * reach
        # as if shaken until its energy a coordinate is that of a fall through its reach
        values, vectors = np.linalg.eigh(stiffness_matrix(network, shape))
        energy = float(network.masses[network.free].mean()) * speed
        precision = (vectors * (np.maximum(values, 0.0) / energy + 1.0 / reach**2)) @ vectors.T
        precision[np.ix_(rows, rows)] += np.linalg.inv(R)
        self.x[:half] = shape[network.free].ravel()
        self.x[rows] = z
        self.P[:half, :half] = np.linalg.inv(precision)
        self.P[half:, half:] = np.diag(energy * self._inverse_mass)

    def predict(self, dt: float) -> tuple[Floats, Floats, Floats]:
        """The state dt [s] later: mean, covariance without pokes, and what pokes add to that; the state stays."""
        F, Q, poked = self._linearised(dt)
        if len(self.x) <= MOST_DIFFERENCED:
            x, F = self._differenced(dt)
        else:
            x = self.stepper.advance(self.x[None], dt)[0]
        P = F @ self.P @ F.T
        return x, 0.5 * (P + P.T) + Q, poked

    def _differenced(self, dt: float) -> tuple[Floats, Floats]:
        n = len(self.x)
        offsets = OFFSET * np.eye(n)
        moved = self.stepper.advance(np.vstack([self.x[None], self.x + offsets, self.x - offsets]), dt)
        return moved[0], np.asarray((moved[1 : n + 1] - moved[n + 1 :]).T / (2.0 * OFFSET))

    def _linearised(self, dt: float) -> tuple[Floats, Floats, Floats]:
        network, n = self.network, self.network.n_state
        half = n // 2
        shape = network.positions.copy()
        shape[network.free] = self.x[:half].reshape(-1, network.dim)
        i, j = network.springs.T
        apart = shape[j] - shape[i]
        if self._about is not None and self._about[0] == round(dt, 9):
            moved = np.linalg.norm(apart - self._about[1], axis=1) / network.rest_lengths
            if moved.max() < TURNED:
                return self._found
        A = np.zeros((n, n))
        A[:half, half:] = np.eye(half)
        speed = float(np.sqrt(np.mean(self.x[half:] ** 2)))
        A[half:, :half] = -self._inverse_mass[:, None] * stiffness_matrix(network, shape)
        A[half:, half:] = -self._inverse_mass[:, None] * damping_matrix(network, shape, speed_m_s=speed)
        self._about = round(dt, 9), apart
        F, calm, poked = transition(A, self._densities, dt)
        self._found = F, calm, poked
        return self._found

    def correct(self, dt: float, marks: Sequence[MarkMeasurement]) -> tuple[Correction | None, float]:
        """Predict, then take in the marks, with pokes where they are improbable without; and their log likelihood."""
        x, P, poked_cov = self.predict(dt)
        if not marks:
            self.x, self.P = x, P + poked_cov
            return None, 0.0
        z, rows, R = self.stack(marks)
        y = z - x[rows]
        poked = False
        S = P[np.ix_(rows, rows)] + R
        factor = _factor(S)
        nis = float(y @ cho_solve(factor, y))
        if nis > chi2.isf(POKE_LEVEL, len(y)):
            poked, P = True, P + poked_cov
            S = P[np.ix_(rows, rows)] + R
            factor = _factor(S)
            nis = float(y @ cho_solve(factor, y))
        gain = cho_solve(factor, P[rows]).T
        self.x = x + gain @ y
        joseph = P - gain @ P[rows]
        self.P = joseph - (joseph[:, rows] - gain @ R) @ gain.T
        self.P = 0.5 * (self.P + self.P.T)
        chol = np.tril(factor[0])
        log = -0.5 * (nis + 2.0 * float(np.log(np.diag(chol)).sum()) + len(y) * float(np.log(2.0 * np.pi)))
        return Correction(dt, z, rows, gain, chol, poked), log


def quasi_static(network: MassSpringNetwork, dt: float) -> MassSpringNetwork:
    """The network with critical dashpots along springs whose own oscillation frames dt [s] apart do not resolve.

    Such a link is as long as its tension makes it. Otherwise the noise of each frame would set it ringing, and the
    phase of that, which no frame shows, would seem to determine its stiffness.
    """
    critical = 2.0 * np.sqrt(network.stiffness * _reduced_masses(network))
    damping = np.where(unresolved(network, dt), np.maximum(network.damping, critical), network.damping)
    return replace(network, damping=damping)


def unresolved(network: MassSpringNetwork, dt: float) -> NDArray[np.bool_]:
    """Springs whose own oscillation frames dt [s] apart do not show, (n_springs,)."""
    anchored = network.fixed[network.springs].all(axis=1)
    return ~anchored & (np.sqrt(network.stiffness) * dt > UNRESOLVED * np.sqrt(_reduced_masses(network)))


def _reduced_masses(network: MassSpringNetwork) -> Floats:
    """Of the two ends of each spring [kg], (n_springs,); of an anchored one its free end's."""
    free = ~network.fixed[network.springs]
    masses = network.masses[network.springs]
    both = masses.prod(axis=1) / np.maximum(masses.sum(axis=1), np.finfo(float).tiny)
    one = np.where(free[:, 0], masses[:, 0], masses[:, 1])
    return np.where(free.all(axis=1), both, one)


def _factor(S: Floats) -> tuple[Floats, bool]:
    try:
        return cho_factor(S, lower=True)
    except (np.linalg.LinAlgError, ValueError):
        raise CovarianceError("innovation covariance: expected positive definite, found otherwise") from None


def transition(A: Floats, densities: Sequence[Floats], dt: float) -> tuple[Floats, ...]:
    """Transition matrix over dt [s] of dx/dt = A x, and the covariance that each white noise adds.

    densities: diagonals, (n,) each. By a short step's Taylor series, doubled.
    """
    n = len(A)
    doublings = max(0, int(np.ceil(np.log2(max(np.abs(A).sum(axis=1).max() * dt, 1e-30)))) + 1)
    h = dt / 2.0**doublings
    F, power = np.eye(n), np.eye(n)
    covs = [np.diag(D) * h for D in densities]
    # Q = sum of h^(k+1)/(k+1)! L^k D, with L D = A D + D A'
    terms = [np.diag(D) * h for D in densities]
    for k in range(1, TERMS + 1):
        power = power @ A * (h / k)
        F = F + power
        terms = [(A @ term + term @ A.T) * (h / (k + 1)) for term in terms]
        covs = [cov + term for cov, term in zip(covs, terms, strict=True)]
    for _ in range(doublings):
        covs = [cov + F @ cov @ F.T for cov in covs]
        F = F @ F
    return (F, *(0.5 * (cov + cov.T) for cov in covs))


def first_shapes(network: MassSpringNetwork, marks: Sequence[MarkMeasurement]) -> list[Floats]:
    """Shapes of all nodes in which these marks may hold the network [m], (n_nodes, dim) each: elbows on either side."""
    places = {mark.node: mark.position for mark in marks}
    try:
        shape = equilibrium_with_fixed(network, places)
    except NetworkError:
        return [rest_shape(network)]
    return [shape, *(other for _, other in mirrored_shapes(network, places, shape))]


def filtered(
    network: MassSpringNetwork,
    marked: Sequence[str],
    settings: FilterSettings,
    frames: Frames,
    budget: Budget,
) -> Gains:
    """A pass through the frames, from the shape at the first marks that fits best; raises CovarianceError."""
    seen = next(k for k, (_, marks) in enumerate(frames) if marks)
    passes = []
    for shape in first_shapes(network, frames[seen][1]):
        linear = LinearFilter(network, marked, settings)
        linear.start(shape, frames[seen][1])
        start, corrections, total = linear.x.copy(), [], 0.0
        before, waited = frames[seen][0], 0.0
        for time_s, marks in frames[seen + 1 :]:
            budget.check()
            found, log = linear.correct(time_s - before, marks)
            waited += time_s - before
            before, total = time_s, total + log
            if found is not None:
                corrections.append(Correction(waited, found.z, found.rows, found.gain, found.root, found.poked))
                waited = 0.0
        passes.append(Gains(start, tuple(corrections), total))
    return max(passes, key=lambda one: one.log_likelihood)


def predicted(network: MassSpringNetwork, gains: Gains, budget: Budget) -> tuple[list[Floats], Floats]:
    """Normalised innovations of each correction, and the states after it, (n_corrections, n_state), of a network."""
    stepper, x = Stepper(network), gains.start
    normalised, states = [], []
    for one in gains.corrections:
        budget.check()
        x = stepper.advance(x[None], one.dt)[0]
        y = one.z - x[one.rows]
        x = x + one.gain @ y
        normalised.append(np.linalg.solve(one.root, y))
        states.append(x)
    return normalised, np.array(states)
