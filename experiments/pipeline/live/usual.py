"""What a scene leaves unsaid is not exact: how well constants and camera are known where nobody says."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dynamics import ParameterUncertainty, independent_uncertainty, parameters
from estimators import StaticBalance, TissueFilter
from experiments.arrays import Floats
from experiments.formats.scene.scene import Scene


@dataclass(frozen=True, slots=True)
class UsualUncertainty:
    """Standard deviations, relative, where a scene states none.

    stiffness: of each spring for the target, of all together for the balance of forces, where each by itself would hide
        a cut spring [1]; choice
    scale: of a camera's millimetres a pixel [1]; choice: half of what a scale is supposed to be wrong by at most
    """

    stiffness: float = 0.3
    scale: float = 0.025


USUAL = UsualUncertainty()


def balance_of(scene: Scene, tissue: TissueFilter, usual: UsualUncertainty = USUAL) -> tuple[StaticBalance, Floats]:
    """The balance of a scene's body, and what the scene leaves unsaid adds to the target's covariance [m²], (dim, dim).

    Constants are said to be known by `[uncertainty]`, as `softaim identify` writes it, a camera by `scale_sd` or by the
    `uncertainty` of its calibration. What is said the filter considers; what is not leaves its estimates as they are.
    """
    which = parameters(scene.network, ("stiffness",))
    silent = scene.uncertainty is None
    each = independent_uncertainty(which, usual.stiffness) if silent else None
    together = ParameterUncertainty(which, np.full((1, len(which)), usual.stiffness))
    camera = scene.cameras[0] if scene.cameras else None
    unscaled = camera is not None and not camera.n_calibration and camera.scale_sd is None
    if camera is not None and unscaled:
        camera = replace(camera, scale_sd=usual.scale)
    calibration = None if camera is None else camera.calibration_error
    cov = StaticBalance(tissue, each, calibration if unscaled else None).target_cov(scene.measured_nodes)
    return StaticBalance(tissue, together if silent else scene.uncertainty, calibration), cov
