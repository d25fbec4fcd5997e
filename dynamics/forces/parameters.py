"""Constants of a network as parameters: names, scaling, and derivatives of the forces."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynamics.arrays import Floats, made_again
from dynamics.forces.kernels import (
    FIELDS,
    KINDS,
    OF_SPRINGS,
    SHORTEST,
    node_constants,
    packed,
    parameter_forces_each,
    resistance_by_log_constants,
    spring_constants,
    tension_by_log_constants,
)
from dynamics.network.mass_spring import MassSpringNetwork, NetworkError

LARGEST_LOG = float(np.log(np.finfo(float).max))
"""Largest logarithm whose exponential is a finite floating-point number [1]."""

ROUNDING = 1e-9
"""A remaining variance below this share of the original variance is only a rounding error [1]."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """A constant of a spring or of a node; kind: one of KINDS; index: index of the spring or node."""

    kind: str
    index: int


@dataclass(frozen=True, slots=True, eq=False)
class ParameterUncertainty:
    """Uncertainty of constants. The error of the log of each constant is a sum of n_directions independent errors.

    parameters: the uncertain constants
    directions: change of the log of each constant by one standard deviation of each independent error [1],
        (n_directions, n_parameters); the covariance of the logs is `directions.T @ directions`

    Raises NetworkError for other shapes, numbers that are not finite, and standard deviations above `LARGEST_LOG`.
    """

    parameters: tuple[Parameter, ...]
    directions: Floats

    def __post_init__(self) -> None:
        directions = np.array(self.directions, dtype=float)
        if directions.ndim != 2 or directions.shape[1] != len(self.parameters):
            raise NetworkError(
                f"directions: expected shape (n_directions, {len(self.parameters)}), found {directions.shape}"
            )
        if not np.isfinite(directions).all():
            raise NetworkError("directions: expected finite numbers, found others")
        largest = np.abs(directions).max(axis=0, initial=0.0)
        sd = largest * np.linalg.norm(directions / np.where(largest > 0.0, largest, 1.0), axis=0)
        for parameter, one in zip(self.parameters, sd, strict=True):
            if one > LARGEST_LOG:
                raise NetworkError(
                    f"directions: expected the log of {parameter.kind} {parameter.index} known to {LARGEST_LOG:.1f} or"
                    f" less, a finite factor, found {one:.3g}"
                )
        directions.setflags(write=False)
        object.__setattr__(self, "directions", directions)

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        return made_again(self)

    @property
    def cov(self) -> Floats:
        """Covariance of the logs of the constants, (n_parameters, n_parameters)."""
        return self.directions.T @ self.directions

    def beside(self, other: ParameterUncertainty) -> ParameterUncertainty:
        """Combined uncertainty: the errors of this uncertainty and of the other one are independent and add up."""
        place = {parameter: k for k, parameter in enumerate(dict.fromkeys((*self.parameters, *other.parameters)))}
        n_own = len(self.directions)
        directions = np.zeros((n_own + len(other.directions), len(place)))
        directions[:n_own, [place[parameter] for parameter in self.parameters]] = self.directions
        directions[n_own:, [place[parameter] for parameter in other.parameters]] = other.directions
        return ParameterUncertainty(tuple(place), directions)


def independent_uncertainty(parameters: Sequence[Parameter], sd: ArrayLike) -> ParameterUncertainty:
    """Independent uncertainty of constants; sd: relative standard deviations [1], (n_parameters,), or one for all."""
    return ParameterUncertainty(
        tuple(parameters), np.diag(np.broadcast_to(np.asarray(sd, dtype=float), len(parameters)))
    )


def strain_uncertainty(
    network: MassSpringNetwork, sd: float, *, length: float = 1.0, n_directions: int = 12
) -> ParameterUncertainty:
    """Uncertainty of rest lengths due to an unknown strain that varies smoothly over the body.

    For two springs along the unit vectors n and m, the covariance of the relative changes of the rest lengths is
    `sd² exp(-d² / 2 l²) (n · m)²`, with d the distance between the middles of the springs. A pivoted Cholesky
    decomposition [harbrecht2012] approximates this covariance.
    sd: standard deviation of the strain along any direction [1]; length: l, divided by the body's longest side [1]
    n_directions: largest rank of the approximation
    """
    which = parameters(network, ("rest_length",))
    one, other = network.positions[network.springs[[each.index for each in which]].T]
    middles = 0.5 * (one + other) / (length * np.ptp(network.positions, axis=0).max())
    along = (other - one) / np.linalg.norm(other - one, axis=1)[:, None]
    left, rows = np.full(len(which), sd**2), np.zeros((min(n_directions, len(which)), len(which)))
    for k in range(len(rows)):
        most = int(left.argmax())
        apart = ((middles - middles[most]) ** 2).sum(axis=1)
        cov = sd**2 * np.exp(-0.5 * apart) * (along @ along[most]) ** 2
        rows[k] = (cov - rows[:k, most] @ rows[:k]) / np.sqrt(left[most])
        left = np.maximum(left - rows[k] ** 2, 0.0)
        if left.max() <= ROUNDING * sd**2:
            return ParameterUncertainty(which, rows[: k + 1])
    return ParameterUncertainty(which, rows)


def parameters(network: MassSpringNetwork, kinds: Sequence[str] = KINDS) -> tuple[Parameter, ...]:
    """All positive constants of these kinds, kind by kind. A continuum has one stiffness for each tissue."""
    if network.continuum is not None:
        n_tissues = len(network.continuum.tissues) if "stiffness" in kinds else 0
        return tuple(Parameter("stiffness", tissue) for tissue in range(n_tissues))
    found = []
    for kind in KINDS:
        if kind in kinds:
            values = getattr(network, FIELDS[kind])
            places = range(len(values)) if kind in OF_SPRINGS else network.free
            found += [Parameter(kind, int(i)) for i in places if values[i] > 0]
    return tuple(found)


def parameter_label(network: MassSpringNetwork, parameter: Parameter) -> str:
    """Name of a constant, such as `stiffness M1-M2`, `drag M1` or `stiffness fat`."""
    if network.continuum is not None:
        return f"{parameter.kind} {network.continuum.tissues[parameter.index]}"
    if parameter.kind in OF_SPRINGS:
        i, j = network.springs[parameter.index]
        return f"{parameter.kind} {network.names[i]}-{network.names[j]}"
    return f"{parameter.kind} {network.names[parameter.index]}"


def parameter_named(network: MassSpringNetwork, text: str) -> Parameter:
    """The constant with the name `text`, see `parameter_label`. Raises NetworkError if there is no such constant."""
    for parameter in parameters(network):
        if parameter_label(network, parameter) == text:
            return parameter
    raise NetworkError(f'no positive constant named "{text}"')


def parameter_value(network: MassSpringNetwork, parameter: Parameter) -> float:
    """Value of a constant in SI units."""
    return float(getattr(network, FIELDS[parameter.kind])[parameter.index])


def scale_parameters(network: MassSpringNetwork, which: Sequence[Parameter], change: ArrayLike) -> MassSpringNetwork:
    """The network with each constant of `which` multiplied by `exp(change)`; change: [1], (n_parameters,)."""
    if network.continuum is not None:
        logs = np.zeros(len(network.continuum.tissues))
        np.add.at(logs, [parameter.index for parameter in which], np.asarray(change, dtype=float))
        return replace(network, continuum=network.continuum.scaled(np.exp(logs)))
    values = {kind: getattr(network, FIELDS[kind]).copy() for kind in KINDS}
    for parameter, factor in zip(which, np.exp(np.asarray(change, dtype=float)), strict=True):
        values[parameter.kind][parameter.index] *= factor
    return replace(network, **{FIELDS[kind]: parameter_value for kind, parameter_value in values.items()})


def parameter_forces(
    network: MassSpringNetwork, which: Sequence[Parameter], positions: ArrayLike, velocities: ArrayLike
) -> Floats:
    """Derivative of the forces on free coordinates with respect to the log of each constant [N], (n, n_free dim).

    positions, velocities: positions [m] and velocities [m/s] of all nodes, (n_nodes, dim) each
    """
    x, v = np.asarray(positions, dtype=float), np.asarray(velocities, dtype=float)
    if network.continuum is not None:
        shift = (x - network.positions)[network.free].ravel()
        return network.continuum.by_log_stiffness(shift)[[parameter.index for parameter in which]]
    i, j = network.springs.T
    apart = x[j] - x[i]
    lengths = np.sqrt((apart * apart).sum(axis=1) + SHORTEST**2)
    n = apart / lengths[:, None]
    rates = ((v[j] - v[i]) * n).sum(axis=1)
    tensions = tension_by_log_constants(lengths, rates, spring_constants(network))._asdict()
    resistances = resistance_by_log_constants((v * v).sum(axis=1), node_constants(network))._asdict()
    forces = np.zeros((len(which), network.n_nodes, network.dim))
    for force, parameter in zip(forces, which, strict=True):
        s = parameter.index
        if parameter.kind in OF_SPRINGS:
            force[i[s]] = tensions[parameter.kind][s] * n[s]
            force[j[s]] = -force[i[s]]
        else:
            force[s] = -resistances[parameter.kind][s] * v[s]
    return forces[:, network.free].reshape(len(which), -1)


class ParameterForces:
    """Compiled version of `parameter_forces` for the states of one network."""

    def __init__(self, network: MassSpringNetwork, which: Sequence[Parameter]) -> None:
        self._network, self._packed = network, packed(network)
        self._which = tuple(which)
        self._kinds = np.array([KINDS.index(parameter.kind) for parameter in which], dtype=np.int64)
        self._indices = np.array([parameter.index for parameter in which], dtype=np.int64)

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        return type(self), (self._network, self._which)

    def __call__(self, states: NDArray[np.float64]) -> Floats:
        """Derivatives of the forces with respect to the logs of n constants [N], (..., n, n_state / 2).

        states: states of the network, (..., n_state)
        """
        each = np.ascontiguousarray(states).reshape(-1, states.shape[-1])
        own = self._packed, self._kinds, self._indices, self._network.free
        forces = parameter_forces_each(each, self._network.positions, *own)
        return np.asarray(forces.reshape(*states.shape[:-1], *forces.shape[1:]))
