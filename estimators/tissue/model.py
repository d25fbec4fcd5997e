"""The process model that a filter's settings ask for, by how stiff and how large the tissue is."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from dynamics import MassSpringNetwork, ParameterUncertainty, rest_shape, stiffness_matrix, strain_uncertainty
from estimators.process.linear_motion import GRAVITY, is_linearised
from estimators.process.process_model import ForceMode, TissueModel
from estimators.tissue.settings import FilterSettings

STIFFEST = 3.0
"""Stiffness of a link by that which the weight of the whole body stretches by `strain_sd` [1]; choice, its cost in
docs/settings.md."""

STIFF = 10.0
"""Stiffness of a link that keeps its length, by that length and the weight of the body, which stretches it by a tenth
then [1]; choice: three links that it stretches by 4 % were TRACKING in the wrong shape in 95 of 1,600 frames."""

ROUNDING = 1e-9
"""Stiffness by the largest that is rounding's, of a body that nothing holds [1]; numerical."""

MOST_STATES = 600
"""Coordinates and velocities of free nodes, 100 nodes in space, beyond which a frame takes a third of a second and
more, about as their cube, and making the filter a second; measured on one core; the commands refuse more."""

SHORTEST_M = 1e-9
"""Of a link, so that none divides by nothing [m]; numerical."""


def model_of(
    network: MassSpringNetwork,
    marked: Sequence[str],
    settings: FilterSettings,
    *,
    uncertainty: ParameterUncertainty | None,
    n_calibration: int,
    offset_sd_m: float = 0.0,
) -> tuple[TissueModel, FilterSettings]:
    """The model of a network with these marked nodes, and the settings for it.

    Of a stiff or large body constants are off by a strain beside what is known of them, and links no stiffer than that
    lets them be; hidden nodes are poked, too, and any node may be led where the settings name none that are.
    offset_sd_m: of the error of the target's offset [m]
    Raises ValueError for settings that do not fit the marked nodes.
    """
    if network.n_state > MOST_STATES:
        warnings.warn(
            f"a filter of {len(network.free)} free nodes takes seconds for a frame: the time grows as their cube",
            stacklevel=3,
        )
    if settings.one_of not in (0, len(marked)):
        raise ValueError(f"settings one_of: expected 0 or {len(marked)} marked nodes, found {settings.one_of}")
    model_with = partial(
        TissueModel, marked=marked, bias=settings.fix_bias, offset_sd_m=offset_sd_m, n_calibration=n_calibration
    )
    model = model_with(network, uncertainty=uncertainty, led=_led(settings))
    if not is_linearised(model):
        return model, settings
    if settings.strain_sd > 0.0:
        network = as_stiff_as_known(network, settings.strain_sd)
        strain = strain_uncertainty(network, settings.strain_sd)
        uncertainty = strain if uncertainty is None else uncertainty.beside(strain)
    slowest, restoring = slowest_oscillation(network)
    settings = settings.for_stiff_or_large(restoring, 2.0 * np.pi / slowest if slowest > 0.0 else 0.0)
    hidden_share = settings.hidden_share
    stiff = model_with(network, uncertainty=uncertainty, led=_led(settings), hidden_share=hidden_share, stiff=True)
    return stiff, settings


def _led(settings: FilterSettings) -> tuple[Sequence[str], ForceMode] | None:
    return (settings.led_nodes, settings.leading) if settings.led_nodes else None


def slowest_oscillation(network: MassSpringNetwork) -> tuple[float, float]:
    """Angular frequency w of a network's slowest oscillation about its rest [rad/s], and the acceleration w² L [m/s²].

    L: diagonal of its extent there. With that acceleration it returns when bent by its own length: about the gravity
    that it hangs by for a chain, a cable or a cloth, however stiff its links; for an elastic block Young's modulus by
    its density and length, about. Both 0 where nothing oscillates.
    """
    shape, root = rest_shape(network), np.sqrt(np.repeat(network.masses[network.free], network.dim))
    squared = np.linalg.eigvalsh(stiffness_matrix(network, shape) / np.outer(root, root))
    resisted = squared[squared > ROUNDING * squared[-1]]
    if not len(resisted):
        return 0.0, 0.0
    slowest = float(resisted[0])
    return slowest**0.5, slowest * float(np.linalg.norm(np.ptp(shape, axis=0)))


def as_stiff_as_known(network: MassSpringNetwork, strain_sd: float) -> MassSpringNetwork:
    """The network with links no stiffer than `STIFFEST` weights of the body by this strain [1]; it rests as before.

    A rigid link is one whose length its load does not change by more than is unknown of it anyway. One that is stiffer
    tells no more, and to first order, in which a belief is moved, it does not turn but lengthens: then it pulls nodes
    about with forces that no mark explains.
    """
    weight = float(network.masses[~network.fixed].sum()) * GRAVITY
    stiffest = STIFFEST * weight / (strain_sd * np.maximum(network.rest_lengths, SHORTEST_M))
    if not (network.stiffness > stiffest).any():
        return network
    i, j = network.springs.T
    shape = rest_shape(network)
    lengths = np.linalg.norm(shape[j] - shape[i], axis=1)
    tension = network.stiffness * (lengths - network.rest_lengths)
    # one under more tension than the body weighs keeps half of its length
    stiffest = np.maximum(stiffest, 2.0 * tension / lengths)
    too_stiff = network.stiffness > stiffest
    return replace(
        network,
        stiffness=np.where(too_stiff, stiffest, network.stiffness),
        rest_lengths=np.where(too_stiff, lengths - tension / stiffest, network.rest_lengths),
    )


def undecided(network: MassSpringNetwork, marked: Sequence[str]) -> NDArray[np.bool_]:
    """Which nodes marks and anchors leave on either of two sides, (n_nodes,).

    They are of a part with stiff links whose springs end at as many marked nodes and anchors as there are dimensions: a
    mirror through these changes no length, and forces explain the wrong side for long.
    """
    seen = network.fixed | np.isin(network.names, list(marked))
    a, b = network.springs.T
    inside, n = ~seen[a] & ~seen[b], network.n_nodes
    joined = csr_array((np.ones(int(inside.sum())), (a[inside], b[inside])), shape=(n, n))
    labels = connected_components(joined, directed=False)[1]
    weight = GRAVITY * float(network.masses[~network.fixed].sum())
    stiff = network.stiffness * network.rest_lengths > STIFF * weight
    found = np.zeros(n, dtype=bool)
    for label in np.unique(labels[~seen]):
        own = ~seen & (labels == label)
        springs = own[a] | own[b]
        ends = np.setdiff1d(network.springs[springs], np.flatnonzero(own))
        found |= own & (len(ends) == network.dim and stiff[springs].any())
    return found
