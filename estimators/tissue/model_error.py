"""What marks show of the model's own error, which springs do not say: a check of the belief, and two other opinions.

Of a stiff or large body springs are a rough model, and where hidden nodes are depends on what the model leaves out.
Marks show two things of that. Their innovations may exceed what the filter predicts: then so do the errors of what is
not seen. And they allow other estimates of the same places. A smooth field through their displacements knows no forces,
and errs by other causes than the springs do. A simulation in which the seen nodes are led along their marks, the
paper's open loop, has the springs but no memory of what a restart of the filter changed, and needs no forces to explain
how marks move. The three together err less than each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynamics import ImplicitStepper, MassSpringNetwork, material_coordinates, pack, unpack
from estimators.arrays import Floats
from estimators.filters.gaussian_process import Field, matern
from estimators.filters.mixture import InteractingMixture
from estimators.filters.opinions import Scales, likeliest_scales
from estimators.process.led import Simulated, led_along
from estimators.process.linear_motion import is_linearised
from estimators.process.process_model import TissueModel
from estimators.process.target import TargetMap
from estimators.tissue.estimate import MarkMeasurement, Status
from estimators.tissue.gate import Gated
from estimators.tissue.health import largest_ratio
from estimators.tissue.model import undecided
from estimators.tissue.settings import FilterSettings

FLAT = 1e-3
"""A body is flat in a direction in which it extends by less than this share of its size as drawn; numerical."""

UNDIRECTED = 0.3
"""A covariance that is all of an inflation, which tells of no direction, goes even by this share [1]; choice."""

CHANCE_SIGMAS = 5.0
"""Standard deviations of a normal variable beyond which a NIS is none by chance; numerical: a frame in four million."""


def displacement_field(network: MassSpringNetwork, smooth: float) -> Field:
    """The field of displacements from the drawn shape, at all nodes.

    Smooth over this share [1] of the body's extent in material coordinates; that the whole body is turned, moved or
    strained is its trend.
    """
    places = material_coordinates(network)
    extent = float(np.linalg.norm(np.ptp(places, axis=0)))
    distances = np.linalg.norm(places[:, None] - places, axis=2) / (smooth * extent)
    centred = network.positions - network.positions.mean(axis=0)
    _, extents, axes = np.linalg.svd(centred, full_matrices=False)
    kept = axes[extents > FLAT * extents[0]]
    return Field(matern(distances), np.column_stack([np.ones(len(places)), centred @ kept.T / extent]))


@dataclass(frozen=True, slots=True, eq=False)
class Shown:
    """What the marks until now have shown of the model's error.

    inflation: factor on the filter's covariances, from 1 to the square of test_sigmas: NIS by its degrees of freedom,
        which rises at once and is forgotten in remember_s [1]. Source: [mehra1970]
    scales: factors on the errors of filter, simulation and field by which the distances between their hidden nodes are
        explained, remembered as the inflation is; None before the first
    means, covs: of the field at the free nodes by the last marks [m], (n_free, dim), and the covariance of each of its
        axes [m²], (n_free, n_free); None where the last marks tell of none
    led: the simulation at the last marks; None where these told of no field
    unseen_s: since the last marks [s]
    refuted: whether the inflation is beyond refuting_inflation, and beyond chance
    """

    inflation: float = 1.0
    scales: Scales | None = None
    means: Floats | None = None
    covs: Floats | None = None
    led: Simulated | None = None
    unseen_s: float = 0.0
    refuted: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Opinions:
    """What is reported of a target beside the filter's belief.

    ahead: by how much the simulation's state is ahead of the filter's [m, m/s], (dim_x,), nought beyond the network's;
        share: of that the filter's is moved [1]
    factor: on the filter's covariance [1]; trust: as in `corrected_each`, against the field
    place, cov: of the target by the field [m], (dim,), [m²], (dim, dim); without one of no dimension
    """

    ahead: Floats
    share: float
    factor: float
    trust: float
    place: Floats
    cov: Floats


class ModelError:
    """The model's error of a stiff or large body, as its marks show it; of others none is looked for.

    A target that is `undecided` may be anywhere, whatever its marks show.
    is_looked_for: whether the body is stiff or large, or leaves nodes undecided
    State: shown. Whoever holds one sets `shown` back where a frame failed.
    """

    def __init__(self, model: TissueModel, settings: FilterSettings, marked: Sequence[str]) -> None:
        network = model.network
        self._undecided = np.repeat(undecided(network, marked)[network.free], network.dim)
        self.shown, self.is_looked_for = Shown(), is_linearised(model) or bool(self._undecided.any())
        self._network, self._settings = network, settings
        self._field = displacement_field(network, settings.smooth) if self.is_looked_for else None
        self._stepper = ImplicitStepper(network)
        self._anchors = np.flatnonzero(network.fixed).tolist()

    def passed(self, dt: float) -> None:
        """Time has passed, dt [s]: the field is of marks that were."""
        self.shown = replace(self.shown, means=None, covs=None, unseen_s=self.shown.unseen_s + dt)

    def start(self, gated: Gated) -> None:
        """Take in what the gate of a start made of its marks: while it believes none, the body may be anywhere."""
        if gated.rejected and not gated.accepted:
            self.shown = replace(self.shown, inflation=self._settings.test_sigmas**2)

    def status(self, of_health: Status, target: TargetMap) -> Status:
        """As the health has it, but not TRACKING while marks lie far further off than the model predicts.

        Nor where they leave the target undecided.
        """
        doubtful = self.shown.refuted or self._is_undecided(target)
        return Status.INITIALISING if of_health is Status.TRACKING and doubtful else of_health

    def _is_undecided(self, target: TargetMap) -> bool:
        return bool(target.matrix[:, self._undecided].any())

    def learn(self, marks: Sequence[MarkMeasurement], mixture: InteractingMixture, nis: float | None) -> None:
        """Take in marks that the mixture has taken in.

        nis: of their innovation, by the moments of the whole mixture; None of a start, which predicts nothing
        """
        if self._field is None:
            return
        before, settings = self.shown, self._settings
        share = -np.expm1(-before.unseen_s / settings.remember_s)
        inflation = 1.0
        if nis is not None:
            ratio = min(nis / (len(marks) * self._network.dim), settings.test_sigmas**2)
            inflation = max(1.0, ratio, before.inflation + share * (ratio - before.inflation))
        by_chance = largest_ratio(len(marks) * self._network.dim, CHANCE_SIGMAS)
        refuted = inflation > max(settings.refuting_inflation, by_chance)
        found = self._through(self._field, marks)
        if found is None:
            self.shown = Shown(inflation, before.scales, refuted=refuted)
            return
        led = self._led(marks, mixture, begins=nis is None)
        scales = self._scales(mixture, marks, *found, (led, inflation))
        if scales is not None and before.scales is not None:
            scales = scales.remembered(before.scales, share)
        if scales is not None and scales.second > settings.test_sigmas**2:
            led = self._begun(marks, mixture)
        self.shown = Shown(inflation, scales or before.scales, *found, led, refuted=refuted)

    def _led(self, marks: Sequence[MarkMeasurement], mixture: InteractingMixture, *, begins: bool) -> Simulated:
        """The simulation at these marks; it begins with what the filter believes, and again where it lost the marks."""
        before = self.shown
        if begins or before.led is None or before.unseen_s > self._settings.lost_s:
            return self._begun(marks, mixture)
        moved = led_along(self._stepper, before.led, before.unseen_s, self._places(marks))
        return moved if np.isfinite(moved.positions).all() else self._begun(marks, mixture)

    def _begun(self, marks: Sequence[MarkMeasurement], mixture: InteractingMixture) -> Simulated:
        network = self._network
        positions, velocities = network.positions.copy(), np.zeros_like(network.positions)
        positions[network.free], velocities[network.free] = unpack(mixture.x[: network.n_state], network.dim)
        return led_along(self._stepper, Simulated(positions, velocities), 0.0, self._places(marks))

    def _places(self, marks: Sequence[MarkMeasurement]) -> dict[int, Floats]:
        return {self._network.index(mark.node): mark.position for mark in marks}

    def _through(self, field: Field, marks: Sequence[MarkMeasurement]) -> tuple[Floats, Floats] | None:
        """Mean [m], (n_free, dim), and covariance of each axis [m²], (n_free, n_free), of the field by these marks."""
        network = self._network
        seen = [network.index(mark.node) for mark in marks]
        moved = np.array([mark.position for mark in marks]) - network.positions[seen]
        values = np.vstack([np.zeros((len(self._anchors), network.dim)), moved])
        variances = [float(np.trace(mark.total_cov)) / network.dim for mark in marks]
        noise = np.r_[np.zeros(len(self._anchors)), variances]
        found = field.through([*self._anchors, *seen], values, noise)
        if found is None:
            return None
        mean, cov = found
        return network.positions[network.free] + mean[network.free], cov[np.ix_(network.free, network.free)]

    def _scales(
        self,
        mixture: InteractingMixture,
        marks: Sequence[MarkMeasurement],
        means: Floats,
        covs: Floats,
        beside: tuple[Simulated, float],
    ) -> Scales | None:
        """Factors on the errors of filter, simulation and field that best explain where they have the hidden nodes.

        The filter's is no more than what its innovations license. The simulation's is less than 1 where these refute
        the filter, whose covariance is then one of restarts, of which the simulation knows nothing. That of the field
        was found from the coordinates of its marks. None where no node is hidden.
        beside: the simulation, and the filter's inflation
        """
        network, dim, (led, inflation) = self._network, self._network.dim, beside
        marked = {mark.node for mark in marks}
        hidden = [k for k, node in enumerate(network.free) if network.names[node] not in marked]
        if not hidden:
            return None
        rows = np.array(hidden)[:, None] * dim + np.arange(dim)
        own = mixture.P[rows[:, :, None], rows[:, None, :]]
        field = np.maximum(np.diag(covs)[hidden], 0.0)[:, None, None] * np.eye(dim)
        apart = mixture.x[rows] - means[hidden], led.positions[network.free][hidden] - means[hidden]
        least = min(1.0, self._settings.led_inflation / inflation)
        return likeliest_scales(apart, own, field, most=inflation, least=least, known=0.5 * len(marks) * dim)

    def of_field(self, target: TargetMap) -> tuple[Floats, Floats]:
        """Where the field has the target [m], (dim,), and the covariance of that [m²], (dim, dim).

        Without a field, of no dimension.
        """
        shown, dim = self.shown, self._network.dim
        if shown.means is None or shown.covs is None:
            return np.zeros(0), np.zeros((0, 0))
        nodes = target.matrix.reshape(dim, -1, dim)
        scale = 1.0 if shown.scales is None else shown.scales.third
        cov = scale * np.einsum("anb,nm,cmb->ac", nodes, shown.covs, nodes)
        return target.position(shown.means.ravel()), cov

    def of_target(self, target: TargetMap, x: Floats, P: Floats) -> Opinions:
        """What is reported of a target beside the belief of the whole mixture, mean (dim_x,), cov (dim_x, dim_x).

        Neither inflation nor how far the opinions lie apart takes the target beyond the body's reach.
        """
        shown, settings, farthest = self.shown, self._settings, target.reached_m2
        place, cov = self.of_field(target)
        ahead, share, inflation, of_mean = np.zeros(len(x)), 0.0, shown.inflation, 1.0
        if shown.scales is not None:
            of_mean = shown.scales.first
        if shown.scales is not None and shown.means is not None and shown.led is not None:
            free, n = self._network.free, self._network.n_state
            ahead[:n] = pack(shown.led.positions[free], shown.led.velocities[free]) - x[:n]
            scales = replace(shown.scales, first=min(of_mean, inflation))
            share, of_mean = scales.share_of_second, scales.of_mean
            simulated = min(inflation, settings.led_inflation * max(1.0, scales.second))
            # the errors of both may be the same
            inflation = ((1.0 - share) * np.sqrt(inflation) + share * np.sqrt(simulated)) ** 2
            apart = float((target.linear(ahead[:, None]) ** 2).sum())
            share = _share_within(share, 0.5 * farthest / apart) if apart > 0.0 else share
            farthest -= share * (1.0 - share) * apart
        inflation = np.inf if self._is_undecided(target) else inflation
        most = farthest / float(np.linalg.eigvalsh(target.cov(P))[-1])
        factor = max(1.0, min(inflation, most))
        return Opinions(ahead, share, factor, max(1.0, factor / of_mean), place, cov)


def _share_within(share: float, most: float) -> float:
    """The share, 0 to 1, or the nearest of its half at which share (1 - share) is no more than this [1]."""
    least = 0.5 * (1.0 - np.sqrt(max(0.0, 1.0 - 4.0 * most)))
    return float(min(share, least) if share < 0.5 else max(share, 1.0 - least))
