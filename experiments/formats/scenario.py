"""Scenario files: the phantom, forces and camera that `softaim simulate` simulates."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from experiments.errors import InputError
from experiments.formats.toml_file import Strict, read_toml

Positive = Annotated[float, Field(gt=0)]
Scale = Annotated[float, Field(ge=0.01, le=1000)]
MOST_STEPS = 1_000_000
"""Most frames of a film, samples of a tremor or pokes: more are a misprint, at 30 frames/s nine hours of film."""


class Tremor(Strict):
    """Tremor of the table: noise acceleration on every free node, white below half of 1 / interval_s."""

    acceleration_m_s2_sqrt_hz: Annotated[float, Field(ge=0)]
    interval_s: Positive = 1.0 / 120.0


class Release(Strict):
    """At the start one node is displaced by a constant force, then released."""

    node: str
    force_n: Annotated[list[float], Field(min_length=2, max_length=2)]


class Pokes(Strict):
    """Pokes of the outer nodes by a rod at random times: half a sine wave in a random direction.

    acceleration_m_s2: the largest force by the node's mass; each poke has between the part `weakest` and all of it
    pause_s: mean of the exponential pause between two pokes
    together: all of the nodes at once, in the same direction, and not one of them at random
    """

    nodes: Annotated[list[str], Field(min_length=1)]
    acceleration_m_s2: Positive
    shortest_s: Positive
    longest_s: Positive
    pause_s: Positive
    weakest: Annotated[float, Field(gt=0, le=1)] = 0.3
    together: bool = False

    @model_validator(mode="after")
    def _ordered(self) -> Pokes:
        if self.longest_s < self.shortest_s:
            raise ValueError(f"expected longest_s of at least shortest_s ({self.shortest_s}), found {self.longest_s}")
        return self


class Breathing(Strict):
    """Periodic forces on nodes as of breathing: a wave and half as much of its second harmonic.

    shortest_s, longest_s: between which the period is drawn, the same for the whole run
    acceleration_m_s2: of the first wave, by the node's mass, along `direction`
    """

    nodes: Annotated[list[str], Field(min_length=1)]
    acceleration_m_s2: Positive
    shortest_s: Positive
    longest_s: Positive
    direction: Annotated[list[float], Field(min_length=2, max_length=2)] = Field(default=[0.3, 1.0])

    @model_validator(mode="after")
    def _ordered(self) -> Breathing:
        if self.longest_s < self.shortest_s:
            raise ValueError(f"expected longest_s of at least shortest_s ({self.shortest_s}), found {self.longest_s}")
        if not any(self.direction):
            raise ValueError("direction: expected one other than nought, found nought")
        return self


class Marks(Strict):
    """One disc on each free node; the hidden one is drawn too, for scoring only."""

    hue_deg: Annotated[float, Field(ge=0, lt=360)] = 0.0
    diameter_mm: Positive = 30.0


class Camera(Strict):
    """A camera squarely before the plane."""

    size_px: Annotated[list[Annotated[int, Field(ge=64, le=8192)]], Field(min_length=2, max_length=2)]
    mm_per_px: Annotated[list[Scale], Field(min_length=2, max_length=2)]
    centre_mm: Annotated[list[float], Field(min_length=2, max_length=2)] = Field(default=[0.0, 190.0])
    light: Literal["webcam", "paper"] = "webcam"
    distractors: Annotated[int, Field(ge=0, le=50)] = 0
    calibration_sd_px: Annotated[float, Field(ge=0)] = 0.0


class Video(Strict):
    """How the film is stored."""

    codec: Literal["MJPG", "FFV1"] = "MJPG"
    quality: Annotated[int, Field(ge=1, le=100)] = 95


class Scenario(Strict):
    """A scenario file, version 1."""

    version: Literal[1]
    title: str
    phantom: Literal["four-mass"]
    seed: Annotated[int, Field(ge=0)]
    duration_s: Positive
    frame_interval_s: Positive
    tremor: Tremor | None = None
    release: Release | None = None
    pokes: Pokes | None = None
    breathing: Breathing | None = None
    marks: Marks = Marks()
    camera: Camera
    video: Video = Video()

    @model_validator(mode="after")
    def _lasting(self) -> Scenario:
        if not self.duration_s > self.frame_interval_s:
            raise ValueError(f"duration_s: expected more than frame_interval_s, found {self.duration_s}")
        intervals = {"frame_interval_s": self.frame_interval_s}
        if self.tremor is not None:
            intervals["tremor.interval_s"] = self.tremor.interval_s
        if self.pokes is not None:
            intervals["pokes.pause_s"] = self.pokes.pause_s
        for key, interval_s in intervals.items():
            if self.duration_s / interval_s > MOST_STEPS:
                raise ValueError(f"{key}: expected at most {MOST_STEPS} of them in duration_s, found {interval_s}")
        return self


def shipped() -> list[str]:
    """Names of the scenarios that come with the program."""
    folder = resources.files("experiments") / "scenarios"
    return sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml"))


def read_scenario(name: str) -> Scenario:
    """The scenario of that name, or in that TOML file; raises InputError."""
    if name in shipped():
        with resources.as_file(resources.files("experiments") / "scenarios" / f"{name}.toml") as path:
            return read_toml(path, Scenario)
    path = Path(name)
    if not path.is_file():
        raise InputError(f"{name}: expected one of {', '.join(shipped())} or a scenario file, found neither")
    return read_toml(path, Scenario)
