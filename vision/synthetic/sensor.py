"""Model of a camera's sensor and software: Bayer mosaic, noise, white balance, gamma, JPEG.

Light is linear. With white balance gains of 1, light 1 has the grey level 255. Pictures are BGR.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.arrays import Floats, Image, Picture
from vision.sources.video import compress

FULL_SCALE = 65535
BLACK = 4096
"""Sensor count without light. It is above 0, because clipping negative noise at 0 would brighten dark pixels."""


@dataclass(frozen=True, slots=True)
class Sensor:
    """A camera's sensor and software. The defaults only round light to grey levels.

    bayer: whether the sensor has a Bayer mosaic, RGGB from the first pixel on
    full_well_e: number of electrons for light of 1; the variance of shot noise is light / full_well_e
    read_noise_e: standard deviation of the noise in the dark [electrons]. If it is not 0, full_well_e must be finite.
    gains_bgr: gains of the white balance, applied after the noise
    gamma: whether grey levels follow the sRGB curve; if not, they are proportional to light
    jpeg_quality: quality of JPEG compression, 1 to 100; None: no compression
    """

    bayer: bool = False
    full_well_e: float = np.inf
    read_noise_e: float = 0.0
    gains_bgr: tuple[float, float, float] = (1.0, 1.0, 1.0)
    gamma: bool = False
    jpeg_quality: int | None = None

    def __post_init__(self) -> None:
        if not self.full_well_e > 0:
            raise ValueError(f"sensor full_well_e: expected more than 0, found {self.full_well_e}")
        if not self.read_noise_e >= 0:
            raise ValueError(f"sensor read_noise_e: expected 0 or more, found {self.read_noise_e}")
        if self.read_noise_e and not np.isfinite(self.full_well_e):
            raise ValueError("sensor read_noise_e: expected 0 where full_well_e is infinite, found more")
        if not min(self.gains_bgr) > 0:
            raise ValueError(f"sensor gains_bgr: expected more than 0, found {self.gains_bgr}")
        if self.jpeg_quality is not None and not 1 <= self.jpeg_quality <= 100:
            raise ValueError(f"sensor jpeg_quality: expected 1 to 100, found {self.jpeg_quality}")


def srgb_of(light: ArrayLike) -> Floats:
    """Convert linear light to sRGB values (IEC 61966-2-1). Both are arrays (...) of any shape, from 0 to 1.

    >>> round(float(srgb_of(0.18)), 3)
    0.461
    """
    x = np.clip(np.asarray(light, dtype=np.float64), 0.0, 1.0)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1.0 / 2.4) - 0.055)


def light_of(srgb: ArrayLike) -> Floats:
    """Convert sRGB values to linear light. Both are arrays (...) of any shape, from 0 to 1."""
    y = np.clip(np.asarray(srgb, dtype=np.float64), 0.0, 1.0)
    return np.where(y <= 0.04045, y / 12.92, ((y + 0.055) / 1.055) ** 2.4)


def develop(light: Picture, sensor: Sensor, rng: np.random.Generator) -> Image:
    """Picture, (height, width, 3) uint8, of linear light, (height, width, 3) float32; a mosaic needs even sizes."""
    height, width = light.shape[:2]
    if sensor.bayer and (height % 2 or width % 2):
        raise ValueError(f"light: expected an even width and height for a mosaic, found {width} x {height}")
    electrons = _with_noise(_mosaic(light) if sensor.bayer else light, sensor, rng)
    counts = _counts(electrons)
    levels = cv2.cvtColor(counts, cv2.COLOR_BayerRGGB2BGR) if sensor.bayer else counts
    tables = [_tone_table(gain, sensor.gamma) for gain in sensor.gains_bgr]
    image = cv2.merge([table[channel] for table, channel in zip(tables, cv2.split(levels), strict=True)])
    plain = np.asarray(image, dtype=np.uint8)
    return plain if sensor.jpeg_quality is None else compress(plain, sensor.jpeg_quality)


def _mosaic(light: Picture) -> Picture:
    mosaic: Picture = light[:, :, 1].copy()
    mosaic[0::2, 0::2] = light[0::2, 0::2, 2]
    mosaic[1::2, 1::2] = light[1::2, 1::2, 0]
    return mosaic


def _with_noise(light: Picture, sensor: Sensor, rng: np.random.Generator) -> Picture:
    if not np.isfinite(sensor.full_well_e):
        return light
    # variance = light / full well + (read noise / full well)²
    variance = np.maximum(light, np.float32(0.0)) / np.float32(sensor.full_well_e)
    variance += np.float32((sensor.read_noise_e / sensor.full_well_e) ** 2)
    noise = rng.standard_normal(light.shape, dtype=np.float32)
    noise *= cv2.sqrt(variance).reshape(light.shape)
    noise += light
    return noise


def _counts(light: Picture) -> NDArray[np.uint16]:
    """Convert light to sensor counts: digital numbers from 0 to `FULL_SCALE`."""
    counts = light * np.float32(FULL_SCALE - BLACK)
    counts += np.float32(BLACK + 0.5)
    np.clip(counts, 0, FULL_SCALE, out=counts)
    return counts.astype(np.uint16)


@lru_cache(maxsize=64)
def _tone_table(gain: float, gamma: bool) -> Image:
    """Grey level of each sensor count from 0 to FULL_SCALE. gain: gain of the white balance; gamma: as in `Sensor`."""
    light = np.clip((np.arange(FULL_SCALE + 1) - BLACK) * (gain / (FULL_SCALE - BLACK)), 0.0, 1.0)
    return np.rint(255.0 * (srgb_of(light) if gamma else light)).astype(np.uint8)
