"""Errors that last: constants of the model and the calibration of cameras, a bias of fixes, the target's offset."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynamics import MassSpringNetwork, ParameterUncertainty
from dynamics.elements import Span
from dynamics.forces.parameters import ParameterForces
from dynamics.integration.rosenbrock import Move
from estimators.arrays import Floats
from estimators.process.process_model import FixBias


@dataclass(frozen=True, slots=True, eq=False)
class Statics:
    """Priors of errors that last.

    Attributes
    ----------
    uncertainty : ParameterUncertainty, optional
        Of the constants; considered.
    n_calibration : int
        Independent errors of the calibration of cameras; considered.
    fix_bias : FixBias, optional
        That fixes of the target have in common; estimated.
    offset_sd_m : float
        Of the target's place in the tissue, an axis [m]; estimated.
    """

    uncertainty: ParameterUncertainty | None = None
    n_calibration: int = 0
    fix_bias: FixBias | None = None
    offset_sd_m: float = 0.0

    def parts(self, dim: int) -> dict[str, tuple[int, float, float]]:
        """By name the number of states, their standard deviation and their correlation time [s]."""
        n_constants = 0 if self.uncertainty is None else len(self.uncertainty.directions)
        bias, offset_sd_m = self.fix_bias, self.offset_sd_m
        return {
            "constants": (n_constants, 1.0, np.inf),
            "calibration": (self.n_calibration, 1.0, np.inf),
            "bias": (0, 0.0, np.inf) if bias is None else (dim, bias.sd_m, bias.lasting_s),
            "offset": (dim if offset_sd_m > 0.0 else 0, offset_sd_m, np.inf),
        }


class StaticStates:
    """The states of errors that last, in standard deviations or metres, behind the others of a tissue.

    Attributes
    ----------
    n : int
    parts : dict of str to slice
        Counted from the first of them.
    sd : (n,)
    considered : (n,) bool
        Those that no observation corrects.
    """

    def __init__(self, statics: Statics, network: MassSpringNetwork, span: Span) -> None:
        self.parts: dict[str, slice] = {}
        sd: list[float] = []
        lasting: list[float] = []
        considered: list[bool] = []
        for name, (n, own_sd, own_s) in statics.parts(network.dim).items():
            if n:
                self.parts[name] = slice(len(sd), len(sd) + n)
            sd += [own_sd] * n
            lasting += [own_s] * n
            considered += [name in ("constants", "calibration")] * n
        self.n, self.sd, self._lasting_s = len(sd), np.array(sd), np.array(lasting)
        self.considered: NDArray[np.bool_] = np.array(considered, dtype=bool)
        uncertainty = statics.uncertainty
        self._directions = None if uncertainty is None else uncertainty.directions
        self._forces = None if uncertainty is None else ParameterForces(network, uncertainty.parameters)
        self._span = span

    def fading(self, dt: float) -> Floats:
        """What is left of each after dt [s], (n,)."""
        return np.exp(-dt / self._lasting_s)

    def moved_by_constants(self, start: Floats, moves: Sequence[Move]) -> Floats:
        """How each constant that is off by a standard deviation moves the end of these steps, (2 n_coordinates, n).

        start: coordinates and velocities before them. Forces are held over halves of a step: the
        trapezium rule.
        """
        moving, n = len(start), len(start) // 2
        pushes = self._accelerations(np.stack([start, *(move.state[:moving] for move in moves)]))
        columns = np.zeros((moving, pushes.shape[2]))
        for move, before, after in zip(moves, pushes, pushes[1:], strict=False):
            columns[n:] += 0.5 * move.step_s * before
            columns = move.by_state[:, :moving] @ columns
            columns[n:] += 0.5 * move.step_s * after
        return columns

    def _accelerations(self, states: Floats) -> Floats:
        """By which each constant that is off by a standard deviation moves the body, (..., n_coordinates, n_constants).

        states: coordinates and velocities, (..., 2 n_coordinates); result [m/s²]
        """
        V, masses = self._span.matrix, self._span.masses
        if self._forces is None or self._directions is None:
            return np.zeros((*states.shape[:-1], len(masses), 0))
        nodes = np.concatenate([states[..., : len(masses)] @ V.T, states[..., len(masses) :] @ V.T], axis=-1)
        forces = self._directions @ self._forces(nodes)
        return np.asarray(forces @ V / masses).swapaxes(-1, -2)
