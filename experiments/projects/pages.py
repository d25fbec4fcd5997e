"""Texts of a new project: commented files and the page of steps, valid for the template's numbers."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dynamics import MassSpringNetwork
from experiments.formats.scenario import NEAR_SD_MM
from experiments.formats.scene.scene import Scene, scene_text
from experiments.formats.toml_file import toml_text, toml_value
from experiments.projects.template import CALIBRATION_SD_PX, RADIUS_MM, Template

FRAMES_PER_S = 30
MOVED_M = 0.01
"""Displacement of a mesh's target by breathing, and of its marks by a lasting poke."""

WAVE = 2.5
"""From the lowest to the highest place in a breath, by the amplitude of its first wave; between 2 and 3 by phases."""

POKE_M_S2 = {2: 10.0, 3: 15.0}
"""Strongest poke by dimension: a soft breast's masses are 40 g and well supported, 40 m/s² is a push of 1 to 2 N."""

HORIZON_S = 1.0
"""Horizon of the search for a better start: five periods of a breast, and half the default of two seconds."""

SPEED_MM_S = 100.0

KEYS = {
    "version": "of the format",
    "gravity_m_s2": "world axes: x right, y up, z toward the camera",
    "position_mm": "position in a picture at rest",
    "mass_kg": "weigh it, or divide the weight of the whole",
    "drag_N_s_m": "viscous, against the ground",
    "friction_N": "Coulomb, against the planes that hold it",
    "fixed": "true for an anchor",
    "stiffness_N_m": "an estimate will do: softaim identify finds it",
    "rest_length_mm": "such that the whole rests as drawn, under gravity: softaim identify --at-rest",
    "damping_N_s_m": "dashpot along the spring: softaim identify finds it",
    "group": "springs of a group share one factor in softaim identify",
    "hue_deg": "0 red, 120 green, 240 blue; softaim hue FILM --at U,V learns it",
    "diameter_mm": "of the spot",
    "measured": "false: seen only in the calibration, or for scoring; filters do not use it",
    "half_width_deg": "range of a pixel's hue about hue_deg",
    "radius_mm": "radius of a hit",
    "position_sd_mm": "0 for the simulated lesion; for a real one the accuracy of its position in the tissue",
    "drift_sd_mm": "0 for the simulated camera; for a real one its possible unnoticed drift",
    "size_px": "of the picture",
    "plane_to_px": "plane mm to px; softaim calibrate finds it, with the lens",
    "scale_sd": "0 for the simulated camera; for a real one the relative error of its scale",
    "calibration_sd_px": "error of each mark, independent of the others",
}
"""Comment after the first occurrence of a key of scene.toml."""

MESH_KEYS = {
    "file": "tetrahedra at rest, by softaim new",
    "sha256": "of that file",
    "fixed": 'the nodes that are held, "y < 6" in mm, "region 3" or "wall"; left out: none',
    "region": "number of the tissue in the file",
    "young_kpa": "Young's modulus, from a test: softaim identify hardly determines it",
    "poisson": "Poisson's ratio, up to 0.495",
    "density_kg_m3": "mass by volume",
    "damping_s": "damping by stiffness",
    "position_mm": "of a mark on the surface, or of the target inside, at rest",
}
"""The same in a scene of a mesh."""

TABLES = {
    "[mesh]": "The tissue: a mesh of tetrahedra.",
    "[[mesh.tissue]]": "Its tissues; docs/meshes.md has their constants with sources.",
    "[[mesh.point]]": "Its points, as nodes of marks and target.",
    "[network]": "The tissue: point masses, and springs with dashpots between them.",
    "[[mark]]": "Coloured spots, at most one on each node.",
    "[target]": "The hidden target point of the needle.",
    "[reference]": "The camera's own motion; a [[reference.mark]] on an anchor or the rig measures it.",
    "[filter]": "The settings of the filter.",
    "[[camera]]": "A camera square to the plane z = 0.",
}
"""Comment above the first occurrence of a table of scene.toml."""


def commented(lines: list[str]) -> list[str]:
    """Lines of a scene file, with the meaning of each key at its first occurrence."""
    tables, keys = dict(TABLES), KEYS | (MESH_KEYS if "[mesh]" in lines else {})
    found = []
    for line in lines:
        if line in tables:
            found.append(f"# {tables.pop(line)}")
        key = line.split(" = ", maxsplit=1)[0]
        own = keys.pop(key, None) if " = " in line else None
        if own is None:
            found.append(line)
        elif line.endswith("["):  # a matrix, row by row
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
        strongest, breath = _soft_poke_m_s2(network), _breath(of)
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
            _with("[tremor]", "of the table, on every mass"),
            "acceleration_m_s2_sqrt_hz = 0.05",
            "",
            _with("[pokes]", "by a rod, on one of these outer nodes at a time"),
            f"nodes = [{', '.join(toml_text(node) for node in of.assumed.measured_nodes)}]",
            _with(f"acceleration_m_s2 = {strongest:.1f}", "the strongest, over the mass of its node"),
            _with("shortest_s = 0.1", "half a sine wave, shortest ..."),
            _with("longest_s = 0.4", "... and longest"),
            _with("pause_s = 1.5", "between two, on average"),
            *breath,
        ]
    if of.assumed.network.dim == 3:
        lines += [
            "",
            _with("[marks]", "in space a tracker's marks.csv replaces a film"),
            _with(f"sd_mm = {NEAR_SD_MM}", "of a mark, an axis"),
        ]
    else:
        wander = f"marks wander by {CALIBRATION_SD_PX} px: calibration_sd_px of the scene"
        lines += ["", "[video]", _with('light = "paper"', wander)]
    return "\n".join(lines) + "\n"


def _soft_poke_m_s2(network: MassSpringNetwork) -> float:
    """Acceleration of a poke that, if it lasted, would move the median point of a continuum by `MOVED_M`."""
    compliance = np.linalg.inv(network.continuum.stiffness).diagonal()  # type: ignore[union-attr]
    return float(MOVED_M / (np.median(compliance) * network.masses[network.free[0]]))


def _breath(of: Template) -> tuple[str, ...]:
    """Breathing that moves the target by `MOVED_M` in the direction in which it moves the most."""
    network = of.assumed.network
    moved = network.continuum.accelerated[network.coordinates(of.assumed.target.node)]  # type: ignore[union-attr]
    _, sizes, right = np.linalg.svd(moved)
    way = right[0] * np.sign(right[0][np.abs(right[0]).argmax()])
    direction = toml_value(np.round(way, 3))
    return (
        "",
        _with("[breathing]", f"moves the target by some {1e3 * MOVED_M:.0f} mm"),
        _with(f"acceleration_m_s2 = {MOVED_M / WAVE / sizes[0]:.3g}", "of all of the mass"),
        f"direction = {direction}",
        _with("shortest_s = 3.5", "period, shortest ..."),
        _with("longest_s = 4.5", "... and longest; constant in a run"),
    )


def _with(line: str, comment: str) -> str:
    """A line of a file with its meaning."""
    return f"{line:<36} # {comment}"


def needle_page(of: Template) -> str:
    """The needle's file with comments."""
    target = of.assumed.target.node
    entry, way = np.round(1e3 * of.entry_m, 1) + 0.0, np.round(of.direction, 4) + 0.0
    lines = [
        "# The needle for softaim advise; omitted keys have defaults, see docs/guidance.md.",
        "version = 1",
        _with(f"entry_mm = {toml_value(entry)}", "where it enters the tissue"),
        _with(f"direction = {toml_value(way)}", f"to where the target {target} is once the needle has pushed it"),
        _with(f"speed_mm_s = {SPEED_MM_S}", "along a straight line"),
        _with("depth_mm = 0.0", "present depth of the tip beyond the entry"),
        _with('hit = "NOTCH"', "the middle of the notch has to lie in the lesion; or TIP, CORE"),
        _with("notch_offset_mm = 5.0", "from the tip back to the notch: measure your needle"),
        "notch_length_mm = 20.0",
        _with("tip_sd_mm = 0.5", "of the tracked tip, in each direction"),
        _with("bending_sd_mm_per_mm = 0.02", "across the needle, by depth"),
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
    return _filled(STEPS if of.assumed.mesh is None else _of_mesh(STEPS), words)


def _of_mesh(text: str) -> str:
    """The page of steps for a mesh, which rests as drawn: without the step that finds the rest shape."""
    head, _, tail = text.partition("## 3. ")
    words = {
        TRUTH_OF_SPRINGS: TRUTH_OF_MESH,
        "the network, its marks": "the mesh `mesh.npz`, its tissues, its marks",
        CONSTANTS_OF_SPRINGS: CONSTANTS_OF_MESH,
        "--scene rest.toml": "--scene scene.toml",
        **{f"## {k}. ": f"## {k - 1}. " for k in range(4, 8)},
    }
    page = head + tail[tail.index("## 4. ") :]
    for old, new in words.items():
        page = page.replace(old, new)
    return page


def _filled(text: str, words: Mapping[str, str]) -> str:
    for key, word in words.items():
        text = text.replace(f"<{key}>", word)
    return text


REAL_FILM = """\
With a real phantom, films replace step 2: calibrate the camera (`softaim calibrate`),
learn the hues of the marks (`softaim hue FILM --at U,V`), write both into `scene.toml`, and record. In `still` and
`calibration` every mark is seen, also the target's; in `rec` those inside may be covered.

```sh
softaim record 0 --out still --scene scene.toml --seconds 2
softaim record 0 --out calibration --scene scene.toml --seconds 20
softaim record 0 --out rec --scene scene.toml --seconds 20
```
"""

REAL_MARKS = """\
With a real body, recordings of a tracker replace step 2: folders with `scene.toml` and `marks.csv`
(`time_s,node,x_mm,y_mm,z_mm,sd_mm`). In `still` and `calibration` every mark is seen, also those inside, by CT or
ultrasound; in `rec` only those on the outside.
"""

TRUTH_OF_SPRINGS = """\
The constants of `truth/` differ from those of `scene.toml`: stiffnesses by some 10 %, dashpots, drag and friction by
some 20 %, and each spring by a few per cent more. So it does not rest as drawn, like real tissue.
"""

TRUTH_OF_MESH = """\
The constants of `truth/` differ from those of `scene.toml`: the stiffness of each tissue by some 10 %, its damping by
some 20 %. Both rest as drawn.
"""

CONSTANTS_OF_SPRINGS = """\
Stiffness, dashpots, drag and friction come from a recording with pushes in which the target is seen. Push where the
measured marks are: a push on any other node would look like a wrong constant.
"""

CONSTANTS_OF_MESH = """\
The stiffness of each tissue has a standard error of 30 % at first. The target has to be seen in the recording. Forces
are unknown, so only fast motion shows the stiffness, and weakly: expect that this recording does not determine it, and
that `identified.toml` keeps the value of `scene.toml` with its error, which the next steps consider. No recording
states a known force, such as a weight. If a test of the tissue gives its stiffness, set `young_kpa`.
"""

STEPS = f"""\
# <title>: from nothing to advice

Type these lines in this folder, in this order. They take some minutes in all, and each prints its result.

| file | what it is |
| --- | --- |
| `scene.toml` | your assumptions: the network, its marks, its target <target>. Adapt it to your tissue |
| `needle.toml` | the needle that is advised |
| `truth/scene.toml` | the simulated tissue, to be identified. Only `simulate` reads it |
| `truth/all_marks.toml` | the same, all marks measured: for calibration |
| `still.toml`, `calibration.toml`, `scenario.toml` | scenarios of three simulated recordings |

{TRUTH_OF_SPRINGS}
## 1. Check the scene

```sh
softaim check scene.toml --out check
```

Look at `check/check.png`. `missing` names what the next steps bring.

## 2. Simulate recordings

Each is <recorded>, with its truth for scoring.

```sh
softaim simulate still.toml --out still
softaim simulate calibration.toml --out calibration
softaim simulate scenario.toml --out rec
```

<real>
## 3. Identify the rest shape

Rest lengths come from the picture at rest: otherwise the model sags under gravity, and the target's estimate is biased.

```sh
softaim identify still --at-rest --scene scene.toml --out rest.toml
```

## 4. Identify the constants

{CONSTANTS_OF_SPRINGS}
```sh
softaim identify calibration --scene rest.toml --out identified.toml
```

## 5. Tune the noise levels

Tune before advice, by the prediction of each mark from the others: with too high levels advice waits, with too low
levels it gives GO too early.

```sh
softaim tune rec --scene identified.toml --out tuned.toml
```

## 6. Track the target

```sh
softaim track rec --scene tuned.toml --out track
```

`track/path.png` shows the target's path, true and estimated, with its ellipses.

## 7. Get advice

```sh
softaim advise rec --scene tuned.toml --needle needle.toml --out advice
```

`advice/advice.png` shows when to go, when to wait and when to realign.
"""
