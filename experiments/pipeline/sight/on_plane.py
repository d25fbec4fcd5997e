"""Between the plane and the picture: where a mark is looked for, and where one that was found is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

import vision
from estimators import MarkMeasurement
from experiments.arrays import Floats
from experiments.formats.scene.marks import Mark
from vision import PlaneCamera
from vision.tracking.association import AssociatedMark

SIZE_SD = 0.05
"""Relative error of a mark's stated size: print, tilt, light that spills over; chosen."""


def looked_for(camera: PlaneCamera, mark: Mark, mean: Floats, cov: Floats) -> vision.Expected:
    """Where a mark is expected in the picture, by its place on the plane [m], (2,), and the covariance of that [m²]."""
    center_px, cov_px2 = camera.project(mean[None])[0], camera.cov_to_px(mean[None], cov[None])[0]
    outline = vision.Outline(mark.shape_px(camera, mean), SIZE_SD, mark.even)
    return vision.Expected(mark.node, center_px, cov_px2, mark.hue_deg, outline)


def on_plane(
    camera: PlaneCamera, by_name: Mapping[str, Mark], found: Sequence[AssociatedMark]
) -> tuple[MarkMeasurement, ...]:
    """The marks that were found in a picture, on the plane; by_name: how they look."""
    if not found:
        return ()
    marks = [by_name[f.name] for f in found]
    centers_px = np.array([f.detection.center_px for f in found])
    covs_px = np.array([f.detection.cov_px2 for f in found]) + camera.calibration_sd_px**2 * np.eye(2)
    # the outline of a ball is not shifted as that of a disc is
    radii_m = np.array([0.0 if mark.ball else mark.diameter_m / 2.0 for mark in marks])
    centers_px = centers_px - camera.disc_shift(camera.to_plane(centers_px), radii_m)
    positions, covs_m = camera.to_plane(centers_px), camera.cov_to_plane(centers_px, covs_px)
    shared = camera.calibration_error(positions) if camera.n_calibration else [None] * len(marks)
    return tuple(MarkMeasurement(m.node, positions[k], covs_m[k], shared[k]) for k, m in enumerate(marks))
