"""Centre of a mark: from its coverage and outline if their centres agree, otherwise from its rim or its outline alone.

Image axes: u right, v down, in pixels from the corner of a patch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import cv2
import numpy as np

from vision.arrays import Floats, Picture
from vision.detection import kernels
from vision.detection.coverage import Coverage
from vision.detection.outline import Fitted, Outline, fit_outline
from vision.detection.rim import fit_rim
from vision.detection.settings import CenterSettings, DetectionSettings


@dataclass(frozen=True, slots=True, eq=False)
class Component:
    """Connected pixels that may be a mark.

    corner_px: position of the patch in the searched part, (2,); patch: pixels and surroundings, (h, w, 3) BGR
    component: 1 on the connected pixels, else 0, (h, w); others: 1 on other pixels of the colour class, else 0, (h, w)
    reach_px: longer side of the box around the pixels; clipped: whether the box touches the searched part's border
    """

    corner_px: Floats
    patch: Picture
    component: Picture
    others: Picture
    reach_px: float
    clipped: bool


@dataclass(frozen=True, slots=True, eq=False)
class Center:
    """Centre of a mark relative to the patch's corner. The fields mean the same as in `Detection`."""

    center_px: Floats
    cov_px2: Floats
    occluded: bool = False
    size: float = 1.0


def centers_of(
    piece: Component, seen: Coverage, outline: Outline, expected_px: list[Floats], settings: DetectionSettings
) -> list[Center]:
    """Centres of the marks in a component. A component may be one mark, several touching marks, or no mark.

    expected_px: expected positions of marks on the component [px], each (2,), relative to the corner of piece.patch
    """
    factor = trust(seen.noise_sd, settings.centers) if outline.even else 1.0
    return [replace(at, cov_px2=factor * at.cov_px2) for at in _by_outline(piece, seen, outline, expected_px, settings)]


def trust(noise_sd: Any, settings: CenterSettings) -> Any:
    """Factor of at least 1 on the covariance of an outline's centre. noise_sd: standard deviation of alpha's noise."""
    grain = (noise_sd / settings.grain_noise) ** 4
    return 1.0 + settings.grain_gain * grain / (1.0 + grain)


def _agreed(seen: Coverage, fitted: Fitted, outline: Outline, settings: CenterSettings) -> Center | None:
    """Centre of a mark's fitted outline, if it agrees with the centre of the mark's visible area; otherwise None."""
    one, other = (np.array([*at.center_px, *at.cov_px2.ravel()[[0, 1, 3]]]) for at in (seen, fitted))
    agree, squared = kernels.agreed(one, other, seen.area_px / outline.area_px, settings.for_kernel())
    return Center(fitted.center_px, max(1.0, squared / 2.0) * fitted.cov_px2, False, fitted.size) if agree else None


def _by_outline(
    piece: Component, seen: Coverage, outline: Outline, expected_px: list[Floats], settings: DetectionSettings
) -> list[Center]:
    limits = settings.centers
    whole = Center(seen.center_px, seen.cov_px2)
    fitted = fit_outline(seen.alpha, seen.center_px, outline, settings.outline)
    share = seen.area_px / outline.area_px
    if outline.even:
        most = settings.outline.whole_share
        if share * most > 1.0 and (fitted is None or fitted.beyond > 1.0 - most):
            starts = _starts(piece, expected_px, outline)
            several = [fit_outline(seen.alpha, start, outline, settings.outline) for start in starts]
            if all(several) and (len(expected_px) > 1 or _apart(several, outline)):
                return [Center(one.center_px, one.cov_px2, True, one.size) for one in several if one is not None]
        agreed = None if fitted is None else _agreed(seen, fitted, outline, limits)
        if agreed is not None:
            return [agreed]
    circles = [(*whole.center_px, 1.0), *((u, v, 1.0) for u, v in expected_px)]
    if fitted is not None:
        circles.append((*fitted.center_px, fitted.size))
    rim = _by_rim(piece, outline, np.array(circles), settings)
    if rim is not None:
        return [replace(rim, occluded=rim.occluded or share < settings.outline.whole_share * rim.size**2)]
    if fitted is not None and fitted.beyond <= 1.0 - settings.outline.whole_share:
        return [Center(fitted.center_px, fitted.cov_px2, True, fitted.size)]
    if share < limits.min_area or (outline.even and share > limits.max_area):
        return []
    # Neither rim nor outline is visible: the true centre may be anywhere in the mark.
    return [replace(whole, cov_px2=whole.cov_px2 + outline.area_px / (4.0 * np.pi) * np.eye(2))]


def _by_rim(piece: Component, outline: Outline, circles: Floats, settings: DetectionSettings) -> Center | None:
    """Centre of a mark from its rim; None if no rim is found. circles: initial values, see `fit_rim`."""
    limits = settings.rim
    rim = fit_rim(piece.patch, circles, outline, settings)
    if rim is None or (outline.even and rim.share < limits.min_share):
        return None
    cov = rim.cov_px2 + limits.smear_gain * _smear(piece.component, outline, settings.centers)
    if not outline.even:
        cov = cov + limits.shading**2 / rim.share * outline.shape_px @ outline.shape_px.T
    return Center(rim.center_px, cov, piece.clipped or rim.share < limits.min_share, rim.size)


def _starts(piece: Component, expected_px: list[Floats], outline: Outline) -> Floats:
    """Points inside touching marks, one point in each mark [px], (n, 2)."""
    if len(expected_px) > 1:
        return np.array(expected_px)
    v, u = np.nonzero(piece.component)
    places = np.column_stack([u, v]).astype(float)
    middle = places.mean(axis=0)
    along = np.linalg.eigh(np.cov(places.T))[1][:, 1]
    lengths = (places - middle) @ along
    radius = (outline.area_px / np.pi) ** 0.5
    return middle + np.array([[lengths.min() + radius], [lengths.max() - radius]]) * along


def _apart(several: Sequence[Fitted | None], outline: Outline) -> bool:
    """Whether centres are so far apart that they belong to different marks."""
    near = (outline.area_px / np.pi) ** 0.5
    pairs = combinations((one.center_px for one in several if one is not None), 2)
    return all(np.hypot(*(a - b)) > near for a, b in pairs)


def _smear(component: Picture, outline: Outline, settings: CenterSettings) -> Floats:
    """Increase of the second moments of a component's pixels due to motion [px²], (2, 2)."""
    m = cv2.moments(component, binaryImage=True)
    spread = np.array([[m["mu20"], m["mu11"]], [m["mu11"], m["mu02"]]]) / m["m00"]
    # The spread of a disc is a quarter of its squared radius along each axis. Blur of the edge increases it.
    values, vectors = np.linalg.eigh(spread - settings.blurred * outline.shape_px @ outline.shape_px.T / 4.0)
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T, dtype=np.float64)
