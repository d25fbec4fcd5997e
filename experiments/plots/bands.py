"""Coloured bands for periods of a condition, drawn by one artist for each condition."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeVar

import numpy as np
from matplotlib.axes import Axes

from estimators import Advice, Status
from experiments.arrays import Floats
from experiments.plots.style import BLACK, GREY, VERMILLION

STATUS_COLOURS = {Status.COASTING: GREY, Status.LOST: BLACK, Status.DIVERGED: VERMILLION}
"""Colours of the statuses of frames whose estimate is not based on consistent marks."""

FAINT = 0.25
"""Opacity of a band behind curves."""

K = TypeVar("K", Status, Advice)


def spans_of(times_s: Floats, held: Sequence[bool]) -> list[tuple[float, float]]:
    """Start and length [s] of each run of frames in which `held` is true, extended half-way to the adjacent frames."""
    if len(times_s) < 2:
        return []
    edges = np.concatenate([times_s[:1], 0.5 * (times_s[1:] + times_s[:-1]), times_s[-1:]])
    during = np.concatenate([[False], np.asarray(held, dtype=bool), [False]])
    starts, ends = np.flatnonzero(during[1:] & ~during[:-1]), np.flatnonzero(~during[1:] & during[:-1])
    return list(zip(edges[starts].tolist(), (edges[ends] - edges[starts]).tolist(), strict=True))


def draw_bands(ax: Axes, times_s: Floats, kinds: Sequence[K], colours: Mapping[K, str]) -> None:
    """Colour the background by the kind of each frame: bands of full height for each kind with a colour.

    The label of a band is its kind.
    """
    for kind, colour in colours.items():
        spans = spans_of(times_s, [one == kind for one in kinds])
        if spans:
            label = str(kind).replace("_", " ")
            whole = ax.get_xaxis_transform()
            ax.broken_barh(spans, (0.0, 1.0), facecolors=colour, alpha=FAINT, lw=0, transform=whole, label=label)
