"""One run: a live session tracks the marks of a body that differs from the scene file. Its display is evaluated."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from estimators import Advice, Status
from experiments.errors import InputError
from experiments.formats.outputs import write_whole
from experiments.formats.scene.scene import Scene, scene_text, usable_scene
from experiments.formats.toml_file import toml_text, toml_value
from experiments.studies.faults.judge import Moment, quiet_folder
from experiments.studies.faults.scripted import Watching, displayed, plan_of
from experiments.studies.faults.wrong_worlds.rows import WORLDS, World
from experiments.studies.faults.wrong_worlds.simulated import (
    BODIES,
    ScriptedMarks,
    lines_of,
    motion_of,
    scene_of_body,
    seen_of,
)

REFUSED = "refused"

REFERENCE_HUE_DEG, REFERENCE_MM = 30.0, 10.0
"""Hue [degrees] and diameter [mm] of the marks on fixed nodes, if the scene has cameras. No other mark has this hue."""


def run(case: Mapping[str, Any]) -> dict[str, Any]:
    """Do one run, and return its figures; case: `world`, `body`, `seed`, and optionally `duration_s` [s]."""
    world, scene = WORLDS[case["world"]], scene_of_body(case["body"])
    duration_s = float(case.get("duration_s", BODIES[case["body"]].duration_s))
    with quiet_folder() as folder:
        try:
            return counted(moments_of(world, scene, case["seed"], duration_s, folder))
        except InputError as error:
            return {**counted([]), REFUSED: True, "shown": _plain(str(error).replace(f"{folder}/", ""))}


def words_of(moment: Moment) -> str:
    """The displayed text without numbers."""
    if moment.advice == str(Advice.GO):
        return moment.advice
    what = moment.status if moment.advice in (None, str(Advice.NO_GUIDANCE)) else moment.advice
    return _plain(f"{what}: {moment.said}" if moment.said else what)


def _plain(text: str) -> str:
    """The text with an ellipsis for each number."""
    return re.sub(r"\d+(\.\d+)?", "…", text)


def moments_of(world: World, scene: Scene, seed: int, duration_s: float, folder: Path) -> list[Moment]:
    """What a live run displays; folder: folder for the run's files. Raises InputError if the scene file is refused."""
    path = folder / "scene.toml"
    write_whole(path, stated_text(world, scene))
    stated = usable_scene(path)
    motion = motion_of(scene, world.truth, seed, duration_s)
    nodes = scene.measured_nodes + (_anchors(scene) if world.reference else ())
    seen = world.seen(seen_of(scene, nodes, motion, seed), np.random.default_rng([seed, 13]))
    frames = ScriptedMarks(stated, lines_of(seen, world.sd_m))
    target, clock = scene.network.index(scene.target.node), partial(getattr, frames, "now_s")
    watching = Watching(motion, target, clock, since_s=world.onset_s)
    try:
        return displayed(watching, frames, stated, plan_of(scene), folder, duration_s, rehearse=False)
    finally:
        frames.close()


def stated_text(world: World, scene: Scene) -> str:
    """Text of the scene file that the filter gets; scene: the true scene."""
    lines = scene_text(world.scene(scene)).splitlines()
    target = lines.index("[target]") + 1
    lines[target:target] = [f"{key} = {toml_value(value)}" for key, value in world.target.items()]
    for anchor in _anchors(scene) if world.reference else ():
        lines += ["", "[[reference.mark]]", f"name = {toml_text(anchor)}", f"node = {toml_text(anchor)}"]
        lines += [f"hue_deg = {REFERENCE_HUE_DEG}", f"diameter_mm = {REFERENCE_MM}"] if scene.cameras else []
    return "\n".join(lines) + "\n"


def _anchors(scene: Scene) -> tuple[str, ...]:
    return tuple(scene.network.names[i] for i in np.flatnonzero(scene.network.fixed))


def counted(moments: list[Moment]) -> dict[str, Any]:
    """Figures of a run from its displays.

    frames: number of frames
    tracking, error_mm: number of frames with the status TRACKING, and median error in these frames [mm]
    tracking_wrong, covered: numbers of TRACKING frames with a wrong estimate, and with the truth in the 95 % region
    go: number of displays of GO; go_wrong: number of displays of GO with a wrong estimate
    shown: the text displayed most often
    """
    tracking = [one for one in moments if one.of_frame and one.status == str(Status.TRACKING)]
    go = [one for one in moments if one.advice == str(Advice.GO)]
    shown = Counter(map(words_of, moments)).most_common(1)
    return {
        "frames": sum(one.of_frame for one in moments),
        "tracking": len(tracking),
        "tracking_wrong": sum(one.wrong for one in tracking),
        "covered": sum(one.covered for one in tracking),
        "error_mm": 1e3 * float(np.median([one.error_m for one in tracking])) if tracking else np.nan,
        "go": len(go),
        "go_wrong": sum(one.wrong for one in go),
        "shown": shown[0][0] if shown else "",
        REFUSED: False,
    }
