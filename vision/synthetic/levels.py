"""Realistic cameras, drawn at random from a seed, at two levels of difficulty."""

from __future__ import annotations

import numpy as np

from vision.arrays import Floats
from vision.synthetic.camera_frames import Highlight, Shadow, SyntheticCamera
from vision.synthetic.sensor import Sensor
from vision.synthetic.view import tilted_view

Triple = tuple[float, float, float]

LAMPS_BGR: dict[str, Triple] = {"daylight": (1.0, 1.0, 1.0), "led": (0.86, 1.0, 0.97), "tungsten": (0.45, 0.78, 1.25)}
"""Colour of each lamp, as a sensor with a white balance for daylight records it; choice."""


def good_camera(size_px: tuple[int, int], rng: np.random.Generator) -> SyntheticCamera:
    """A random camera in good light, with little noise and distortion. It looks almost perpendicularly at the plane."""
    return SyntheticCamera(
        tilted_view(
            size_px,
            1.1 * size_px[0],
            1.0,
            tilt_deg=_tilt(rng, 8.0),
            distortion=(float(rng.uniform(-0.12, 0.04)), 0.02, 0.0005, -0.0005, 0.0),
        ),
        Sensor(
            bayer=True,
            full_well_e=float(rng.uniform(6000.0, 12000.0)),
            read_noise_e=float(rng.uniform(4.0, 10.0)),
            gamma=True,
            jpeg_quality=int(rng.integers(90, 97)),
        ),
        vignetting=float(rng.uniform(0.4, 1.0)),
        blur_sd_px=float(rng.uniform(0.6, 0.9)),
        exposure_share=float(rng.uniform(0.1, 0.3)),
        exposure=float(rng.uniform(0.85, 1.0)),
        lamp_bgr=_cast(LAMPS_BGR[str(rng.choice(["daylight", "led"]))], 0.3),
        slope=float(rng.uniform(0.0, 0.15)),
        slope_deg=float(rng.uniform(0.0, 360.0)),
        highlight=Highlight(0.12, 0.4),
    )


def any_camera(size_px: tuple[int, int], rng: np.random.Generator) -> SyntheticCamera:
    """A random camera with every effect of `SyntheticCamera`. Choice: the effects are as strong as in webcams."""
    lamp = LAMPS_BGR[str(rng.choice(list(LAMPS_BGR)))]
    balanced = float(rng.uniform(0.5, 1.0))
    gains = np.array(_cast(lamp, -balanced))
    share = float(rng.uniform(0.0, 1.0))
    offset_deg = float(rng.uniform(0.0, 2.0 * np.pi))
    return SyntheticCamera(
        tilted_view(
            size_px,
            float(rng.uniform(0.85, 1.4)) * size_px[0],
            1.0,
            tilt_deg=_tilt(rng, 25.0),
            distortion=(float(rng.uniform(-0.3, 0.08)), float(rng.uniform(0.0, 0.08)), 0.001, -0.001, 0.0),
        ),
        Sensor(
            bayer=True,
            full_well_e=float(np.exp(rng.uniform(np.log(500.0), np.log(10000.0)))),
            read_noise_e=float(rng.uniform(3.0, 12.0)),
            gains_bgr=_triple(gains / gains.min()),
            gamma=True,
            jpeg_quality=int(rng.integers(55, 97)),
        ),
        vignetting=float(rng.uniform(0.3, 1.8)),
        blur_sd_px=float(rng.uniform(0.5, 1.6)),
        exposure_share=share,
        exposure=float(np.exp(rng.uniform(np.log(0.4), np.log(1.15)))) * float(gains.min()),
        lamp_bgr=lamp,
        slope=float(rng.uniform(0.0, 0.5)),
        slope_deg=float(rng.uniform(0.0, 360.0)),
        # The longer the shutter is open, the weaker is the flicker in the picture.
        flicker=float(rng.uniform(0.0, 0.10)) * (1.0 - share) * float(rng.random() < 0.5),
        flicker_period_px=float(rng.uniform(0.3, 0.6)) * size_px[1],
        flicker_phase=float(rng.uniform(0.0, 2.0 * np.pi)),
        highlight=Highlight(
            float(rng.uniform(0.1, 0.35)),
            float(rng.uniform(0.2, 1.0)),
            (0.5 * float(np.cos(offset_deg)), 0.5 * float(np.sin(offset_deg))),
        ),
        shadow=Shadow(
            float(rng.uniform(0.15, 0.65)),
            (float(rng.uniform(0.2, 0.8)) * size_px[0], float(rng.uniform(0.2, 0.8)) * size_px[1]),
            float(rng.uniform(0.0, 360.0)),
            float(rng.uniform(6.0, 40.0)),
        ),
    )


def _tilt(rng: np.random.Generator, largest_deg: float) -> Triple:
    return _triple(rng.uniform(-largest_deg, largest_deg, 3))


def _cast(lamp_bgr: Triple, power: float) -> Triple:
    """A lamp's colour raised to a power. A negative power gives white balance gains against its colour cast."""
    return _triple(np.array(lamp_bgr) ** power)


def _triple(values: Floats) -> Triple:
    return float(values[0]), float(values[1]), float(values[2])
