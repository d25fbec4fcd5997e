"""What marks show of the model's own error, which springs do not say: a check of the belief, and a second opinion.

Of a stiff or large body springs are a rough model, and where hidden nodes are depends on what the model leaves out.
Marks show two things of that. Their innovations may exceed what the filter predicts: then so do the errors of what is
not seen. And they show how the body is bent: a smooth field through their displacements, which knows no forces, errs by
other causes than the springs do, so that the two together err less than each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynamics import MassSpringNetwork, material_coordinates, reaches
from estimators.arrays import Floats
from estimators.filters.gaussian_process import Field, matern
from estimators.filters.mixture import InteractingMixture
from estimators.process.linear_motion import is_linearised
from estimators.process.process_model import TissueModel
from estimators.process.target import TargetMap
from estimators.tissue.estimate import MarkMeasurement
from estimators.tissue.gate import Gated
from estimators.tissue.settings import FilterSettings

FLAT = 1e-3
"""A body is flat in a direction in which it extends by less than this share of its size as drawn; numerical."""

NEWTON = 12
"""Newton steps to the likeliest scale of the field, at most; numerical."""

ROUNDING = 1e-3
"""Information that is added to that of a scale which the field's share of a distance does not tell [1]; numerical."""


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
    filter_scale, field_scale: factors on the covariances of filter and field by which the distance of the filter's
        hidden nodes from the field is explained, the filter's by up to the inflation, then the field's [1]
    means, covs: of the field at the free nodes by the last marks [m], (n_free, dim), and the covariance of each of its
        axes [m²], (n_free, n_free); None where the last marks tell of none
    """

    inflation: float = 1.0
    filter_scale: float = 1.0
    field_scale: float = 1.0
    means: Floats | None = None
    covs: Floats | None = None


def likeliest_scale(distances: Floats, cov: Floats, beside: Floats, most: float) -> float:
    """Factor on covariances, 1 to most, that with those beside them best explains distances, by Newton's method.

    distances (k, dim), cov and beside (k, dim, dim)
    """
    scale = 1.0
    for _ in range(NEWTON):
        scaled = scale * cov
        S = beside + scaled
        share, weighed = np.linalg.solve(S, scaled), np.linalg.solve(S, distances[..., None])
        # score and information of the logarithm of the scale
        score = 0.5 * (float((weighed.swapaxes(1, 2) @ scaled @ weighed).sum()) - float(np.einsum("kii->", share)))
        information = 0.5 * float(np.einsum("kij,kji->", share, share)) + ROUNDING * distances.size
        step = float(np.clip(score / information, -1.0, 1.0))
        scale = min(max(1.0, scale * float(np.exp(step))), most)
        if abs(step) < ROUNDING:
            break
    return scale


class ModelError:
    """The model's error of a stiff or large body, as its marks show it; of others none is looked for.

    is_looked_for: whether the body is stiff or large
    State: shown. Whoever holds one sets `shown` back where a frame failed.
    """

    def __init__(self, model: TissueModel, settings: FilterSettings) -> None:
        self.shown, self.is_looked_for = Shown(), is_linearised(model)
        network = model.network
        self._network, self._settings = network, settings
        self._field = displacement_field(network, settings.smooth) if self.is_looked_for else None
        self._anchors = np.flatnonzero(network.fixed).tolist()
        self._reach = reaches(network)[network.free]

    def passed(self) -> None:
        """Time has passed: the field is of marks that were."""
        self.shown = replace(self.shown, means=None, covs=None)

    def start(self, gated: Gated) -> None:
        """Take in what the gate of a start made of its marks: while it believes none, the body may be anywhere."""
        if gated.rejected and not gated.accepted:
            self.shown = replace(self.shown, inflation=self._settings.test_sigmas**2)

    def learn(
        self, marks: Sequence[MarkMeasurement], mixture: InteractingMixture, dt: float, nis: float | None
    ) -> None:
        """Take in marks that the mixture has taken in, dt [s] after the last.

        nis: of their innovation, by the moments of the whole mixture; None of a start, which predicts nothing
        """
        if self._field is None:
            return
        share = -np.expm1(-dt / self._settings.remember_s)
        inflation = 1.0 if nis is None else self.shown.inflation
        if nis is not None:
            ratio = min(nis / (len(marks) * self._network.dim), self._settings.test_sigmas**2)
            inflation = max(1.0, ratio, inflation + share * (ratio - inflation))
        scales, found = (self.shown.filter_scale, self.shown.field_scale), self._through(self._field, marks)
        if found is not None:
            now = self._likeliest_scales(mixture, {mark.node for mark in marks}, *found, inflation)
            scales = (scales[0] + share * (now[0] - scales[0]), scales[1] ** (1.0 - share) * now[1] ** share)
        self.shown = Shown(inflation, *scales, *(found or (None, None)))

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

    def _likeliest_scales(
        self, mixture: InteractingMixture, marked: set[str], means: Floats, covs: Floats, inflation: float
    ) -> tuple[float, float]:
        """Factors on the covariances of filter and field that best explain where the filter has the hidden nodes.

        What innovations license is the filter's own error first, up to the inflation; the rest is the field's.
        """
        network, dim = self._network, self._network.dim
        hidden = [k for k, node in enumerate(network.free) if network.names[node] not in marked]
        if not hidden:
            return self.shown.filter_scale, self.shown.field_scale
        rows = np.array(hidden)[:, None] * dim + np.arange(dim)
        distance = mixture.x[rows] - means[hidden]
        own = mixture.P[rows[:, :, None], rows[:, None, :]]
        field = np.maximum(np.diag(covs)[hidden], 0.0)[:, None, None] * np.eye(dim)
        of_filter = likeliest_scale(distance, own, field, inflation)
        return of_filter, likeliest_scale(distance, field, of_filter * own, np.inf)

    def of_target(self, target: TargetMap) -> tuple[Floats, Floats]:
        """Where the field has the target [m], (dim,), and the covariance of that [m²], (dim, dim).

        Without a field, of no dimension.
        """
        shown, dim = self.shown, self._network.dim
        if shown.means is None or shown.covs is None:
            return np.zeros(0), np.zeros((0, 0))
        nodes = target.matrix.reshape(dim, -1, dim)
        cov = self._settings.in_common * shown.field_scale * np.einsum("anb,nm,cmb->ac", nodes, shown.covs, nodes)
        return target.position(shown.means.ravel()), cov

    def factors(self, target: TargetMap, cov: Floats) -> tuple[float, float]:
        """The inflation of a target's covariance [m²], (dim, dim), which does not take it beyond the body's reach.

        And how far the filter's place is trusted beside that where it is weighed against the field's: `corrected_each`.
        """
        dim = self._network.dim
        weights = np.abs(target.matrix[0].reshape(-1, dim)[:, 0])
        farthest = float(weights @ self._reach) ** 2 / (dim + 2)
        factor = max(1.0, min(self.shown.inflation, farthest / float(np.linalg.eigvalsh(cov)[-1])))
        return factor, max(1.0, factor / self.shown.filter_scale)
