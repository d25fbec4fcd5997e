"""Test whether the first marks lie near the drawn shape. If not, find a reflection, rotation or unit that fits."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import permutations, product

import numpy as np

from experiments.arrays import Floats
from experiments.formats.marks.rows import MarkRow
from experiments.formats.scene.scene import Scene

FAR = 0.15
"""Marks fit if their rms distance from the drawn positions is at most FAR [1] times the body's size; choice: pokes and
weight move marks less, if the body is drawn in its rest shape."""

FITS = 0.1
"""An interpretation of the marks fits if its distance from the drawn positions is at most FITS [1] times the body's
size, and at most a quarter of the distance of the uninterpreted marks; choice."""

ALIKE = 1.5
"""Interpretations up to ALIKE times as far from the drawing as the best one count as equally good; choice."""

FLAT = 0.2
"""Marks count as collinear if the ratio of the second to the first singular value of their centred positions is below
FLAT [1]; choice."""

N_FRAMES = 10
"""Number of frames with marks after which `misread` is applied, even if some marks were never visible; choice."""

LENGTHS_MM = {"m": 1e3, "cm": 10.0, "inches": 25.4, "micrometres": 1e-3}
"""Millimetres per unit, for units that a tracker's file may have instead of millimetres."""


RESIZED = 8.0
"""Largest factor by which tissue may change the spread of its marks [1]; choice: a wrong unit gives ten or more."""


class FirstMarks:
    """Applies the test `misread` once: as soon as every measured mark was visible, at latest after N_FRAMES frames."""

    def __init__(self, scene: Scene) -> None:
        self._scene, self._judged, self._n_frames = scene, False, 0
        self._places: dict[str, Floats] = {}

    def take(self, places: Mapping[str, Floats]) -> str | None:
        """Add a frame's marks. If the test `misread` is due now, return its message; otherwise return None.

        places: positions by node [m], (dim,)
        """
        if self._judged or not places:
            return None
        self._places = {**places, **self._places}
        self._n_frames += 1
        if self._n_frames < N_FRAMES and not {*self._scene.measured_nodes} <= {*self._places}:
            return None
        return self.judge()

    def judge(self) -> str | None:
        """Apply `misread` to all added marks, and return its message. If `misread` was applied before, return None."""
        judged, self._judged = self._judged, True
        return None if judged else misread(self._scene, self._places)


def of_another_size(scene: Scene, seen_m: Mapping[str, Floats]) -> str | None:
    """A message if no deformation of the tissue explains the spread of three or more marks; otherwise None.

    seen_m: positions by node [m], (dim,)
    """
    nodes = [name for name in seen_m if name in scene.network.names]
    if len(nodes) < 3:
        return None
    drawn = scene.network.positions[[scene.network.index(node) for node in nodes]]
    expected, found = (_rms(places - places.mean(axis=0)) for places in (drawn, np.array([seen_m[n] for n in nodes])))
    if expected / RESIZED <= found <= RESIZED * expected:
        return None
    return f"marks: expected a spread of some {1e3 * expected:.3g} mm, found {1e3 * found:.3g} mm"


def first_marks_line(scene: Scene, marks: Iterable[Iterable[MarkRow]]) -> str | None:
    """Message of `FirstMarks` for these frames of marks."""
    first = FirstMarks(scene)
    found = (first.take({mark.node: mark.position_m for mark in frame}) for frame in marks)
    return next((line for line in found if line is not None), None) or first.judge()


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """Marks after the correction of assumed mistakes, for example of a wrong unit.

    words: description of the mistakes; changes: number of mistakes
    places: corrected positions [m], (n, dim)
    """

    words: str
    changes: int
    places: Floats


def misread(scene: Scene, seen_m: Mapping[str, Floats]) -> str | None:
    """A message if marks lie far from their drawn positions, but other axes or units would explain this.

    If more than two interpretations fit equally well, the result is None.
    seen_m: positions by node [m], (dim,)
    """
    network = scene.network
    nodes = [name for name in seen_m if name in network.names]  # without reference marks on the rig
    if len(nodes) < 2:
        return None
    drawn = network.positions[[network.index(node) for node in nodes]]
    seen = np.array([seen_m[node] for node in nodes])
    size, plain = float(np.ptp(network.positions, axis=0).max()), _rms(seen - drawn)
    if plain <= FAR * size:
        return None
    for readings in (_about_the_origin(scene, seen), _moved(scene, seen, drawn)):
        off = [(_rms(one.places - drawn), one) for one in readings]
        best = min((rms for rms, _ in off), default=np.inf)
        if not fits(best, plain, size):
            continue
        good = [one for rms, one in off if rms <= ALIKE * best + 1e-3 * size]
        simplest = [one for one in good if one.changes == min(each.changes for each in good)]
        if len(simplest) > 2:
            return None
        what = ", or with ".join(one.words for one in simplest)
        return (
            f"the first marks lie {1e3 * plain:.3g} mm from the scene's drawing, but would fit within "
            f"{1e3 * best:.3g} mm with {what}; positions are in mm, x right, y up, z toward the camera"
        )
    return None


def fits(rms: float, plain: float, size: float) -> bool:
    """Whether an interpretation of the marks fits the drawn shape.

    rms: root mean square distance of the interpreted marks from the drawn positions [m]
    plain: root mean square distance of the uninterpreted marks from the drawn positions [m]
    size: the body's size [m]
    """
    return rms <= min(FITS * size, 0.25 * plain)


def _rms(apart: Floats) -> float:
    return float(np.sqrt(np.mean(np.sum(apart**2, axis=1))))


def _about_the_origin(scene: Scene, seen: Floats) -> Iterator[Reading]:
    """Interpretations of the marks: with reflected or rotated axes, with other units, and as pixels of the camera."""
    for axes in _axes(seen.shape[1]):
        words, changes = _axes_words(axes)
        if changes:
            yield Reading(words, changes, seen @ axes.T)
        for unit, length_mm in LENGTHS_MM.items():
            of = f"lengths in {unit} instead of mm"
            yield Reading(f"{of}, {words}" if changes else of, changes + 1, length_mm * seen @ axes.T)
    for camera in scene.cameras[:1]:
        if ((seen < 0.0) | (1e3 * seen > camera.size_px)).any():
            continue
        yield Reading(f"the numbers as pixels of camera {camera.name}", 1, camera.to_plane(1e3 * seen))


def _moved(scene: Scene, seen: Floats, drawn: Floats) -> Iterator[Reading]:
    """Interpretations of the marks: for each permutation and reflection of the axes, the best scale and the best shift.

    There is no interpretation if the marks are nearly collinear, or if the body has no anchors.
    """
    spreads = np.linalg.svd(drawn - drawn.mean(axis=0), compute_uv=False)
    if not scene.network.fixed.any() or len(seen) < 3 or spreads[1] < FLAT * spreads[0]:
        return
    about = seen - seen.mean(axis=0)
    for axes in _axes(seen.shape[1]):
        words, changes = _axes_words(axes)
        turned = about @ axes.T
        scale = float(np.sum(turned * drawn) / np.sum(about**2)) if about.any() else 0.0
        if scale <= 0.0 or (not changes and abs(np.log(scale)) < np.log(1.2)):
            continue
        shift = drawn.mean(axis=0) - scale * axes @ seen.mean(axis=0)
        shifted = f"times {scale:.3g}, moved by ({', '.join(f'{1e3 * x:.0f}' for x in shift)}) mm"
        yield Reading(f"{words}, {shifted}" if changes else shifted, changes, scale * seen @ axes.T + shift)


def _axes(dim: int) -> Iterator[Floats]:
    """All matrices that permute and reflect axes, (dim, dim)."""
    for order in permutations(range(dim)):
        for signs in product((1.0, -1.0), repeat=dim):
            axes = np.zeros((dim, dim))
            axes[range(dim), order] = signs
            yield axes


def _axes_words(axes: Floats) -> tuple[str, int]:
    """Description and number of the mistakes that the matrix `axes` corrects."""
    dim, order = len(axes), np.argmax(np.abs(axes), axis=1)
    mirrored = ["xyz"[a] for a in range(dim) if axes[a, order[a]] < 0.0]
    moved = ["xyz"[a] for a in range(dim) if order[a] != a]
    turned = np.linalg.det(axes) > 0.0
    if not moved:
        words = f"{' and '.join(mirrored)} mirrored"
        if turned and mirrored:
            kept = [name for name in "xyz"[:dim] if name not in mirrored]
            words = "a turn by 180 degrees" + "".join(f" about {name}" for name in kept)
    elif turned:
        words = "a turn by 90 degrees" if dim == 2 else "turned axes"
    else:
        words = f"{', '.join(moved[:-1])} and {moved[-1]} exchanged" + (" and mirrored" if mirrored else "")
    stands = ", ".join(("-" if axes[a, order[a]] < 0.0 else "") + "xyz"[order[a]] for a in range(dim))
    changes = len(mirrored) + max(len(moved) - 1, 0) - (1 if turned and mirrored else 0)
    return f"{words}: ({stands}) for ({', '.join('xyz'[:dim])})", changes
