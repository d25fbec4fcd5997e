"""An extended Kalman filter of large or stiff networks, with the sensitivities of its error to constants beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from dynamics import (
    ImplicitStepper,
    MassSpringNetwork,
    NetworkError,
    ParameterForces,
    ParameterUncertainty,
    Stepper,
    damping_matrix,
    equilibrium_with_fixed,
    reaches,
    rest_shape,
    scale_parameters,
    stiffness_matrix,
)
from estimators.arrays import Floats
from estimators.filters.unscented import CovarianceError
from estimators.process.linear_motion import GRAVITY
from estimators.tissue.estimate import MarkMeasurement
from estimators.tissue.settings import FilterSettings

POKE_LEVEL = 1e-3
"""Probability of a frame's marks without a poke below which there was one; choice, its cost in docs/settings.md."""

TURNED = 0.1
"""Change of a spring by its length [1] beyond which the motion is linearised again; choice, its cost in
docs/settings.md."""

FRAMES_A_PERIOD = 4.0
"""Frames in a period of an oscillation that they show, at least [1]: twice Nyquist's two; choice, its cost in
docs/settings.md."""

RIGID_SHARE = 1e-3
"""Share of a spring's motion along itself in oscillations that frames show below which it is a rigid link; choice,
its cost in docs/settings.md."""

MOST_DIFFERENCED = 40
"""States up to which the transition matrix is that of the motion itself, by differences: a link that turns fast is not
linear over a frame. Beyond, the cost of simulating every state's difference is that of all else."""

OFFSET = 1e-6
"""Half the width of a central difference [m, m/s]: rounding is 1e-10 of a slope."""

DIFFERENCE = 1e-4
"""Of a direction of constants, in units of it, by which sensitivities are differences; rounding is 1e-9 of them."""

TERMS = 8
"""Of the Taylor series of a step's transition; with a norm of at most 1/4 the next is below 1e-11."""


@dataclass(frozen=True, slots=True, eq=False)
class NormalisedInnovation:
    """Of one frame's marks, in standard deviations: y (m,), and its sensitivity to each direction, T (m, n).

    log_likelihood: of the marks; poked: whether they were improbable without a poke
    """

    y: Floats
    T: Floats
    log_likelihood: float
    poked: bool


@dataclass(frozen=True, slots=True, eq=False)
class _Step:
    """Over an interval: transition F, covariances of calm and of poked noise, effect of a force; (n, n), (n, n / 2)."""

    F: Floats
    calm: Floats
    poked: Floats
    effect: Floats


class LinearFilter:
    """Extended Kalman filter of a network: white forces on every node, stronger ones on marked nodes in poked frames.

    frame_s: usual interval of the frames [s]: links that these do not resolve are `quasi_static`; 0: none are
    State: x (n_state,), P (n_state, n_state), columns (n_state, n): sensitivity of the error of x to each direction of
    the uncertainty of constants, which are taken as exact; and the last linearisation.
    """

    def __init__(
        self,
        network: MassSpringNetwork,
        marked: Sequence[str],
        settings: FilterSettings,
        uncertainty: ParameterUncertainty,
        frame_s: float,
    ) -> None:
        self.network = quasi_static(network, frame_s)
        n, n_columns = network.n_state, len(uncertainty.directions)
        self.x, self.P, self.columns = np.zeros(n), np.zeros((n, n)), np.zeros((n, n_columns))
        self._stepper, self._implicit = Stepper(self.network), ImplicitStepper(self.network)
        self._uncertainty = uncertainty
        self._small = n <= MOST_DIFFERENCED
        self._others: list[Stepper] = []
        self._forces = ParameterForces(self.network, uncertainty.parameters)
        if self._small:
            for row in uncertainty.directions:
                other = scale_parameters(network, uncertainty.parameters, DIFFERENCE * row)
                self._others.append(Stepper(quasi_static(other, frame_s)))
        self._inverse_mass = np.repeat(1.0 / network.masses[network.free], network.dim)
        self._rows = {name: range(n)[network.coordinates(name)] for name in (network.names[i] for i in network.free)}
        calm, poke = np.zeros(n), np.zeros(n)
        calm[n // 2 :] = settings.quiet.white**2
        for node in marked:
            # the density at low frequencies of a force that is correlated over lasting_s
            poke[n // 2 + np.array(self._rows[node])] = 2.0 * settings.poked.poke**2 * settings.poked.lasting_s
        for node in settings.led_nodes:
            calm[n // 2 + np.array(self._rows[node])] = 2.0 * settings.leading.poke**2 * settings.leading.lasting_s
        self._densities = (calm, poke)
        self._about: tuple[float, Floats, _Step] | None = None

    def start(self, shape: Floats, marks: Sequence[MarkMeasurement]) -> None:
        """Set the state to a shape of all nodes [m], (n_nodes, dim), with marks, in motion as a body that fell."""
        network = self.network
        half, reach = network.n_state // 2, float(reaches(network).max())
        z, rows, R = self._stack(marks)
        # as if shaken until its energy a coordinate is that of a fall through its reach: so fast bodies are at a start
        energy = float(network.masses[network.free].mean()) * GRAVITY * reach
        values, vectors = np.linalg.eigh(stiffness_matrix(network, shape))
        precision = (vectors * (np.maximum(values, 0.0) / energy + 1.0 / reach**2)) @ vectors.T
        precision[np.ix_(rows, rows)] += np.linalg.inv(R)
        self.x[:half] = shape[network.free].ravel()
        self.x[rows] = z
        self.P[:half, :half] = np.linalg.inv(precision)
        self.P[half:, half:] = np.diag(energy * self._inverse_mass)

    def advance(self, dt: float, marks: Sequence[MarkMeasurement]) -> NormalisedInnovation | None:
        """Move the state dt [s] ahead, then take in the marks, with pokes where they are improbable without.

        Raises CovarianceError where there is no finite innovation.
        """
        x, columns, step = self._moved(dt)
        P = step.F @ self.P @ step.F.T + step.calm
        if not marks:
            self.x, self.columns, self.P = x, columns, P + step.poked
            return None
        z, rows, R = self._stack(marks)
        y = z - x[rows]
        inverse = _inverse_root(P[np.ix_(rows, rows)] + R)
        poked = bool(((inverse @ y) ** 2).sum() > chi2.isf(POKE_LEVEL, len(y)))
        if poked:
            P = P + step.poked
            inverse = _inverse_root(P[np.ix_(rows, rows)] + R)
        found = _normalised(inverse, y, columns[rows], poked=poked)
        gain = (inverse @ P[rows]).T @ inverse
        self.x = x + gain @ y
        self.columns = columns - gain @ columns[rows]
        # Joseph's form: of what marks leave almost nothing of, a difference is rounding
        kept = P - gain @ P[rows]
        kept = kept - kept[:, rows] @ gain.T + gain @ R @ gain.T
        self.P = 0.5 * (kept + kept.T)
        return found

    def innovation(self, marks: Sequence[MarkMeasurement]) -> NormalisedInnovation:
        """Of marks that are not taken in. Raises CovarianceError where there is no finite one."""
        z, rows, R = self._stack(marks)
        inverse = _inverse_root(self.P[np.ix_(rows, rows)] + R)
        return _normalised(inverse, z - self.x[rows], self.columns[rows], poked=False)

    def _stack(self, marks: Sequence[MarkMeasurement]) -> tuple[Floats, list[int], Floats]:
        rows = [i for mark in marks for i in self._rows[mark.node]]
        dim = self.network.dim
        R = np.zeros((len(rows), len(rows)))
        for k, mark in enumerate(marks):
            R[k * dim : (k + 1) * dim, k * dim : (k + 1) * dim] = mark.total_cov
        return np.concatenate([mark.position for mark in marks]), rows, R

    def _moved(self, dt: float) -> tuple[Floats, Floats, _Step]:
        """Mean and columns dt [s] later, and the step.

        Of a small network by differences of its motion; of a large one by implicit steps and their matrices half way.
        """
        n = len(self.x)
        if not self._small:
            none = np.zeros((1, n // 2))
            half_way = self._implicit.advance(self.x[None], 0.5 * dt, none)
            x, tangent = self._implicit.advance(half_way, 0.5 * dt, none)[0], self._implicit.linearised(half_way, dt)
            F, made = tangent.F[0], tangent.half[0][:, n // 2 :]
            calm, poked = ((made * (dt * density[n // 2 :])) @ made.T for density in self._densities)
            # of the start and the end of the step
            forces = 0.5 * self._uncertainty.directions @ (self._forces(self.x) + self._forces(x))
            return x, F @ self.columns + tangent.by_force[0] @ forces.T, _Step(F, calm, poked, tangent.by_force[0])
        step = self._linearised(dt)
        offsets = OFFSET * np.eye(n)
        moved = self._stepper.advance(np.vstack([self.x[None], self.x + offsets, self.x - offsets]), dt)
        x, F = moved[0], (moved[1 : n + 1] - moved[n + 1 :]).T / (2.0 * OFFSET)
        drift = [(other.advance(self.x[None], dt)[0] - x) / DIFFERENCE for other in self._others]
        return x, F @ self.columns + np.array(drift).T.reshape(n, -1), replace(step, F=F)

    def _linearised(self, dt: float) -> _Step:
        network, n = self.network, self.network.n_state
        half = n // 2
        shape = network.positions.copy()
        shape[network.free] = self.x[:half].reshape(-1, network.dim)
        i, j = network.springs.T
        apart = shape[j] - shape[i]
        if self._about is not None and self._about[0] == round(dt, 9):
            moved = np.linalg.norm(apart - self._about[1], axis=1) / network.rest_lengths
            if moved.max() < TURNED:
                return self._about[2]
        A = np.zeros((n, n))
        A[:half, half:] = np.eye(half)
        speed = float(np.sqrt(np.mean(self.x[half:] ** 2)))
        A[half:, :half] = -self._inverse_mass[:, None] * stiffness_matrix(network, shape)
        A[half:, half:] = -self._inverse_mass[:, None] * damping_matrix(network, shape, speed_m_s=speed)
        F, integral, calm, poked = transition(A, self._densities, dt)
        step = _Step(F, calm, poked, integral[:, half:] * self._inverse_mass)
        self._about = round(dt, 9), apart, step
        return step


def _normalised(inverse: Floats, y: Floats, columns: Floats, *, poked: bool) -> NormalisedInnovation:
    """Of an innovation y (m,), sensitivities columns (m, n), and W (m, m) with W S W' = 1."""
    normalised = inverse @ y
    log = np.log(np.diag(inverse)).sum() - 0.5 * (normalised @ normalised + len(y) * np.log(2.0 * np.pi))
    return NormalisedInnovation(normalised, inverse @ columns, float(log), poked)


def quasi_static(network: MassSpringNetwork, dt: float) -> MassSpringNetwork:
    """The network with critical dashpots along links that are rigid for frames dt [s] apart.

    Such a link is as long as its tension makes it. Otherwise the noise of each frame would set it ringing, and the
    phase of that, which no frame shows, would seem to determine its stiffness.
    """
    critical = 2.0 * np.sqrt(network.stiffness * _reduced_masses(network))
    damping = np.where(rigid_links(network, dt), np.maximum(network.damping, critical), network.damping)
    return replace(network, damping=damping)


def rigid_links(network: MassSpringNetwork, dt: float) -> NDArray[np.bool_]:
    """Springs whose length no oscillation changes that frames dt [s] apart show, (n_springs,).

    By the modes about the drawn shape: the rods of a chain are, the springs of a block that wobbles are not.
    """
    scale = np.sqrt(np.repeat(1.0 / network.masses[network.free], network.dim))
    values, modes = np.linalg.eigh(scale[:, None] * stiffness_matrix(network, network.positions) * scale)
    shown = np.sqrt(np.maximum(values, 0.0)) * dt < 2.0 * np.pi / FRAMES_A_PERIOD
    moves = np.zeros((network.n_nodes, network.dim, len(values)))
    moves[network.free] = (scale[:, None] * modes).reshape(len(network.free), network.dim, -1)
    i, j = network.springs.T
    apart = network.positions[j] - network.positions[i]
    n = apart / np.linalg.norm(apart, axis=1, keepdims=True)
    strains = np.einsum("sd,sdk->sk", n, moves[j] - moves[i]) ** 2
    total = strains.sum(axis=1)
    return np.asarray((total > 0.0) & (strains[:, shown].sum(axis=1) < RIGID_SHARE * total))


def _reduced_masses(network: MassSpringNetwork) -> Floats:
    """Of the two ends of each spring [kg], (n_springs,); of an anchored one its free end's."""
    free = ~network.fixed[network.springs]
    masses = network.masses[network.springs]
    both = masses.prod(axis=1) / np.maximum(masses.sum(axis=1), np.finfo(float).tiny)
    one = np.where(free[:, 0], masses[:, 0], masses[:, 1])
    return np.where(free.all(axis=1), both, one)


def _inverse_root(S: Floats) -> Floats:
    """W (m, m), lower triangular, with W S W' = 1."""
    try:
        return np.asarray(np.linalg.inv(np.linalg.cholesky(S)))
    except np.linalg.LinAlgError:
        raise CovarianceError("innovation covariance: expected positive definite, found otherwise") from None


def transition(A: Floats, densities: Sequence[Floats], dt: float) -> tuple[Floats, ...]:
    """Over dt [s] of dx/dt = A x: transition matrix, its integral over time, and the covariance of each white noise.

    densities: diagonals, (n,) each. By a short step's Taylor series, doubled.
    """
    n = len(A)
    doublings = max(0, int(np.ceil(np.log2(max(np.abs(A).sum(axis=1).max() * dt, 1e-30)))) + 2)
    h = dt / 2.0**doublings
    power = np.eye(n)
    F, integral = np.eye(n), h * np.eye(n)
    for k in range(1, TERMS + 1):
        power = power @ A * (h / k)
        F = F + power
        integral = integral + power * (h / (k + 1))
    # Simpson's rule for the noise of the short step
    middle = np.eye(n) + A * (h / 2.0) + A @ A * (h * h / 8.0)
    covs = [h / 6.0 * (np.diag(D) + 4.0 * (middle * D) @ middle.T + (F * D) @ F.T) for D in densities]
    for _ in range(doublings):
        covs = [cov + F @ cov @ F.T for cov in covs]
        integral = integral + F @ integral
        F = F @ F
    return (F, integral, *(0.5 * (cov + cov.T) for cov in covs))


def first_shape(network: MassSpringNetwork, marks: Sequence[MarkMeasurement]) -> Floats:
    """The shape of all nodes in which these marks hold the network [m], (n_nodes, dim); its rest shape if in none.

    Raises CovarianceError without marks.
    """
    if not marks:
        raise CovarianceError("start: expected marks in the first frame, found none")
    try:
        return equilibrium_with_fixed(network, {mark.node: mark.position for mark in marks})
    except NetworkError:
        return rest_shape(network)
