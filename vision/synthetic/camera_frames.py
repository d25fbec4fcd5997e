"""Synthetic frames with marks at exactly known sub-pixel positions, from models of lens, light, motion and sensor.

Image axes: u right, v down, the centre of the first pixel is (0, 0). Marks are discs on a plane. Light is linear, in
BGR order. `vision/synthetic/plain_frames.py` has a simpler camera model.
"""

from __future__ import annotations

import colorsys
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.arrays import Floats, Image, Picture
from vision.synthetic.layers import Layer, paint, take
from vision.synthetic.sensor import Sensor, develop, light_of
from vision.synthetic.view import SyntheticView, disc_box, disc_coverage


@dataclass(frozen=True, slots=True)
class Highlight:
    """Mirror image of the lamp on each mark.

    size: radius of the highlight, relative to the mark's radius
    strength: share of white in the colour of the highlight, 0 to 1; the rest is the mark's colour
    offset: position relative to the mark's centre, along x and y of the plane [radii of the mark]
    """

    size: float = 0.2
    strength: float = 0.8
    offset: tuple[float, float] = (-0.35, 0.4)


@dataclass(frozen=True, slots=True)
class Shadow:
    """A shadow with a soft, straight edge.

    depth: share of light that the shadow removes, 0 to 1
    edge_px: a point in the middle of the edge, where the shadow removes half of `depth` [px]
    towards_deg: direction in which the shadow becomes darker, 0 right, 90 down [degrees]
    softness_px: standard deviation of the logistic profile of the edge [px]
    """

    depth: float
    edge_px: tuple[float, float]
    towards_deg: float
    softness_px: float


@dataclass(frozen=True, slots=True, eq=False)
class SyntheticCamera:
    """A camera in front of a plane, with a lamp. By default only the view has an effect.

    view: lens and pose
    sensor: mosaic, noise, white balance, gamma, compression
    vignetting: light decreases as `cos(angle of the ray) ** (4 * vignetting)`; 1 is the natural law, 0 is none
    blur_sd_px: standard deviation of the lens's point spread function [px]
    exposure_share: share of the frame interval during which the shutter is open, 0 to 1
    exposure: factor on the light; if it is 1, a white object is white in the picture
    lamp_bgr: colour of the lamp, as a factor on the light of each channel
    slope: relative decrease of light from one border of the picture to the other along slope_deg
    slope_deg: direction in which the light decreases, 0 right, 90 down [degrees]
    flicker: relative amplitude of the lamp's flicker. The rows are exposed one after the other. The light therefore
        differs between rows.
    flicker_period_px: number of rows in one period of the flicker [px]; flicker_phase: phase of the flicker [radians]
    highlight: mirror image of the lamp on marks; shadow: a soft shadow; None: not present

    Raises ValueError that names the invalid field.
    """

    view: SyntheticView
    sensor: Sensor = field(default_factory=Sensor)
    vignetting: float = 0.0
    blur_sd_px: float = 0.0
    exposure_share: float = 0.0
    exposure: float = 1.0
    lamp_bgr: tuple[float, float, float] = (1.0, 1.0, 1.0)
    slope: float = 0.0
    slope_deg: float = 0.0
    flicker: float = 0.0
    flicker_period_px: float = 160.0
    flicker_phase: float = 0.0
    highlight: Highlight | None = None
    shadow: Shadow | None = None

    def __post_init__(self) -> None:
        for key in ("vignetting", "blur_sd_px"):
            if not getattr(self, key) >= 0:
                raise ValueError(f"real camera {key}: expected 0 or more, found {getattr(self, key)}")
        for key in ("exposure_share", "slope", "flicker"):
            if not 0 <= getattr(self, key) <= 1:
                raise ValueError(f"real camera {key}: expected 0 to 1, found {getattr(self, key)}")
        for key in ("exposure", "flicker_period_px"):
            if not getattr(self, key) > 0:
                raise ValueError(f"real camera {key}: expected more than 0, found {getattr(self, key)}")
        if not min(self.lamp_bgr) > 0:
            raise ValueError(f"real camera lamp_bgr: expected more than 0, found {self.lamp_bgr}")


@dataclass(frozen=True, slots=True, eq=False)
class SyntheticMark:
    """A coloured disc on the plane, with its motion while the shutter is open.

    path_m: centre at evenly spaced moments of the exposure [m], shape (n_moments, 2). n_moments must be odd: the centre
        at the middle moment is the mark's true position.
    radius_m: radius of the disc [m]
    hue_deg, saturation, value: colour under white light, in sRGB
    """

    path_m: Floats
    radius_m: float
    hue_deg: float
    saturation: float = 0.85
    value: float = 0.75

    def __post_init__(self) -> None:
        path = np.array(self.path_m, dtype=np.float64).reshape(-1, 2)
        if len(path) % 2 == 0 or not np.isfinite(path).all():
            raise ValueError(f"real mark path_m: expected an odd count of finite places, found {path.tolist()}")
        if not self.radius_m > 0:
            raise ValueError(f"real mark radius_m: expected more than 0, found {self.radius_m}")
        path.setflags(write=False)
        object.__setattr__(self, "path_m", path)


@dataclass(frozen=True, slots=True, eq=False)
class SyntheticFrame:
    """A synthetic frame with its truth.

    image: (height, width, 3) BGR uint8
    centers_px: projections of the marks' centres at mid-exposure [px], shape (n_marks, 2). Due to perspective, they
        differ slightly from the centres of the ellipses in the picture.
    visible: share of each mark that is in the picture and not covered, shape (n_marks,)
    """

    image: Image
    centers_px: Floats
    visible: Floats


def draw_synthetic_frame(
    camera: SyntheticCamera,
    surface_bgr: Picture,
    marks: Sequence[SyntheticMark],
    rng: np.random.Generator,
    *,
    occluders: Sequence[Layer] = (),
) -> SyntheticFrame:
    """Draw a frame of marks on a surface. Later marks cover earlier marks, and occluders cover all marks.

    surface_bgr: share of light that the plane without marks reflects, (height, width, 3)
    """
    width, height = camera.view.size_px
    if surface_bgr.shape != (height, width, 3):
        raise ValueError(f"surface: expected shape {(height, width, 3)}, found {surface_bgr.shape}")
    scene: Picture = surface_bgr.astype(np.float32)
    layers = [_mark_layer(camera.view, mark) for mark in marks]
    for mark, layer in zip(marks, layers, strict=True):
        if layer is None:
            continue
        paint(scene, layer)
        if camera.highlight is not None:
            paint(scene, _highlight_layer(camera.view, mark, camera.highlight))
    for occluder in occluders:
        paint(scene, occluder)
    if camera.blur_sd_px:
        scene = cv2.GaussianBlur(scene, (0, 0), camera.blur_sd_px)
    scene *= _light(camera)
    image = develop(scene, camera.sensor, rng)
    centers = [camera.view.project(mark.path_m[len(mark.path_m) // 2])[0] for mark in marks]
    return SyntheticFrame(image, np.reshape(centers, (-1, 2)), _visible_shares((height, width), layers, occluders))


def reflectance(hue_deg: float, saturation: float, value: float) -> Picture:
    """Linear BGR reflectance, (3,), of a surface whose sRGB colour has this hue, saturation and value."""
    return light_of(colorsys.hsv_to_rgb(hue_deg % 360.0 / 360.0, saturation, value))[::-1].astype(np.float32)


def _mark_layer(view: SyntheticView, mark: SyntheticMark) -> Layer | None:
    """The mark as a layer; None if it is completely outside the picture."""
    box = disc_box(view, mark.path_m, mark.radius_m)
    if box[2] <= 0 or box[3] <= 0 or box[0] >= view.size_px[0] or box[1] >= view.size_px[1]:
        return None
    alpha = disc_coverage(view, box, mark.path_m, mark.radius_m)
    return Layer(box[0], box[1], alpha, reflectance(mark.hue_deg, mark.saturation, mark.value))


def _highlight_layer(view: SyntheticView, mark: SyntheticMark, highlight: Highlight) -> Layer:
    path = mark.path_m + mark.radius_m * np.array(highlight.offset)
    radius = mark.radius_m * highlight.size
    box = disc_box(view, path, radius)
    alpha = highlight.strength * disc_coverage(view, box, path, radius)
    return Layer(box[0], box[1], alpha, np.ones(3, dtype=np.float32))


def _visible_shares(
    shape: tuple[int, int], layers: Sequence[Layer | None], occluders: Sequence[Layer]
) -> NDArray[np.float64]:
    free = np.ones(shape, dtype=np.float32)
    for occluder in occluders:
        take(free, occluder)
    shares = np.zeros(len(layers))
    for k, layer in reversed(list(enumerate(layers))):
        if layer is not None:
            shares[k] = take(free, layer) / layer.alpha.sum()
    return shares


def _light(camera: SyntheticCamera) -> Picture:
    """Factor by which the light changes the scene's colours, (height, width, 3)."""
    light = _still_light(camera.view, camera.vignetting, camera.slope, camera.slope_deg)
    if camera.shadow is not None:
        light = light * _shadow_light(camera.view.size_px, camera.shadow)
    if camera.flicker:
        rows = np.arange(camera.view.size_px[1]) * (2.0 * np.pi / camera.flicker_period_px) + camera.flicker_phase
        light = light * (1.0 + camera.flicker * np.sin(rows)).astype(np.float32)[:, None]
    gains = camera.exposure * np.array(camera.lamp_bgr, dtype=np.float32)
    return cv2.merge([light * gain for gain in gains.astype(np.float32)])


@lru_cache(maxsize=8)
def _still_light(view: SyntheticView, vignetting: float, slope: float, slope_deg: float) -> Picture:
    width, height = view.size_px
    u, v = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
    light = np.ones((height, width))
    if vignetting:
        rays = view.rays(np.column_stack([u.ravel(), v.ravel()]))
        # the cosine of the ray's angle is 1 / sqrt(1 + (x/z)² + (y/z)²)
        light *= (1.0 + (rays**2).sum(axis=1)).reshape(height, width) ** (-2.0 * vignetting)
    if slope:
        c, s = np.cos(np.deg2rad(slope_deg)), np.sin(np.deg2rad(slope_deg))
        along = c * (2.0 * u / (width - 1) - 1.0) + s * (2.0 * v / (height - 1) - 1.0)
        light *= 1.0 - slope * (along / (abs(c) + abs(s)) + 1.0) / 2.0
    still: Picture = light.astype(np.float32)
    still.setflags(write=False)
    return still


def _shadow_light(size_px: tuple[int, int], shadow: Shadow) -> Picture:
    """Share of light that the shadow leaves at each pixel, (height, width)."""
    c, s = np.cos(np.deg2rad(shadow.towards_deg)), np.sin(np.deg2rad(shadow.towards_deg))
    u = (np.arange(size_px[0]) - shadow.edge_px[0])[None, :]
    v = (np.arange(size_px[1]) - shadow.edge_px[1])[:, None]
    scale = shadow.softness_px * np.sqrt(3.0) / np.pi
    # 1 / (1 + exp(-x)) = (1 + tanh(x / 2)) / 2
    dark = np.tanh(((c * u + s * v) / (2.0 * scale)).astype(np.float32))
    return np.asarray(1.0 - np.float32(shadow.depth / 2.0) * (1.0 + dark), dtype=np.float32)
