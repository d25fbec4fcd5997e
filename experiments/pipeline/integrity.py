"""Integrity of estimates for guidance: contradictions between marks and model, and errors that marks cannot reveal.

The mathematics is in `estimators.consistency`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynamics import ParameterUncertainty, independent_uncertainty, parameter_forces, parameters
from estimators import (
    Contradiction,
    ContradictionSettings,
    ErrorSource,
    MarkMeasurement,
    StaticBalance,
    StaticResponse,
    TargetEstimate,
    TissueFilter,
)
from experiments.arrays import Floats
from experiments.formats.scene.scene import Scene
from experiments.pipeline.events import rest_is_known
from experiments.pipeline.sight.space import calibration_shifts

MOST = 0.9
"""The sources of error that a message names cause at least this share [1] of the target's variance."""

SEEN = "marks and disturbances"
"""Name of the part of the target's variance due to noise of the marks and to disturbances (unknown forces)."""


@dataclass(frozen=True, slots=True)
class UsualUncertainty:
    """Default standard deviations of errors whose size the scene does not state.

    stiffness, mass: relative error [1] of each spring's stiffness, of each node's mass; errors are independent; choice
    scale: relative error [1] of a camera's millimetres per pixel; choice: errors above twice this are implausible
    position_m: error of the target's position in the tissue on each axis [m]; choice: the error if the target was
    located in another image, which was then registered
    drift_m: drift of a camera or tracker without reference marks, on each axis [m]; choice
    """

    stiffness: float = 0.3
    mass: float = 0.3
    scale: float = 0.025
    position_m: float = 3e-3
    drift_m: float = 1e-3


USUAL = UsualUncertainty()


def balance_of(scene: Scene, tissue: TissueFilter) -> StaticBalance:
    """Static balance of the forces on the body. Errors whose size the scene does not state get default sizes.

    By default all springs share one stiffness error. With independent errors, a cut spring could not be detected.
    """
    which = parameters(scene.network, ("stiffness",))
    together = ParameterUncertainty(which, np.full((1, len(which)), USUAL.stiffness))
    uncertainty = together if scene.uncertainty is None else scene.uncertainty
    return StaticBalance(tissue, uncertainty, _calibration_error(scene))


def _calibration_error(scene: Scene) -> Callable[[Floats], Floats] | None:
    """Function from positions of marks to their shifts by one sd of each calibration error; None without a camera."""
    if scene.space_cameras:
        if not _is_unscaled(scene):
            return calibration_shifts(scene)
        middle = scene.network.positions.mean(axis=0)
        return lambda places: USUAL.scale * (places.reshape(-1, 3) - middle)[:, :, None]
    if not scene.cameras:
        return None
    camera = scene.cameras[0]
    return (replace(camera, scale_sd=USUAL.scale) if _is_unscaled(scene) else camera).calibration_error


def error_budget(scene: Scene, tissue: TissueFilter) -> tuple[ErrorSource, ...]:
    """Sources of the target's error that cannot be detected from the marks.

    The filter's covariance includes such an error if the scene states its size. The keys are `[uncertainty]` for
    constants, `scale_sd` or `uncertainty` for a camera, and `position_sd_mm` for the target's position.
    """
    network, nodes = scene.network, scene.measured_nodes
    at_rest = StaticResponse(tissue, nodes)
    stated, dim = scene.uncertainty, network.dim
    found = []
    uncertainty = stated or independent_uncertainty(parameters(network, ("stiffness",)), USUAL.stiffness)
    own = parameter_forces(network, uncertainty.parameters, at_rest.rest, np.zeros_like(at_rest.rest))
    constants = at_rest.to_forces(own.T @ uncertainty.directions.T)
    found.append(_source("constants", constants, stated=stated is not None))
    if stated is None:
        weights = np.zeros((len(network.free), dim, len(network.free)))
        weights[range(len(network.free)), :, range(len(network.free))] = np.outer(
            network.masses[network.free], tissue.network.gravity
        )
        masses = USUAL.mass * at_rest.to_forces(weights.reshape(-1, len(network.free)))
        found.append(_source("masses", masses, stated=False))
    if (calibration_error := _calibration_error(scene)) is not None:
        places = at_rest.rest[[network.index(node) for node in nodes]]
        shifts = calibration_error(places).reshape(len(nodes) * dim, -1)
        found.append(_source("the camera's calibration", at_rest.to_marks(shifts), stated=not _is_unscaled(scene)))
    if not scene.reference.marks:  # reference marks reveal the drift
        drift_m = scene.reference.drift_sd_m
        alike = np.tile((USUAL.drift_m if drift_m is None else drift_m) * np.eye(dim), (len(nodes), 1))
        name = "drift of the camera" if drift_m is not None else "drift of the camera (default)"
        found.append(ErrorSource.of(name, at_rest.to_marks(alike), considered=False))
    sd_m = scene.target.position_sd_m
    place = (USUAL.position_m if sd_m is None else sd_m) * np.eye(dim)
    found.append(_source("the target's position in the tissue", place, stated=sd_m is not None))
    if not rest_is_known(scene):  # changes by identification count as errors of constants
        sag = tissue.target.position(at_rest.rest[network.free].ravel()) - tissue.target.position(
            network.positions[network.free].ravel()
        )
        found.append(ErrorSource.of("rest elsewhere than drawn", np.linalg.norm(sag) * np.eye(dim), considered=False))
    return tuple(found)


def _source(name: str, directions: Floats, *, stated: bool) -> ErrorSource:
    return ErrorSource.of(name if stated else f"{name} (default)", directions, considered=stated)


def unstated(budget: Sequence[ErrorSource]) -> Floats:
    """Covariance of the target's errors that the filter's covariance does not include [m²], (dim, dim)."""
    return np.asarray(sum(one.cov for one in budget if not one.considered))


def target_variances(budget: Sequence[ErrorSource], estimate: TargetEstimate) -> dict[str, float]:
    """Variance of the target by each source of error, summed over all axes [m²]; empty if there is no covariance.

    Some of these errors are not included in the covariance of `estimate`.
    """
    if estimate.cov is None or not np.isfinite(estimate.cov).all():
        return {}
    reported, considered = float(np.trace(estimate.cov)), sum(one.variance for one in budget if one.considered)
    known = min(reported / considered, 1.0) if considered else 1.0  # fixes may have reduced the stated errors
    found = {one.name: one.variance * (known if one.considered else 1.0) for one in budget}
    found[SEEN] = reported - known * considered
    return found


def variance_shares(budget: Sequence[ErrorSource], estimate: TargetEstimate) -> dict[str, float]:
    """Share [1] of the target's variance that each source of error causes, largest first; see `target_variances`."""
    found = target_variances(budget, estimate)
    whole = sum(found.values()) or 1.0
    return {name: found[name] / whole for name in sorted(found, key=lambda name: -found[name])}


def shares_words(shares: Mapping[str, float]) -> str:
    """Text that names the largest sources of the target's variance. Together they cause at least the share `MOST`."""
    named, together = [], 0.0
    for name, share in shares.items():
        named.append(f"{name} {100.0 * share:.0f} %")
        together += share
        if together >= MOST:
            break
    return ", ".join(named)


def _is_unscaled(scene: Scene) -> bool:
    """Whether the scene has cameras, none of which has a stated calibration error."""
    if scene.space_cameras:
        return not any(len(one.calibration) for one in scene.space_cameras)
    camera = scene.cameras[0] if scene.cameras else None
    return camera is not None and not camera.n_calibration and camera.scale_sd is None


MEANS = 2.0
"""Time from the first marks to the start of guidance, as a multiple of the averaging time of the force balance [1]."""

UNTESTED = "the forces on the marks have not been observed long enough to test them"


UNEVEN = "pictures come too unevenly to determine exposure times"


class IntegrityMonitor:
    """Checks in each frame whether the filter's estimate may be used for guidance.

    budget: sources of the target's error; tested_s: earliest time of guidance [s], None before the first marks
    unstated: covariance of the target's errors that the filter's covariance leaves out [m²], (dim, dim)
    """

    def __init__(self, scene: Scene, tissue: TissueFilter) -> None:
        self.budget = error_budget(scene, tissue)
        self.unstated = unstated(self.budget)
        # if an outside force pulls the body along, all marks move together without a contradiction
        settings = ContradictionSettings(together=0.0) if tissue.may_be_led else ContradictionSettings()
        self.contradiction = Contradiction(settings)
        self._balance = balance_of(scene, tissue)
        self.tested_s: float | None = None
        self._late_s, self._known_late_s, self._uneven = 0.0, 0.0, False

    def take(self, estimate: TargetEstimate, marks: Sequence[MarkMeasurement]) -> str | None:
        """Update with a frame's estimate and its marks; returns the reason to withhold guidance, or None.

        Only the balance of forces reveals a cut spring. Therefore guidance is withheld after the first marks until the
        balance is accurate, as `MEANS` states.
        """
        self.contradiction.update(estimate, self._balance.update(estimate.time_s, marks))
        if marks and self.tested_s is None:
            self.tested_s = estimate.time_s + MEANS * self._balance.mean_s
        is_tested = self.tested_s is not None and estimate.time_s >= self.tested_s
        return self.contradiction.reason or (None if is_tested else UNTESTED)

    def widened(self, estimate: TargetEstimate) -> TargetEstimate:
        """The estimate with a larger covariance, which includes the errors that the filter's covariance leaves out."""
        return estimate if estimate.cov is None else replace(estimate, cov=estimate.cov + self.unstated)

    def restart(self) -> None:
        """Start the test of the balance of forces again, because the filter restarts."""
        self._balance.forget()
        self.tested_s = None

    def looked(self) -> None:
        """Clear the contradiction and accept the present delay of pictures, because a person has checked both."""
        self.contradiction.forget()
        self._known_late_s = self._late_s

    def dated(self, late_s: float, *, uneven: bool) -> bool:
        """Set the largest delay of pictures [s], and whether they come unevenly; returns whether a value changed."""
        if (late_s, uneven) == (self._late_s, self._uneven):
            return False
        self._late_s, self._uneven = late_s, uneven
        self._known_late_s = min(self._known_late_s, late_s)
        return True

    @property
    def fault(self) -> str | None:
        """Reason to withhold guidance even if the newest estimate is good; None if there is no reason."""
        if self.contradiction.reason:
            return self.contradiction.reason
        if self._late_s > self._known_late_s:
            return f"pictures may be {self._late_s:.1f} s late since a pause: look at the picture, then reset"
        return UNEVEN if self._uneven else None
