"""Texts of a new project: commented files and the page of steps, with the template's numbers."""

from __future__ import annotations

import numpy as np

from experiments.formats.scenario import NEAR_SD_MM
from experiments.formats.scene.scene import Scene, scene_text
from experiments.formats.toml_file import toml_text, toml_value
from experiments.projects.steps_text import (
    CONSTANTS_OF_MESH,
    CONSTANTS_OF_SPRINGS,
    REAL_FILM,
    REAL_MARKS,
    STEPS,
    TRUTH_OF_MESH,
    TRUTH_OF_SPRINGS,
)
from experiments.projects.template import CALIBRATION_SD_PX, RADIUS_MM, Template

FRAMES_PER_S = 30
MOVED_M = 0.01
"""Displacement of a mesh's target by breathing [m]."""

POKED_M = 0.02
"""Displacement [m] of a mesh's softest mark if the strongest poke's force acted steadily; choice: as by a probe."""

WAVE = 2.5
"""Range of a breath divided by the amplitude of its first harmonic [1]; 2 to 3, depending on the harmonics' phases."""

POKE_M_S2 = {2: 10.0, 3: 15.0}
"""Acceleration in the strongest poke [m/s²], for each dimension of the tissue; choice: 15 m/s² is 0.6 N on 40 g."""

HORIZON_S = 1.0
"""Time from now within which advice looks for the best time to start [s]: five periods of a breast's oscillation."""

SPEED_MM_S = 100.0

KEYS = {
    "version": "of the format",
    "gravity_m_s2": "world axes: x right, y up, z toward the camera",
    "position_mm": "position in a picture at rest",
    "mass_kg": "weigh it, or divide the body's mass among its nodes",
    "drag_N_s_m": "viscous, against the ground",
    "friction_N": "Coulomb, against the planes that hold it",
    "fixed": "true for an anchor",
    "stiffness_N_m": "a rough value is enough: softaim identify finds it",
    "rest_length_mm": "such that the body rests as drawn under gravity: softaim identify --at-rest",
    "damping_N_s_m": "dashpot along the spring: softaim identify finds it",
    "group": "springs of a group share one factor in softaim identify",
    "hue_deg": "0 red, 120 green, 240 blue; softaim hue FILM --at U,V learns it",
    "diameter_mm": "of the spot",
    "measured": "false: only for calibration or scoring; filters do not use this mark",
    "half_width_deg": "range of a pixel's hue about hue_deg",
    "radius_mm": "radius of a hit",
    "position_sd_mm": "0 for the simulated lesion without --target-sd-mm; for a real one the accuracy of its position",
    "drift_sd_mm": "0 for the simulated camera; for a real one its possible unnoticed drift",
    "size_px": "of the picture",
    "plane_to_px": 'plane mm to px; file = "camera.toml" of softaim calibrate replaces name, size_px and this key',
    "scale_sd": "0 for the simulated camera; for a real one the relative error of its scale",
    "calibration_sd_px": "error of each mark, independent of the others",
}
"""Comment after the first occurrence of a key of scene.toml."""

MESH_KEYS = {
    "file": "tetrahedra at rest, by softaim new",
    "sha256": "of that file",
    "fixed": 'the fixed nodes: "y < 6" in mm, "region 3" or "wall"; without this key: none',
    "driven": "true: the wall moves as a rigid body, in an unknown way; false: it is still",
    "region": "number of the tissue in the file",
    "young_kpa": "Young's modulus, from a test: softaim identify hardly determines it",
    "poisson": "Poisson's ratio, up to 0.495",
    "density_kg_m3": "mass per volume",
    "damping_s": "damping divided by stiffness",
    "position_mm": "of a mark on the surface, or of the target inside, at rest",
}
"""Comment after the first occurrence of a key of `[mesh]`."""

TABLES = {
    "[mesh]": "The tissue: a mesh of tetrahedra.",
    "[[mesh.tissue]]": "Its tissues; docs/meshes.md has their constants with sources.",
    "[[mesh.point]]": "Its points, as nodes of marks and target.",
    "[network]": "The tissue: point masses, and springs with dashpots between them.",
    "[[mark]]": "Coloured spots, at most one on each node.",
    "[target]": "The hidden target point of the needle.",
    "[reference]": "The camera's own motion; a [[reference.mark]] on an anchor or the rig measures it.",
    "[filter]": "The settings of the filter.",
    "[[camera]]": "A camera perpendicular to the plane z = 0.",
}
"""Comment above the first occurrence of a table of scene.toml."""


def commented(lines: list[str]) -> list[str]:
    """Lines of a scene file, with a comment on each key at its first occurrence."""
    tables, keys = dict(TABLES), KEYS | (MESH_KEYS if "[mesh]" in lines else {})
    found = []
    for line in lines:
        if line in tables:
            found.append(f"# {tables.pop(line)}")
        key = line.split(" = ", maxsplit=1)[0]
        own = keys.pop(key, None) if " = " in line else None
        if own is None:
            found.append(line)
        elif line.endswith("["):  # a row of a matrix
            found += [f"# {key}: {own}", line]
        else:
            found.append(_with(line, own))
    return found


def scene_page(scene: Scene, heading: str, *, after: str = "") -> str:
    """A scene file with comments."""
    lines = commented(scene_text(scene).splitlines())
    return "\n".join([*(f"# {line}".rstrip() for line in heading.splitlines()), *lines, after]).rstrip() + "\n"


UNTUNED = """
# Still missing; commands write them into copies of this file:
# [uncertainty] of the constants: softaim identify
# in [filter], the model error of this tissue, or noise levels: softaim tune
"""


def scenario_page(of: Template, *, what: str, scene: str, seed: int, seconds: float, pokes: bool) -> str:
    """A scenario file with comments."""
    network, strongest = of.assumed.network, POKE_M_S2[of.assumed.network.dim]
    breath: tuple[str, ...] = ()
    if network.continuum is not None:
        strongest, breath = _soft_poke_m_s2(of.assumed), _breath(of)
    lines = [
        f"# {what}",
        "version = 1",
        f"title = {toml_text(f'{of.title}: {what[0].lower()}{what[1:]}')}",
        _with(f"scene = {toml_text(scene)}", "the simulated tissue, which differs from what scene.toml states"),
        _with(f"seed = {seed}", "or another one by softaim simulate --seed"),
        f"duration_s = {seconds:.1f}",
        _with(f"frame_interval_s = {1.0 / FRAMES_PER_S:.6f}", f"{FRAMES_PER_S} frames/s"),
    ]
    if pokes:
        lines += [
            "",
            _with("[tremor]", "of the table, accelerates every mass"),
            "acceleration_m_s2_sqrt_hz = 0.05",
            "",
            _with("[pokes]", "by a rod, on one of these outer nodes at a time"),
            f"nodes = [{', '.join(toml_text(node) for node in of.assumed.measured_nodes)}]",
            _with(f"acceleration_m_s2 = {strongest:.1f}", "largest force divided by the mass of its node"),
            _with("shortest_s = 0.1", "duration, half a sine wave, shortest ..."),
            _with("longest_s = 0.4", "... and longest"),
            _with("pause_s = 1.5", "between two, on average"),
            *breath,
        ]
    if of.assumed.network.dim == 3:
        lines += [
            "",
            _with("[marks]", "in space a tracker's marks.csv replaces a film"),
            _with(f"sd_mm = {NEAR_SD_MM}", "of a mark on each axis"),
        ]
    else:
        wander = f"marks wander by {CALIBRATION_SD_PX} px: calibration_sd_px of the scene"
        lines += ["", "[video]", _with('light = "paper"', wander)]
    return "\n".join(lines) + "\n"


def _soft_poke_m_s2(scene: Scene) -> float:
    """Acceleration of the strongest poke [m/s²]. If it acted steadily, the softest mark would move by `POKED_M`."""
    network = scene.network
    compliance = np.linalg.inv(network.continuum.stiffness)  # type: ignore[union-attr]
    own = [network.coordinates(node) for node in scene.measured_nodes]
    softest = max(float(np.linalg.norm(compliance[at, at], 2)) for at in own)
    return float(POKED_M / (softest * network.masses[network.free[0]]))


def _breath(of: Template) -> tuple[str, ...]:
    """Lines of a scenario: breathing that moves the target by `MOVED_M` in the direction in which it yields most."""
    network = of.assumed.network
    moved = network.continuum.accelerated[network.coordinates(of.assumed.target.node)]  # type: ignore[union-attr]
    _, sizes, right = np.linalg.svd(moved)
    way = right[0] * np.sign(right[0][np.abs(right[0]).argmax()])
    direction = toml_value(np.round(way, 3))
    return (
        "",
        _with("[breathing]", f"moves the target by some {1e3 * MOVED_M:.0f} mm"),
        _with(f"acceleration_m_s2 = {MOVED_M / WAVE / sizes[0]:.3g}", "of the whole body"),
        f"direction = {direction}",
        _with("shortest_s = 3.5", "period, shortest ..."),
        _with("longest_s = 4.5", "... and longest; constant in a run"),
    )


def _with(line: str, comment: str) -> str:
    """A line of a file with a comment on its meaning."""
    return f"{line:<36} # {comment}"


def needle_page(of: Template) -> str:
    """The needle's file with comments."""
    target = of.assumed.target.node
    entry, way = np.round(1e3 * of.entry_m, 1) + 0.0, np.round(of.direction, 4) + 0.0
    lines = [
        "# The needle for softaim advise; omitted keys have defaults, see docs/guidance.md.",
        "version = 1",
        _with(f"entry_mm = {toml_value(entry)}", "where it enters the tissue"),
        _with(f"direction = {toml_value(way)}", f"to the target {target} as displaced by the needle"),
        _with(f"speed_mm_s = {SPEED_MM_S}", "along a straight line"),
        _with("depth_mm = 0.0", "present depth of the tip beyond the entry"),
        _with('hit = "NOTCH"', "the middle of the notch has to lie in the lesion; or TIP, CORE"),
        _with("notch_offset_mm = 5.0", "from the tip back to the notch: measure your needle"),
        "notch_length_mm = 20.0",
        _with("tip_sd_mm = 0.5", "of the tracked tip, in each direction"),
        _with("bending_sd_mm_per_mm = 0.02", "across the needle, per depth"),
        "",
        "[lesion]",
        _with(f"radius_mm = {RADIUS_MM}", "around the target"),
        "",
        "[advice]",
        _with("go = 0.9", "least probability of a hit for GO"),
        _with(f"horizon_s = {HORIZON_S}", "how far ahead a better start is searched"),
    ]
    return "\n".join(lines) + "\n"


def steps_page(of: Template) -> str:
    """STEPS.md: the commands in order, with reasons."""
    film = of.assumed.network.dim == 2
    words = {
        "title": of.title,
        "target": of.assumed.target.node,
        "recorded": "a film" if film else "marks of a simulated tracker (`marks.csv`)",
        "real": REAL_FILM if film else REAL_MARKS,
    }
    page = STEPS if of.assumed.mesh is None else _of_mesh(STEPS)
    for key, word in words.items():
        page = page.replace(f"<{key}>", word)
    return page


def _of_mesh(text: str) -> str:
    """Text of STEPS.md for a mesh: without the step that finds the rest shape, because a mesh is drawn at rest."""
    head, _, tail = text.partition("## 3. ")
    words = {
        TRUTH_OF_SPRINGS: TRUTH_OF_MESH,
        "the network, its marks": "the mesh `mesh.npz`, its tissues, its marks",
        CONSTANTS_OF_SPRINGS: CONSTANTS_OF_MESH,
        "--scene rest.toml": "--scene scene.toml",
        "softaim simulate still.toml --out still\n": "",
        **{f"## {k}. ": f"## {k - 1}. " for k in range(4, 8)},
    }
    page = head + tail[tail.index("## 4. ") :]
    for old, new in words.items():
        page = page.replace(old, new)
    return page
