"""What holds of every picture of the house: sizes of print, type, units, nothing empty, nothing cut off."""

import re

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text

UNIT = re.compile(r"\[[^\]]+\]$")


def check_printed(figure: Figure, *, without_units: tuple[str, ...] = ()) -> None:
    """Assert it: 85 or 170 mm wide, type of 6 pt or more within the picture, units, data in each of the axes.

    without_units: labels of axes of names
    """
    width_mm = 25.4 * figure.get_size_inches()[0]
    assert round(width_mm, 3) in (85.0, 170.0)
    figure.draw_without_rendering()
    width, height = figure.bbox.size
    for text in words_of(figure):
        assert text.get_fontsize() >= 6.0, text.get_text()
        box = text.get_window_extent()
        inside = box.x0 >= -1.0 and box.y0 >= -1.0 and box.x1 <= width + 1.0 and box.y1 <= height + 1.0
        assert inside, f"cut off: {text.get_text()}"
    for ax in figure.axes:
        assert has_data(ax), f"empty: {ax.get_title(loc='left')} {ax.get_ylabel()}"
        for label in (ax.get_xlabel(), ax.get_ylabel()):
            assert not label or label in without_units or UNIT.search(label), label


def labels(figure: Figure) -> list[str]:
    """The words of its legend."""
    return [text.get_text() for text in figure.legends[0].get_texts()]


def words_of(figure: Figure) -> list[Text]:
    """All words that can be seen, of ticks those within the limits: matplotlib draws no others."""
    ticked, shown = set(), set()
    for ax in figure.findobj(Axes):
        for axis in (ax.xaxis, ax.yaxis):
            ticked |= {label for tick in (*axis.majorTicks, *axis.minorTicks) for label in (tick.label1, tick.label2)}
            low, high = sorted(axis.get_view_interval())
            inside = [tick for tick in axis.get_major_ticks() if ax.axison and low <= tick.get_loc() <= high]
            shown |= {tick.label1 for tick in inside if tick.label1.get_visible()}
    words = [text for text in figure.findobj(Text) if text not in ticked or text in shown]
    return [text for text in words if text.get_visible() and text.get_text().strip()]


def has_data(ax: Axes) -> bool:
    """Whether there is a point of a line, a patch, an image or a collection within the limits of the axes, or words."""
    if not ax.axison:
        return bool(ax.texts)
    (left, right), (low, high) = sorted(ax.get_xlim()), sorted(ax.get_ylim())
    places = [
        np.column_stack(line.get_data()).astype(float) for line in ax.lines if line.get_transform() == ax.transData
    ]
    for patch in ax.patches:
        places.append((patch.get_transform() - ax.transData).transform(patch.get_path().vertices))
    for collection in ax.collections:
        places += [path.vertices for path in collection.get_paths()]
        places.append(np.ma.filled(np.asarray(collection.get_offsets(), dtype=float), np.nan))
    for points in places:
        x, y = points.T
        if ((x >= left) & (x <= right) & (y >= low) & (y <= high)).any():
            return True
    return bool(ax.images) or ax.get_label() == "<colorbar>"
