"""States for constant errors, such as calibration errors and errors of the model's constants."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynamics import ParameterUncertainty
from estimators.arrays import Floats
from estimators.process.process_model import FixBias


@dataclass(frozen=True, slots=True, eq=False)
class Statics:
    """Priors of constant errors.

    Attributes
    ----------
    uncertainty : ParameterUncertainty, optional
        Uncertainty of model constants; considered, not estimated.
    n_calibration : int
        Number of independent calibration errors of the cameras; considered, not estimated.
    fix_bias : FixBias, optional
        Common error of all fixes (direct measurements) of the target; estimated.
    offset_sd_m : float
        Standard deviation of the error of `TargetPoint.offset_m` on each axis [m]; the error is estimated.
    """

    uncertainty: ParameterUncertainty | None = None
    n_calibration: int = 0
    fix_bias: FixBias | None = None
    offset_sd_m: float = 0.0

    def parts(self, dim: int) -> dict[str, tuple[int, float, float]]:
        """Number of states, standard deviation and correlation time [s] of each kind of error, by its name."""
        n_constants = 0 if self.uncertainty is None else len(self.uncertainty.directions)
        bias, offset_sd_m = self.fix_bias, self.offset_sd_m
        return {
            "constants": (n_constants, 1.0, np.inf),
            "calibration": (self.n_calibration, 1.0, np.inf),
            "bias": (0, 0.0, np.inf) if bias is None else (dim, bias.sd_m, bias.lasting_s),
            "offset": (dim if offset_sd_m > 0.0 else 0, offset_sd_m, np.inf),
        }


class StaticStates:
    """States of constant errors. They are the last states of the state vector.

    Attributes
    ----------
    n : int
        Number of these states.
    parts : dict of str to slice
        Indices of the states of each kind of error, by the name of the kind. The first constant error has index 0.
    sd : (n,)
        Standard deviation of each state before any observation.
    considered : (n,) bool
        Whether a state increases covariances but is not estimated, as in a Schmidt-Kalman filter.
    """

    def __init__(self, statics: Statics, dim: int) -> None:
        self.parts: dict[str, slice] = {}
        sd: list[float] = []
        lasting: list[float] = []
        considered: list[bool] = []
        for name, (n, own_sd, own_s) in statics.parts(dim).items():
            if n:
                self.parts[name] = slice(len(sd), len(sd) + n)
            sd += [own_sd] * n
            lasting += [own_s] * n
            considered += [name in ("constants", "calibration")] * n
        self.n, self.sd, self._lasting_s = len(sd), np.array(sd), np.array(lasting)
        self.considered: NDArray[np.bool_] = np.array(considered, dtype=bool)

    def fading(self, dt: float) -> Floats:
        """Decay factor of each state over dt [s], (n,)."""
        return np.exp(-dt / self._lasting_s)
