"""Tables and keys of `scene.toml`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

from pydantic import Field, model_validator

from dynamics import KINDS
from experiments.formats.toml_file import Coordinates, Name, NotNegative, Positive, Row, Square, Strict, Three


class SceneError(ValueError):
    """Error for inconsistent parts of a scene: `key: expected …, found …` with keys of scene.toml."""


def check_own_names(key: str, names: Sequence[str]) -> None:
    """Raise SceneError if two of the tables `key[i]` have the same name."""
    for i, name in enumerate(names):
        if (first := names.index(name)) < i:
            raise SceneError(f"{key}[{i}].name: expected a unique name, found that of {key}[{first}]")


def where(dim: int) -> str:
    """Where a body of this dimension lies, in words."""
    return "in the plane" if dim == 2 else "in space"


def check_dim(key: str, place: Sequence[float], dim: int) -> None:
    """Raise SceneError if a position has another dimension than the scene."""
    if len(place) != dim:
        raise SceneError(f"{key}: expected {dim} numbers, because the body is {where(dim)}, found {len(place)}")


class NodeTable(Strict):
    """`[[network.node]]`; an anchor may omit its mass."""

    name: Name
    position_mm: Coordinates
    mass_kg: float | None = None
    drag_N_s_m: NotNegative = 0.0  # noqa: N815 (the format's own word)
    friction_N: NotNegative = 0.0  # noqa: N815
    fixed: bool = False


class SpringTable(Strict):
    """`[[network.spring]]`."""

    between: Annotated[list[Name], Field(min_length=2, max_length=2)]
    stiffness_N_m: Positive  # noqa: N815
    rest_length_mm: Positive
    damping_N_s_m: NotNegative = 0.0  # noqa: N815
    group: Name | None = None


NODE_KEYS = {"drag_N_s_m": ("drag", 1.0), "friction_N": ("friction", 1.0)}
"""For each constant in `[[network.node]]`: its field in `MassSpringNetwork`, and the factor to SI units."""

SPRING_KEYS = {
    "stiffness_N_m": ("stiffness", 1.0),
    "rest_length_mm": ("rest_lengths", 1e-3),
    "damping_N_s_m": ("damping", 1.0),
}
"""For each constant in `[[network.spring]]`: its field in `MassSpringNetwork`, and the factor to SI units."""


class NetworkTable(Strict):
    """`[network]`."""

    gravity_m_s2: Coordinates
    node: list[NodeTable]
    spring: list[SpringTable]


class MeshTissueTable(Strict):
    """`[[mesh.tissue]]`: the tissue of all elements with one region number."""

    name: Name
    region: int
    young_kpa: Positive
    poisson: Annotated[float, Field(ge=0, le=0.495)]
    density_kg_m3: Positive
    damping_s: NotNegative


class MeshPointTable(Strict):
    """`[[mesh.point]]`: a named point of the mesh. Points of marks lie on the surface; the target lies inside."""

    name: Name
    position_mm: Three


class MeshTable(Strict):
    """`[mesh]`: a body of tetrahedra instead of a network of springs.

    fixed: text that selects the fixed nodes, see `held`
    driven: whether the fixed nodes move as a rigid body; default: true if there are fixed nodes
    """

    file: Name
    sha256: Name | None = None
    fixed: Name | None = None
    driven: bool | None = None
    tissue: Annotated[list[MeshTissueTable], Field(min_length=1)]
    point: Annotated[list[MeshPointTable], Field(min_length=1)]

    @property
    def wall_moves(self) -> bool:
        """Whether there is a wall that moves."""
        return self.fixed is not None if self.driven is None else self.driven


Hue = Annotated[float, Field(ge=0, lt=360)]


class _LookTable(Strict):
    """Keys that all tables of marks have for the appearance in a film, see `Mark`."""

    half_width_deg: Annotated[float, Field(ge=2, le=90)] = 18.0
    min_saturation: Annotated[float, Field(gt=0, lt=1)] = 0.4
    min_value: Annotated[float, Field(gt=0, lt=1)] = 0.2
    even: bool = True
    ball: bool = False


class MarkTable(_LookTable):
    """`[[mark]]`."""

    node: Name
    hue_deg: Hue
    diameter_mm: Positive
    measured: bool = True


class ReferenceMarkTable(_LookTable):
    """`[[reference.mark]]`: a fixed mark, either on an anchor of the tissue or at a position in the world."""

    name: Name
    node: Name | None = None
    position_mm: Coordinates | None = None
    hue_deg: Hue | None = None
    diameter_mm: Positive | None = None

    @model_validator(mode="after")
    def _one_place(self) -> ReferenceMarkTable:
        if (self.node is None) == (self.position_mm is None):
            found = "neither" if self.node is None else "both"
            raise ValueError(f"expected node or position_mm, found {found}")
        if (self.hue_deg is None) != (self.diameter_mm is None):
            raise ValueError("expected hue_deg and diameter_mm together, found one of them")
        return self


class ReferenceTable(Strict):
    """`[reference]`: fixed marks that correct the pose of a camera or tracker, see `Reference`."""

    drift_sd_mm: NotNegative | None = None
    position_sd_mm: NotNegative = 0.0
    mark: list[ReferenceMarkTable] = Field(default_factory=list)


class TargetTable(Strict):
    """`[target]`."""

    node: Name
    radius_mm: Positive
    offset_mm: Coordinates | None = None
    position_sd_mm: NotNegative | None = None


class CameraTable(Strict):
    """`[[camera]]`: a homography (only in the plane), a lens with or without a pose, or a camera file.

    Camera files of ROS and OpenCV have no pose. With such a file the table may state the pose.
    """

    name: Name | None = None
    size_px: Annotated[list[Annotated[int, Field(gt=0)]], Field(min_length=2, max_length=2)] | None = None
    plane_to_px: Square | None = None
    matrix: Square | None = None
    distortion: Annotated[list[float], Field(min_length=5, max_length=12)] | None = None
    rotation: Square | None = None
    translation_mm: Three | None = None
    uncertainty: list[Row] | None = None
    file: Name | None = None
    calibration_sd_px: NotNegative = 0.0
    scale_sd: NotNegative | None = None

    @model_validator(mode="after")
    def _one_form(self) -> CameraTable:
        pose = ("rotation", "translation_mm")
        forms = {
            "plane_to_px": (("name", "size_px", "plane_to_px"), ()),
            "matrix": (("name", "size_px", "matrix", "distortion"), (*pose, "uncertainty")),
            "file": (("file",), pose),
        }
        given = [key for key in forms if getattr(self, key) is not None]
        if len(given) != 1:
            raise ValueError(f"expected one of {', '.join(forms)}, found {' and '.join(given) or 'none'}")
        needed, optional = forms[given[0]]
        allowed = {*needed, *optional}
        if optional and any(getattr(self, key) is not None for key in optional):
            needed = (*needed, *pose)
        for key in type(self).model_fields:
            if key in needed and getattr(self, key) is None:
                raise ValueError(f"{key}: expected this key beside {given[0]}, found none")
            if key not in {*allowed, "calibration_sd_px", "scale_sd"} and getattr(self, key) is not None:
                raise ValueError(f"{key}: expected no such key beside {given[0]}, found one")
        if self.distortion is not None and len(self.distortion) not in (5, 8, 12):
            raise ValueError(f"distortion: expected 5, 8 or 12 numbers, found {len(self.distortion)}")
        return self


LogSd = Annotated[float, Field(gt=0, le=700)]
"""Standard deviation of the logarithm of a constant; the limit prevents an overflow of the exponential."""


class UncertaintyTable(Strict):
    """`[uncertainty]`: relative standard deviations of the tissue's constants.

    The table has one of two forms. The first form states a standard deviation for each kind of constant. The errors of
    all constants are independent. The second form states `parameters` and `directions`. The rows of `directions` are
    independent errors of the logarithms of the parameters, each of one standard deviation.
    """

    stiffness: LogSd | None = None
    rest_length: LogSd | None = None
    damping: LogSd | None = None
    drag: LogSd | None = None
    friction: LogSd | None = None
    parameters: list[Name] | None = None
    directions: list[list[float]] | None = None

    @model_validator(mode="after")
    def _one_form(self) -> UncertaintyTable:
        kinds = [kind for kind in KINDS if getattr(self, kind) is not None]
        if (self.parameters is None) != (self.directions is None):
            raise ValueError("expected parameters and directions together, found one of them")
        if self.parameters is not None and kinds:
            raise ValueError(f"expected either parameters and directions, or kinds, found both, {kinds[0]}")
        if self.parameters is None and not kinds:
            raise ValueError(f"expected one or more of {', '.join(KINDS)}, or parameters and directions, found none")
        for row in self.directions or ():
            if len(row) != len(self.parameters or ()):
                raise ValueError(f"expected directions of {len(self.parameters or ())} numbers each, found {len(row)}")
        return self


class FilterTable(Strict):
    """`[filter]`: settings that replace the defaults. A hand or robot moves the nodes `led_nodes` all the time."""

    poke_m_s2: Positive | None = None
    poke_lasting_s: Positive | None = None
    strain: Annotated[float, Field(ge=0, le=0.1)] | None = None
    fix_bias_mm: Positive | None = None
    unified: Literal[True] = True
    """Key without effect, permitted because scenes for an earlier filter have it."""
    led_nodes: list[Name] = Field(default_factory=list)


StepName = Literal["simulate", "at-rest", "identify", "tune", "register"]
"""Names of steps. Step `simulate`: the scene has the constants with which the recording in its folder was simulated."""


class Step(Strict):
    """`[[provenance]]`: a processing step that produced the scene; the program writes this table.

    program: version of the program
    recording_sha256: digest of the recording that the step used, if it used one
    network_sha256, scene_sha256: digests of the network and of the whole scene after the step
    kept: constants that the step did not change, because the recording does not determine them
    """

    step: StepName
    program: Name
    recording_sha256: Name | None = None
    network_sha256: Name
    scene_sha256: Name
    kept: list[Name] = Field(default_factory=list)


class SceneFile(Strict):
    """The content of `scene.toml`, version 1."""

    version: int
    network: NetworkTable | None = None
    mesh: MeshTable | None = None
    uncertainty: UncertaintyTable | None = None
    filter: FilterTable | None = None
    mark: list[MarkTable] = Field(default_factory=list)
    target: TargetTable
    reference: ReferenceTable | None = None
    camera: list[CameraTable] = Field(default_factory=list)
    provenance: list[Step] = Field(default_factory=list)

    @model_validator(mode="after")
    def _one_body(self) -> SceneFile:
        if self.network is None and self.mesh is None:
            raise ValueError("network: expected this key, or mesh in its place, found none")
        if self.network is not None and self.mesh is not None:
            raise ValueError("mesh: expected network or mesh, found both")
        return self
