"""Synthetic runs: marks that move smoothly in front of a realistic camera, at two levels of difficulty.

The seed determines the camera, its lamps, the surface, the motion and the noise.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from vision.arrays import Floats, Picture
from vision.detection.hue import hue_distance
from vision.synthetic.camera_frames import (
    SyntheticCamera,
    SyntheticFrame,
    SyntheticMark,
    draw_synthetic_frame,
    reflectance,
)
from vision.synthetic.clutter import (
    OccludingHand,
    OccludingNeedle,
    blood_layer,
    hand_layer,
    needle_layers,
    plain_surface,
)
from vision.synthetic.layers import Layer, paint
from vision.synthetic.levels import any_camera, good_camera
from vision.synthetic.plain_frames import distractors
from vision.synthetic.view import SyntheticView, disc_box, disc_coverage

Level = Literal["good light", "whole range"]
"""Difficulty of a synthetic run: "good light" has even light and no occluders; "whole range" has all disturbances."""

Triple = tuple[float, float, float]

FASTEST_PX = 20.0
"""Largest motion of a mark between two frames [px], at the scale of mid-picture."""


@dataclass(frozen=True, slots=True, eq=False)
class RunFrame:
    """A frame of a run.

    time_s: time of mid-exposure [s]; camera: the camera with its lamp colour and exposure at this time
    marks: the marks; frame: the picture with its truth
    """

    index: int
    time_s: float
    camera: SyntheticCamera
    marks: tuple[SyntheticMark, ...]
    frame: SyntheticFrame


@dataclass(frozen=True, slots=True, eq=False)
class Sway:
    """A smooth motion on the plane: a sum of sines about a home position.

    home_m: the home position [m], shape (2,); amplitudes_m: amplitudes of the sines [m], shape (n_sines, 2)
    rates_hz: frequencies of the sines [Hz], shape (n_sines,); phases: phases [radians], shape (n_sines, 2)
    """

    home_m: Floats
    amplitudes_m: Floats
    rates_hz: Floats
    phases: Floats

    def at(self, times_s: Floats) -> Floats:
        """Positions [m], (n, 2), at times [s], (n,)."""
        angle = 2.0 * np.pi * self.rates_hz[:, None] * times_s[:, None, None] + self.phases
        return np.asarray(self.home_m + (self.amplitudes_m * np.sin(angle)).sum(axis=1))


@dataclass(frozen=True, slots=True, eq=False)
class Drift:
    """A factor that varies slowly about 1: the exponential of a sine with amplitude `depth`."""

    depth: float
    rate_hz: float
    phase: float

    def at(self, time_s: float) -> float:
        """The factor at a time [s]."""
        return float(np.exp(self.depth * np.sin(2.0 * np.pi * self.rate_hz * time_s + self.phase)))


def exposure_path(
    position_m: Callable[[Floats], Floats], time_s: float, open_s: float, longest_step_m: float
) -> Floats:
    """Positions of a mark at evenly spaced moments of an exposure [m], (n_moments, 2).

    position_m: function from times [s] to positions [m], (n, 2)
    time_s: time of mid-exposure [s]; open_s: duration of the exposure [s]
    longest_step_m: largest distance between successive positions [m]; it determines n_moments, an odd number
    """
    if open_s == 0:
        return position_m(np.array([time_s]))
    fine = position_m(time_s + open_s * np.linspace(-0.5, 0.5, 17))
    length = float(np.hypot(*np.diff(fine, axis=0).T).sum())
    n = int(np.ceil(length / longest_step_m)) // 2 * 2 + 1
    return position_m(time_s + open_s * ((np.arange(n) + 0.5) / n - 0.5))


def synthetic_run(
    seed: int,
    n_frames: int,
    level: Level = "good light",
    *,
    size_px: tuple[int, int] = (640, 480),
    hues_deg: Sequence[float] = (0.0, 0.0, 0.0, 0.0),
    radius_px: float | None = None,
    fps: float = 30.0,
) -> Iterator[RunFrame]:
    """Frames with one mark for each hue. Each mark moves about a fixed point, at most `FASTEST_PX` between two frames.

    level: "good light" has little noise and no occluders; "whole range" has every effect, with random strength
    radius_px: radius of the marks at mid-picture [px]; None: random
    """
    if level not in ("good light", "whole range"):
        raise ValueError(f"level: expected good light or whole range, found {level}")
    if n_frames < 0 or not hues_deg:
        raise ValueError(f"run: expected frames and at least one hue, found {n_frames} and {list(hues_deg)}")
    rng = np.random.default_rng([seed, 0 if level == "good light" else 1])
    camera = good_camera(size_px, rng) if level == "good light" else any_camera(size_px, rng)
    radius = float(rng.uniform(8.0, 13.0) if level == "good light" else rng.uniform(5.0, 14.0))
    if radius_px is not None:
        radius = radius_px
    scale = camera.view.m_per_px((0.0, 0.0))
    sways = _sways(camera.view, len(hues_deg), rng, fps)
    colors = [(float(rng.uniform(0.75, 0.92)), float(rng.uniform(0.6, 0.85))) for _ in hues_deg]
    surface = _surface(camera.view, hues_deg, radius, rng, level)
    dim, warm = _drifts(rng, level)
    homes = camera.view.project([sway.home_m for sway in sways])
    cover = _no_cover if level == "good light" else _occluders(size_px, homes, rng)

    def frames() -> Iterator[RunFrame]:
        for index in range(n_frames):
            time_s = index / fps
            blue, green, red = camera.lamp_bgr
            now = replace(
                camera,
                exposure=camera.exposure * dim.at(time_s),
                lamp_bgr=(blue / warm.at(time_s), green, red * warm.at(time_s)),
                flicker_phase=camera.flicker_phase + 2.4 * index,
            )
            marks = tuple(
                SyntheticMark(
                    exposure_path(sway.at, time_s, camera.exposure_share / fps, scale), radius * scale, hue, *color
                )
                for sway, hue, color in zip(sways, hues_deg, colors, strict=True)
            )
            frame = draw_synthetic_frame(now, surface, marks, rng, occluders=cover(time_s))
            yield RunFrame(index, time_s, now, marks, frame)

    return frames()


def _sways(view: SyntheticView, n: int, rng: np.random.Generator, fps: float) -> list[Sway]:
    """Random motions of n marks. Each mark has its own tile of the picture, and moves near the middle of this tile."""
    n_across = max(1, round(np.sqrt(n * view.size_px[0] / view.size_px[1])))
    n_down = int(np.ceil(n / n_across))
    tile = np.array(view.size_px) / (n_across, n_down)
    scale = view.m_per_px((0.0, 0.0))
    sways = []
    for k in range(n):
        home = view.to_plane([(np.array([k % n_across, k // n_across]) + rng.uniform(0.42, 0.58, 2)) * tile])[0]
        shares = rng.dirichlet((2.0, 2.0))
        speed = rng.uniform(0.1, 1.0) * FASTEST_PX * scale * fps  # largest sum of the speeds of the sines [m/s]
        # Slow sines have large amplitudes. So the size of the tile limits the frequencies from below.
        slowest = speed / (2.0 * np.pi * 0.28 * tile.min() * scale)
        rates = np.maximum(rng.uniform(0.4, 1.2, 2), slowest)
        heading = rng.uniform(0.0, 2.0 * np.pi, 2)
        reach = shares * speed / (2.0 * np.pi * rates)
        amplitudes = reach[:, None] * np.column_stack([np.cos(heading), np.sin(heading)])
        sways.append(Sway(home, amplitudes, rates, rng.uniform(0.0, 2.0 * np.pi, (2, 1)) * np.ones((1, 2))))
    return sways


def _surface(
    view: SyntheticView, hues_deg: Sequence[float], radius_px: float, rng: np.random.Generator, level: Level
) -> Picture:
    """Picture of the plane without marks. At the level "whole range", blood and discs of other hues are visible."""
    if level == "good light":
        return plain_surface(view.size_px, (0.78, 0.80, 0.79), rng, texture=0.02)
    tones = ((0.80, 0.80, 0.78), (0.62, 0.66, 0.64), (0.83, 0.74, 0.66), (0.42, 0.52, 0.56))
    surface = plain_surface(
        view.size_px, tones[int(rng.integers(len(tones)))], rng, texture=float(rng.uniform(0.01, 0.08))
    )
    n_strays = int(rng.integers(0, 6))
    hue_is_free = any(all(hue_distance(h, kept) >= 50.0 for kept in hues_deg) for h in range(0, 360, 5))
    strays = distractors(n_strays, view.size_px, rng, hues_deg) if hue_is_free else []
    scale = view.m_per_px((0.0, 0.0))
    for stray in strays:
        place = view.to_plane([stray.center_px])
        box = disc_box(view, place, stray.axes_px[0] * scale)
        alpha = disc_coverage(view, box, place, stray.axes_px[0] * scale)
        paint(surface, Layer(box[0], box[1], alpha, reflectance(stray.hue_deg, stray.saturation, stray.value)))
    counts = [int(rng.integers(0, most)) for most in (4, 6, 16)]
    paint(
        surface, blood_layer(view.size_px, radius_px, rng, n_smears=counts[0], n_streaks=counts[1], n_drops=counts[2])
    )
    return surface


def _drifts(rng: np.random.Generator, level: Level) -> tuple[Drift, Drift]:
    """Drift of the exposure, and drift of the lamp's colour."""
    deepest = (0.02, 0.01) if level == "good light" else (0.25, 0.10)
    one, two = (
        Drift(float(rng.uniform(0.0, d)), float(rng.uniform(0.05, 0.6)), float(rng.uniform(0.0, 2.0 * np.pi)))
        for d in deepest
    )
    return one, two


def _no_cover(time_s: float) -> list[Layer]:
    return []


def _occluders(size_px: tuple[int, int], homes_px: Floats, rng: np.random.Generator) -> Callable[[float], list[Layer]]:
    """Function from a time [s] to the layers of a moving needle and a moving hand. A run may lack one or both of them.

    The needle and the hand move about the home position of a mark, so that they often cover the mark.
    """
    with_needle, with_hand = rng.random() < 0.7, rng.random() < 0.5
    size = np.array(size_px, dtype=float)
    aim, tail_deg = rng.choice(homes_px) + rng.normal(0.0, 15.0, 2), rng.uniform(0.0, 360.0)
    out = np.array([np.cos(np.deg2rad(tail_deg)), np.sin(np.deg2rad(tail_deg))])
    width, gloss, needle_rate = rng.uniform(2.0, 6.0), rng.uniform(0.3, 1.2), rng.uniform(0.1, 0.5)
    towards = float(rng.uniform(0.0, 360.0))
    ahead = np.array([np.cos(np.deg2rad(towards)), np.sin(np.deg2rad(towards))])
    goal, finger = rng.choice(homes_px) + rng.normal(0.0, 25.0, 2), float(rng.uniform(14.0, 30.0))
    n_fingers, softness = int(rng.integers(1, 5)), float(rng.uniform(0.8, 3.0))
    skins: tuple[Triple, ...] = ((0.88, 0.68, 0.58), (0.78, 0.56, 0.45), (0.55, 0.36, 0.27), (0.36, 0.23, 0.17))
    skin = skins[int(rng.integers(len(skins)))]
    hand_phase, hand_rate = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.15, 0.5)

    def at(time_s: float) -> list[Layer]:
        layers: list[Layer] = []
        if with_needle:
            tip = aim + out * 60.0 * np.sin(2.0 * np.pi * needle_rate * time_s)
            tail = tip + out * 2.0 * size.max()
            layers += needle_layers(OccludingNeedle(_pair(tip), _pair(tail), float(width), float(gloss)), size_px)
        if with_hand:
            tip = goal + ahead * 120.0 * np.sin(2.0 * np.pi * hand_rate * time_s + hand_phase)
            layers.append(hand_layer(OccludingHand(_pair(tip), towards, finger, n_fingers, skin, softness), size_px))
        return layers

    return at


def _pair(point: Floats) -> tuple[float, float]:
    return float(point[0]), float(point[1])
