"""Synthetic frames of a camera without perspective, with marks at exactly known sub-pixel positions.

Image axes: u right, v down, the centre of the first pixel is (0, 0). Hues: 0 red, 120 green, 240 blue. Saturation and
value range from 0 to 1, grey levels from 0 to 255.
"""

from __future__ import annotations

import colorsys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.arrays import Floats, Image, Picture
from vision.detection.hue import hue_distance

Line = tuple[Sequence[float], Sequence[float]]

ROWS_PER_PIXEL = 16
"""Number of sampling lines in each row of pixels, for the coverage by a disc. The error of the coverage is 1e-3."""
BLUR_REACH = 4.0
"""Distance from an edge at which the blur of the edge ends [standard deviations of the blur]."""


@dataclass(frozen=True, slots=True, eq=False)
class Disc:
    """A coloured disc in the picture.

    center_px: centre at mid-exposure [px], shape (2,)
    axes_px: semi-axes along u and v [px]
    lean: shear [1]. The row at v pixels below the centre is shifted along u by `lean * v` pixels.
    hue_deg, saturation, value: colour of the disc
    smear_px: motion along u and v while the shutter is open [px]
    """

    center_px: Floats
    axes_px: tuple[float, float]
    hue_deg: float
    saturation: float = 0.85
    value: float = 0.75
    smear_px: tuple[float, float] = (0.0, 0.0)
    lean: float = 0.0

    def __post_init__(self) -> None:
        center = np.array(self.center_px, dtype=np.float64)
        if center.shape != (2,) or not np.isfinite(center).all():
            raise ValueError(f"disc center_px: expected two finite numbers, found {self.center_px}")
        if not min(self.axes_px) > 0:
            raise ValueError(f"disc axes_px: expected more than 0, found {self.axes_px}")
        object.__setattr__(self, "center_px", center)

    @classmethod
    def of_shape(cls, center_px: Floats, shape_px: Floats, hue_deg: float) -> Disc:
        """The disc `center_px + shape_px @ p` for p in the unit disc; center_px: (2,) [px], shape_px: (2, 2) [px]."""
        (a, b), (_, d) = shape_px @ shape_px.T
        return cls(center_px, (float(np.sqrt(a - b * b / d)), float(np.sqrt(d))), hue_deg, lean=float(b / d))

    @property
    def reach_px(self) -> Floats:
        """Half the width and half the height of the disc's bounding box [px], (2,)."""
        across, down = self.axes_px
        return np.array([np.hypot(across, self.lean * down), down])


@dataclass(frozen=True, slots=True)
class Lighting:
    """Effects of light, lens and sensor on a frame. The defaults describe a good webcam in front of acrylic.

    background_bgr: colour of the acrylic in full light [grey levels]
    slope: relative decrease of light from the picture's upper left to its lower right
    vignetting: relative decrease of light from the centre to the corners
    blur_sd_px: standard deviation of the lens's point spread function [px]
    noise_sd: standard deviation of the noise in the dark [grey levels]
    shot_noise_sd: standard deviation of the shot noise at level 255 [grey levels]
    grain_px: standard deviation of a Gaussian that smooths the noise [px]; 0 for white noise
    mark_strength: opacity of the marks: 1 for fresh marks, less for worn marks
    wander_px: standard deviation on each axis of a random shift of each mark in each frame [px]. The shift models
        errors that are not visible in the picture.
    """

    background_bgr: tuple[float, float, float] = (208.0, 210.0, 206.0)
    slope: float = 0.06
    vignetting: float = 0.08
    blur_sd_px: float = 0.8
    noise_sd: float = 1.2
    shot_noise_sd: float = 1.6
    grain_px: float = 0.0
    mark_strength: float = 1.0
    wander_px: float = 0.0

    def __post_init__(self) -> None:
        for key in ("blur_sd_px", "noise_sd", "shot_noise_sd", "grain_px", "wander_px"):
            if getattr(self, key) < 0:
                raise ValueError(f"lighting {key}: expected 0 or more, found {getattr(self, key)}")
        if not 0 < self.mark_strength <= 1:
            raise ValueError(f"lighting mark_strength: expected more than 0 and up to 1, found {self.mark_strength}")


def draw_frame(
    size_px: tuple[int, int],
    discs: Iterable[Disc],
    lighting: Lighting,
    rng: np.random.Generator,
    *,
    lines: Sequence[Line] = (),
) -> Image:
    """Draw a frame, (height, width, 3) BGR, with discs. Later discs cover earlier discs.

    lines: start and end of thin grey lines behind the discs [px], each (2,)
    """
    backdrop, light = _backdrop(size_px, lighting)
    frame = backdrop.copy()
    if lines:
        _draw_lines(frame, lines)
    for disc in discs:
        wander = rng.normal(0.0, lighting.wander_px, 2) if lighting.wander_px else np.zeros(2)
        _draw_disc(frame, light, replace(disc, center_px=disc.center_px + wander), lighting)
    return _with_noise(frame, lighting, rng)


def distractors(
    n: int, size_px: tuple[int, int], rng: np.random.Generator, keep_clear_of_hues: Sequence[float]
) -> list[Disc]:
    """Discs with random positions, sizes and hues. Their hues differ by at least 50 degrees from the given hues."""
    clear = [h for h in range(0, 360, 5) if all(hue_distance(h, kept) >= 50.0 for kept in keep_clear_of_hues)]
    if n and not clear:
        raise ValueError(f"keep_clear_of_hues: expected to leave a hue free, found {list(keep_clear_of_hues)}")
    discs = []
    for _ in range(n):
        radius = rng.uniform(6.0, 14.0)
        center = rng.uniform((radius, radius), (size_px[0] - radius, size_px[1] - radius))
        discs.append(Disc(center, (radius, radius), float(rng.choice(clear))))
    return discs


def paper_camera() -> Lighting:
    """Lighting that gives detected marks an error of 4.14 mm, as in [paper], in films of MJPG quality 60.

    Marks are 7 px wide, at 4.4 mm per pixel. Every value here is a choice, because [paper] states only the error. If
    sensor noise alone caused this error, at least one mark in twenty could not be recognised. Most of the error is
    therefore a random shift of the marks: the reference of [paper] was marked manually. The scene of the
    film must state this shift in calibration_sd_px.
    """
    return Lighting(
        blur_sd_px=1.0,  # choice: a cheap lens
        noise_sd=14.0,  # choice: a dim room at high gain
        shot_noise_sd=0.0,  # choice: noise_sd includes it
        grain_px=1.5,  # choice: colour of lower resolution than the picture
        mark_strength=1.0,  # choice: fresh marks
        wander_px=0.68,  # choice: an error of 3 mm per axis
    )


@lru_cache(maxsize=4)
def _backdrop(size_px: tuple[int, int], lighting: Lighting) -> tuple[Picture, Picture]:
    """The empty scene, (height, width, 3), and the share of full light at each pixel, (height, width)."""
    width, height = size_px
    u = np.linspace(-1.0, 1.0, width, dtype=np.float32)[None, :]
    v = np.linspace(-1.0, 1.0, height, dtype=np.float32)[:, None]
    light = 1.0 - lighting.slope * (u + v + 2.0) / 4.0 - lighting.vignetting * (u**2 + v**2) / 2.0
    backdrop = light[:, :, None] * np.array(lighting.background_bgr, dtype=np.float32)
    for array in (backdrop, light):
        array.setflags(write=False)
    return backdrop, light


def _draw_lines(frame: Picture, lines: Sequence[Line]) -> None:
    shift = 4
    for start, end in lines:
        a, b = (np.rint(np.asarray(p) * 2**shift).astype(int) for p in (start, end))
        clipped, a_px, b_px = cv2.clipLine((0, 0, frame.shape[1] << shift, frame.shape[0] << shift), a, b)
        if clipped:
            cv2.line(frame, a_px, b_px, (120.0, 120.0, 120.0), 1, cv2.LINE_8, shift)


def _draw_disc(frame: Picture, light: Picture, disc: Disc, lighting: Lighting) -> None:
    center = disc.center_px
    reach = disc.reach_px + np.abs(disc.smear_px) / 2.0 + BLUR_REACH * lighting.blur_sd_px + 1.5
    low = np.floor(center - reach).astype(int)
    high = np.ceil(center + reach).astype(int) + 1
    height, width = light.shape
    if low[0] >= width or low[1] >= height or high[0] <= 0 or high[1] <= 0:
        return
    alpha = _coverage(disc, low, high)
    if lighting.blur_sd_px:
        alpha = cv2.GaussianBlur(alpha, (0, 0), lighting.blur_sd_px, borderType=cv2.BORDER_CONSTANT)
    u, v = np.maximum(low, 0)
    alpha = alpha[v - low[1] : height - low[1], u - low[0] : width - low[0], None] * np.float32(lighting.mark_strength)
    rows, columns = slice(v, v + alpha.shape[0]), slice(u, u + alpha.shape[1])
    red, green, blue = colorsys.hsv_to_rgb(disc.hue_deg % 360.0 / 360.0, disc.saturation, disc.value)
    color = 255.0 * np.array([blue, green, red], dtype=np.float32) * light[rows, columns, None]
    frame[rows, columns] += alpha * (color - frame[rows, columns])


def _coverage(disc: Disc, low: NDArray[np.int64], high: NDArray[np.int64]) -> Picture:
    """Share of each pixel from low to high - 1 that the disc covers, averaged over the exposure."""
    n_moments = 1 + int(np.ceil(2.0 * np.hypot(*disc.smear_px)))
    v = np.arange(low[1] - 0.5, high[1] - 0.5, 1.0 / ROWS_PER_PIXEL) + 0.5 / ROWS_PER_PIXEL
    u = np.arange(low[0], high[0], dtype=float)
    total = np.zeros((high[1] - low[1], high[0] - low[0]))
    for k in range(n_moments):
        moment = (k + 0.5) / n_moments - 0.5
        u0, v0 = disc.center_px + moment * np.array(disc.smear_px)
        half = disc.axes_px[0] * np.sqrt(np.maximum(0.0, 1.0 - ((v - v0) / disc.axes_px[1]) ** 2))[:, None]
        middle = u0 + disc.lean * (v - v0)[:, None]
        chord = np.minimum(u + 0.5, middle + half) - np.maximum(u - 0.5, middle - half)
        total += np.maximum(chord, 0.0).reshape(-1, ROWS_PER_PIXEL, len(u)).mean(axis=1)
    return (total / n_moments).astype(np.float32)


def _with_noise(frame: Picture, lighting: Lighting, rng: np.random.Generator) -> Image:
    if not (lighting.noise_sd or lighting.shot_noise_sd):
        return np.asarray(cv2.convertScaleAbs(frame), dtype=np.uint8)
    height, width = frame.shape[:2]
    bank = _noise_bank(height, width, lighting.grain_px)
    v, u = rng.integers(0, height + 1), rng.integers(0, width + 1)
    noise = bank[v : v + height, u : u + width]
    sign = float(rng.choice((-1.0, 1.0)))
    if lighting.shot_noise_sd:
        # variance = dark noise² + shot noise² level / 255
        variance = cv2.addWeighted(frame, lighting.shot_noise_sd**2 / 255.0, frame, 0.0, lighting.noise_sd**2)
        scaled = cv2.multiply(cv2.sqrt(variance, variance), noise, variance, scale=sign)
    else:
        scaled = noise * np.float32(sign * lighting.noise_sd)
    return np.asarray(cv2.add(frame, scaled, dtype=cv2.CV_8U), dtype=np.uint8)


@lru_cache(maxsize=2)
def _noise_bank(height: int, width: int, grain_px: float) -> Picture:
    """Random numbers with standard deviation 1, (2 * height, 2 * width, 3).

    Each frame uses a random part of these numbers with a random sign. New random numbers for each frame would take
    longer than all other steps.
    """
    bank: Picture = np.random.default_rng(20).standard_normal((2 * height, 2 * width, 3), dtype=np.float32)
    if grain_px:
        bank = cv2.GaussianBlur(bank, (0, 0), grain_px)
        bank = bank / bank.std()
    bank.setflags(write=False)
    return bank
