"""The tutorial's commands, typed as they stand."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from experiments.formats.scene.scene import read_scene
from tests.experiments.command import softaim

TUTORIAL = Path(__file__).parents[2] / "docs" / "tutorial.md"


def typed_in_the_tutorial() -> list[list[str]]:
    """Every command of the page's blocks, in order, without `softaim`."""
    blocks = re.findall(r"```sh\n(.*?)```", TUTORIAL.read_text(encoding="utf-8"), re.DOTALL)
    return [line.split()[1:] for block in blocks for line in block.splitlines() if line.startswith("softaim ")]


def steps_of(project: Path) -> list[list[str]]:
    """The commands of a project's STEPS.md, without `softaim` and without those for a real phantom."""
    lines = (project / "STEPS.md").read_text(encoding="utf-8").splitlines()
    commands = [line.split()[1:] for line in lines if line.startswith("softaim ")]
    return [command for command in commands if command[0] != "record"]


def test_the_tutorial_has_the_steps_of_a_new_project(tmp_path):
    new, *steps = typed_in_the_tutorial()
    assert softaim(*(tmp_path / "mine" if word == "mine" else word for word in new)) == 0
    assert steps == steps_of(tmp_path / "mine")
    kinds = [re.sub("identify", "rest", step[0]) if "--at-rest" in step else step[0] for step in steps]
    assert kinds == ["check", *3 * ["simulate"], "rest", "identify", "tune", "track", "advise"]


def shorten(name: str, seconds: float) -> None:
    text = re.sub(r"duration_s = [\d.]+", f"duration_s = {seconds}", Path(name).read_text(encoding="utf-8"))
    Path(name).write_text(text, encoding="utf-8")


@pytest.mark.slow
@pytest.mark.usefixtures("without_pictures", "one_start")
def test_the_tutorial_leads_to_advice(tmp_path, monkeypatch):
    """All commands of the page, 0.3 to 0.8 s in place of 20: the target is followed no worse than by the open loop."""
    monkeypatch.chdir(tmp_path)
    new, *steps = typed_in_the_tutorial()
    assert softaim(*new) == 0
    monkeypatch.chdir(tmp_path / "mine")
    shorten("still.toml", 0.3)
    shorten("calibration.toml", 0.6)
    shorten("scenario.toml", 0.8)
    for step in steps:
        assert softaim(*step) == 0, step
    assumed, found = (read_scene(Path(name)) for name in ("scene.toml", "tuned.toml"))
    true = read_scene(Path("truth/scene.toml")).network.positions
    before, after = (np.abs(one.network.positions - true).max() for one in (assumed, found))
    assert after < 0.5 * before
    assert [step.step for step in found.steps] == ["at-rest", "identify", "tune"]
    assert Path("advice/advice.csv").is_file()
    figures = json.loads(Path("track/summary.json").read_text(encoding="utf-8"))
    assert figures["filter"]["mae_mm"] < min(figures["open-loop"]["mae_mm"], 1.0)
    assert figures["filter"]["coverage95"] > 0.8
