"""Faults of the camera: of its reads, its timestamps and its pictures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import cast

import cv2
import numpy as np

from experiments.studies.faults.judge import FOREVER, HIDDEN_S, LASTS_S, ONSET_S
from experiments.studies.faults.scripted import Alters, Arrives, ScriptedFault
from experiments.studies.faults.world import BEGAN_S, INTERVAL_S, Arrival
from vision.arrays import Image

DEVICE_S = 3.0
"""Time of a device's own clock at the first exposure [s]."""


def _within(arrival: Arrival, lasts_s: float) -> bool:
    return ONSET_S <= arrival.at_s - BEGAN_S < ONSET_S + lasts_s


def _unplugged(arrivals: list[Arrival], _rng: np.random.Generator, lasts_s: float) -> list[Arrival]:
    return [replace(one, image=None) if _within(one, lasts_s) else one for one in arrivals]


def _kept(keeps: Callable[[int, np.random.Generator], bool]) -> Arrives:
    """A fault that drops reads: `keeps` states which reads remain, by their number since the onset."""

    def arrives(arrivals: list[Arrival], rng: np.random.Generator, lasts_s: float) -> list[Arrival]:
        first = sum(one.at_s - BEGAN_S < ONSET_S for one in arrivals)
        return [one for k, one in enumerate(arrivals) if not _within(one, lasts_s) or keeps(k - first, rng)]

    return arrives


_blocked = _kept(lambda _k, _rng: False)


def _frozen(n_pictures: int) -> Arrives:
    """A fault that repeats the last n_pictures pictures before the onset in turn."""

    def arrives(arrivals: list[Arrival], _rng: np.random.Generator, lasts_s: float) -> list[Arrival]:
        before = [one.image for one in arrivals if one.at_s - BEGAN_S < ONSET_S][-n_pictures:]
        turns = iter(range(len(arrivals)))
        return [
            replace(one, image=before[next(turns) % n_pictures]) if _within(one, lasts_s) else one for one in arrivals
        ]

    return arrives


def _late(arrivals: list[Arrival], rng: np.random.Generator, lasts_s: float) -> list[Arrival]:
    at_s = np.array([one.at_s + (rng.exponential(0.05) if _within(one, lasts_s) else 0.0) for one in arrivals])
    in_order = np.maximum.accumulate(at_s)
    return [replace(one, at_s=float(at)) for one, at in zip(arrivals, in_order, strict=True)]


def _lag(arrivals: list[Arrival], _rng: np.random.Generator, lasts_s: float) -> list[Arrival]:
    return [replace(one, at_s=one.at_s + 1.0) if _within(one, lasts_s) else one for one in arrivals]


def _dated(fault_s: float, arrives: Arrives = lambda arrivals, _rng, _lasts_s: arrivals) -> Arrives:
    """A fault of a camera with timestamps: during the fault, the timestamps have the error fault_s [s]."""
    return lambda arrivals, rng, lasts_s: arrives(
        [
            replace(one, stated_s=DEVICE_S + k * INTERVAL_S + (fault_s if _within(one, lasts_s) else 0.0))
            for k, one in enumerate(arrivals)
        ],
        rng,
        lasts_s,
    )


def _noise(low: int, high: int) -> Alters:
    """A fault with pictures of random values, from `low` to below `high`."""
    return lambda image, _since_s, rng: rng.integers(low, high, image.shape, dtype=np.uint8)


def _shifted_hue(image: Image, _since_s: float, _rng: np.random.Generator) -> Image:
    hsv = cv2.cvtColor(image, cv2.COLOR_BGR2HSV)
    hsv[..., 0] = (hsv[..., 0].astype(np.int16) + 15) % 180
    return np.asarray(cv2.cvtColor(hsv, cv2.COLOR_HSV2BGR), dtype=np.uint8)


def _dimmed(image: Image, _since_s: float, rng: np.random.Generator) -> Image:
    return np.clip(0.35 * image + rng.normal(0.0, 1.2, image.shape), 0, 255).astype(np.uint8)


def _bleeding(image: Image, since_s: float, _rng: np.random.Generator) -> Image:
    """Blood spreads over the picture beside the marks, as red as the red mark."""
    height, width = image.shape[:2]
    stained = image.copy()
    reach = int(height * min(0.2 + 0.2 * since_s, 0.6))
    cv2.ellipse(stained, (int(0.42 * width), int(0.35 * height)), (18, reach), 12.0, 0.0, 360.0, (24, 20, 190), -1)
    return stained


_PICTURES: tuple[tuple[str, str, float, Alters], ...] = (
    ("black", "black pictures for 2 s", LASTS_S, _noise(0, 4)),
    ("overexposed", "white pictures for 2 s", LASTS_S, _noise(250, 256)),
    (
        "another size",
        "pictures of 320 x 240 for 2 s",
        LASTS_S,
        lambda image, _since_s, _rng: np.asarray(cv2.resize(image, (320, 240)), dtype=np.uint8),
    ),
    (
        "BGRA",
        "pictures of four channels for 2 s",
        LASTS_S,
        lambda image, _since_s, _rng: np.dstack([image, np.full(image.shape[:2], 255, np.uint8)]),
    ),
    (
        "16 bit",
        "pictures of 16 bit for 2 s",
        LASTS_S,
        lambda image, _since_s, _rng: cast(Image, image.astype(np.uint16) * 257),
    ),
    ("dimmed", "the lamp dims to a third", FOREVER, _dimmed),
    ("hue shifted", "all hues turn by 30 degrees", FOREVER, _shifted_hue),
    ("blood", "blood as red as a mark runs over the picture", FOREVER, _bleeding),
)

CAMERA: tuple[ScriptedFault, ...] = (
    ScriptedFault("unplugged", "the camera is unplugged for 2 s", arrivals=_unplugged),
    ScriptedFault("blocked", "reads block for 2 s", arrivals=_blocked),
    ScriptedFault("frozen", "one picture repeats for 2 s", arrivals=_frozen(1)),
    ScriptedFault("frozen in turn", "two pictures alternate for 2 s", arrivals=_frozen(2)),
    ScriptedFault("dropped frames", "every other frame is lost for 2 s", arrivals=_kept(lambda k, _rng: bool(k % 2))),
    ScriptedFault(
        "dropped at random",
        "half of the frames, at random, are lost for 2 s",
        within_s=HIDDEN_S,
        arrivals=_kept(lambda _k, rng: rng.random() > 0.5),
    ),
    ScriptedFault("late frames", "frames come 50 ms late on average, in bursts, for 2 s", arrivals=_late),
    ScriptedFault("lag", "all frames come 1 s late", FOREVER, arrivals=_lag),
    ScriptedFault(
        "blocked, dated",
        "timestamped reads block for 2 s",
        arrivals=_dated(0.0, _blocked),
    ),
    ScriptedFault(
        "lag, dated",
        "all timestamped frames come 1 s late",
        FOREVER,
        arrivals=_dated(0.0, _lag),
    ),
    *(ScriptedFault(name, what, lasts_s, picture=alters) for name, what, lasts_s, alters in _PICTURES),
    ScriptedFault("clock ahead", "the camera's clock jumps ahead by 10 s", FOREVER, arrivals=_dated(10.0)),
    ScriptedFault("clock back", "the camera's clock jumps back by 10 s", FOREVER, arrivals=_dated(-10.0)),
    ScriptedFault("NaN times", "the camera's times are NaN", FOREVER, arrivals=_dated(np.nan)),
    ScriptedFault(
        "NaN pictures",
        "pictures of NaN for 2 s",
        picture=lambda image, _since_s, _rng: np.full(image.shape, np.nan, dtype=np.float32),
    ),
)
