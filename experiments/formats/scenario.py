"""Scenario files for simulations. A scenario names a scene or the phantom, and states the forces on the tissue."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, create_model, model_validator

from dynamics import KINDS, OUTER, MassSpringNetwork, four_mass_phantom
from experiments.errors import InputError, no_node, shown
from experiments.formats.scenario_forces import Breathing, Pokes, Posture, Press, Release, Tremor
from experiments.formats.scene.scene import usable_scene
from experiments.formats.toml_file import Name, NotNegative, Positive, Strict, check_axes, read_toml

Scale = Annotated[float, Field(ge=0.01, le=1000)]
SCENARIOS = Path(__file__).parents[1] / "scenarios"
STEPS = "STEPS.md"
"""Name of the file in a project's scenario folder that lists the project's steps."""

MOST_STEPS = 1_000_000
"""Largest number of frames, tremor samples or pokes: 9 hours at 30 frames/s. A larger number is a typing error."""

PAPER_SD_MM = 4.14
"""Standard deviation of the marks in [paper] on each axis [mm]."""

NEAR_SD_MM = 0.5
"""Default standard deviation of marks for a user's scene [mm], typical of a tracker or a webcam close to a phantom."""

OPPOSITE = np.cos(np.radians(179.0))
"""Cosine of 179 degrees: directions at a larger angle count as opposite."""

Share = Annotated[float, Field(ge=0, lt=1)]
Light = Literal["webcam", "paper"]
Distractors = Annotated[int, Field(ge=0, le=50)]


Constants = create_model(  # type: ignore[call-overload]
    "Constants", __base__=Strict, **dict.fromkeys(KINDS, (Share, 0.0))
)
"""Relative standard deviations by which true constants differ from the scene's constants, for each kind of constant.
The seed determines the true constants; the filter uses the scene's constants."""


class SeenMarks(Strict):
    """Errors of simulated marks in a recording without a film.

    sd_mm: standard deviation of a mark's error on each axis; all methods know it; by default the value in [paper]
    lost: share of missing marks; outliers: share of marks that are 30 to 150 mm from the true position
    """

    sd_mm: Positive = PAPER_SD_MM
    lost: Share = 0.0
    outliers: Share = 0.0


class Marks(SeenMarks):
    """Errors of simulated marks in a recording without a film, and the hue and diameter of the phantom's discs.

    The phantom has a disc on each free node. The disc on the hidden node only serves to score estimates.
    """

    sd_mm: Positive | None = None  # type: ignore[assignment]
    hue_deg: Annotated[float, Field(ge=0, lt=360)] = 0.0
    diameter_mm: Positive = 30.0


class Camera(Strict):
    """The camera of the phantom; its optical axis is perpendicular to the phantom's plane."""

    size_px: Annotated[list[Annotated[int, Field(ge=64, le=8192)]], Field(min_length=2, max_length=2)]
    mm_per_px: Annotated[list[Scale], Field(min_length=2, max_length=2)]
    centre_mm: Annotated[list[float], Field(min_length=2, max_length=2)] = Field(default=[0.0, 190.0])
    light: Light = "webcam"
    distractors: Distractors = 0
    calibration_sd_px: Annotated[float, Field(ge=0)] = 0.0


class Video(Strict):
    """Format of the film.

    light: light of the film; distractors: number of objects whose hues differ from those of marks
    stagger_s: delay between the exposures of successive cameras in space
    A scenario of the phantom has the keys `light` and `distractors` in [camera], not in this table.
    """

    light: Light = "webcam"
    distractors: Distractors = 0
    codec: Literal["MJPG", "FFV1"] = "MJPG"
    quality: Annotated[int, Field(ge=1, le=100)] = 95
    stagger_s: NotNegative = 0.0


class Scenario(Strict):
    """A scenario file, version 1. When it is read, `scene` becomes a path relative to the current folder."""

    version: Literal[1]
    title: str = ""
    scene: Name | None = None
    phantom: Literal["four-mass"] | None = None
    seed: Annotated[int, Field(ge=0)] = 0
    duration_s: Positive = 20.0
    frame_interval_s: Positive = 1.0 / 30.0
    tremor: Tremor | None = None
    release: Release | None = None
    pokes: Pokes | None = None
    breathing: Breathing | None = None
    posture: Posture | None = None
    press: list[Press] = Field(default=[])
    constants: Constants | None = None  # type: ignore[valid-type]
    marks: Marks = Marks()
    camera: Camera | None = None
    video: Video = Video()

    @model_validator(mode="after")
    def _one_world(self) -> Scenario:
        if (self.scene is None) == (self.phantom is None):
            found = "none" if self.scene is None else "both"
            raise ValueError(f"expected either scene or phantom, found {found}")
        if self.phantom is not None and self.camera is None:
            raise ValueError("camera: expected this table beside phantom, found none")
        if self.scene is not None and self.camera is not None:
            raise ValueError("camera: expected no such table beside scene, whose own camera is used, found one")
        of_scene, of_phantom = (self.video, ("light", "distractors")), (self.marks, ("hue_deg", "diameter_mm"))
        other, (table, keys) = ("phantom", of_scene) if self.scene is None else ("scene", of_phantom)
        for key in keys:
            if key in table.model_fields_set:
                name, own = ("video", "camera") if other == "phantom" else ("marks", "mark")
                raise ValueError(f"{name}.{key}: expected this key in {own} with {other}, found it here")
        return self

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
                raise ValueError(f"{key}: expected duration_s / {MOST_STEPS} or more, found {interval_s}")
        return self

    @property
    def light(self) -> str:
        """Light of the film: `webcam` or `paper`."""
        return self.video.light if self.camera is None else self.camera.light

    @property
    def distractors(self) -> int:
        """Number of visible objects whose hues differ from those of the marks."""
        return self.video.distractors if self.camera is None else self.camera.distractors

    @property
    def seen(self) -> SeenMarks:
        """Errors of simulated marks in a recording without a film."""
        usual = PAPER_SD_MM if self.scene is None else NEAR_SD_MM
        sd_mm = usual if self.marks.sd_mm is None else self.marks.sd_mm
        return SeenMarks(sd_mm=sd_mm, lost=self.marks.lost, outliers=self.marks.outliers)


def shipped() -> list[str]:
    """Names of the shipped scenarios."""
    return sorted(path.stem for path in SCENARIOS.glob("*.toml"))


def read_scenario(name: str) -> Scenario:
    """Read a scenario, given by name or TOML file, and add the default values for its tissue; raises InputError."""
    scenario = read_scenario_file(name)
    if scenario.scene is None:
        return completed(scenario, four_mass_phantom(), OUTER, name)
    scene = usable_scene(Path(scenario.scene))
    return completed(scenario, scene.network, scene.measured_nodes, name)


def read_scenario_file(name: str) -> Scenario:
    """Read a scenario by its name or TOML file. The nodes that it names are not checked. Raises InputError."""
    path = SCENARIOS / f"{name}.toml" if name in shipped() else Path(name)
    if not path.is_file():
        raise InputError(f"{name}: expected one of {', '.join(shipped())} or a scenario file, found neither")
    scenario = read_toml(path, Scenario)
    if scenario.scene is None:
        return scenario
    return scenario.model_copy(update={"scene": str(path.parent / scenario.scene)})


def completed(scenario: Scenario, network: MassSpringNetwork, marked: Sequence[str], place: str) -> Scenario:
    """The scenario with default values for this network; raises InputError for values that do not fit the network.

    marked: nodes whose marks the filter uses; place: name of the scenario, for messages
    """
    change: dict[str, object] = {}
    for key in ("pokes", "breathing"):
        table: Pokes | Breathing | None = getattr(scenario, key)
        if table is not None:
            for i, node in enumerate(table.nodes or ()):
                _check_free(network, node, f"{place}: {key}.nodes[{i}]")
            everywhere = key == "breathing" and network.continuum is not None and table.nodes is None
            if everywhere and not network.fixed.any():
                raise InputError.at(f"{place}: breathing.nodes", "nodes, as the mesh has no anchors", "none")
            if table.nodes is None and not everywhere:
                change[key] = table.model_copy(update={"nodes": list(marked)})
    if scenario.release is not None:
        _check_free(network, scenario.release.node, f"{place}: release.node")
        check_axes(f"{place}: release.force_n", scenario.release.force_n, network.dim)
    if scenario.breathing is not None and scenario.breathing.direction is not None:
        check_axes(f"{place}: breathing.direction", scenario.breathing.direction, network.dim)
    for k, press in enumerate(scenario.press):
        for i, node in enumerate(press.nodes):
            _check_free(network, node, f"{place}: press[{k}].nodes[{i}]")
        check_axes(f"{place}: press[{k}].force_n", press.force_n, network.dim)
    if scenario.posture is not None:
        change["posture"] = _of_scene(scenario.posture, network, f"{place}: posture")
    return scenario.model_copy(update=change)


def _of_scene(posture: Posture, network: MassSpringNetwork, place: str) -> Posture:
    """The posture; the network's gravity replaces a missing `from_m_s2`. InputError for an undefined rotation."""
    start = network.gravity.tolist() if posture.from_m_s2 is None else posture.from_m_s2
    for key, gravity in (("from_m_s2", start), ("to_m_s2", posture.to_m_s2)):
        check_axes(f"{place}.{key}", gravity, network.dim)
        if not any(gravity):
            raise InputError.at(f"{place}.{key}", "a non-zero vector [m/s²]", "zero")
    if np.dot(start, posture.to_m_s2) < OPPOSITE * np.linalg.norm(start) * np.linalg.norm(posture.to_m_s2):
        raise InputError.at(
            f"{place}.to_m_s2", "less than half a turn, whose axis is defined", "the opposite direction"
        )
    if network.continuum is not None and not network.fixed.any():
        raise InputError.at(place, "a mesh with anchors", "one without")
    return posture.model_copy(update={"from_m_s2": start})


def _check_free(network: MassSpringNetwork, node: str, place: str) -> None:
    if node not in network.names:
        raise InputError(f"{place}: {no_node(node, network.names)}")
    if network.fixed[network.index(node)]:
        raise InputError.at(place, "a free node", f"the anchor {shown(node)}")


def scenario_file(name: str) -> Path | None:
    """The file of a scenario; None for a scenario that comes with the program."""
    return None if name in shipped() else Path(name)


def scene_file(scenario: Scenario) -> Path | None:
    """The scene file of a scenario; None for a scenario with a phantom."""
    return None if scenario.scene is None else Path(scenario.scene)
