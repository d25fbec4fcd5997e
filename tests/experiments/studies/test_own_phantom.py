"""The tutorial's commands, typed as they stand, and the study that takes their time and counts hits."""

import json
import re
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from experiments.errors import InputError
from experiments.formats.scene.scene import read_scene
from experiments.simulation.simulate import simulate
from experiments.studies.own_phantom import __main__ as study
from experiments.studies.own_phantom.steps import insertions, reliability_table, steps_of, times_table
from tests.experiments.command import softaim

TUTORIAL = Path(__file__).parents[3] / "docs" / "tutorial.md"


def typed_in_the_tutorial() -> list[list[str]]:
    """Every command of the page's blocks, in order, without `softaim`."""
    blocks = re.findall(r"```sh\n(.*?)```", TUTORIAL.read_text(encoding="utf-8"), re.DOTALL)
    return [line.split()[1:] for block in blocks for line in block.splitlines() if line.startswith("softaim ")]


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
    """All commands of the page, 0.8 s and 1 s in place of 20: the target is followed no worse than by the open loop.

    And advice on marks of the project, of 3.5 s, without a film: frames four times a second, whose truth is known.
    """
    monkeypatch.chdir(tmp_path)
    new, *steps = typed_in_the_tutorial()
    assert softaim(*new) == 0
    monkeypatch.chdir(tmp_path / "mine")
    shorten("still.toml", 0.5)
    shorten("calibration.toml", 0.8)
    shorten("scenario.toml", 1.0)
    for step in steps:
        assert softaim(*step) == 0, step
    assumed, found = (read_scene(Path(name)) for name in ("scene.toml", "tuned.toml"))
    true = read_scene(Path("truth/scene.toml")).network.positions
    before, after = (np.abs(one.network.positions - true).max() for one in (assumed, found))
    assert after < 0.5 * before
    assert [step.name for step in found.steps] == ["at-rest", "identify", "tune"]
    assert Path("advice/advice.csv").is_file()
    figures = json.loads(Path("track/summary.json").read_text(encoding="utf-8"))
    assert figures["filter"]["mae_mm"] < min(figures["open-loop"]["mae_mm"], 1.0)
    assert figures["filter"]["coverage95"] > 0.8
    shorten("scenario.toml", 3.5)
    monkeypatch.setattr("experiments.studies.own_phantom.steps.simulate", partial(simulate, filmed=False))
    rows = pd.DataFrame(insertions({"phantom": "plane", "project": str(tmp_path / "mine"), "seed": 7}))
    np.testing.assert_allclose(np.diff(rows["time_s"]), 0.25, atol=0.035)  # in whole frames
    assert 2 <= len(rows) <= 15
    assert rows[["predicted", "observed"]].to_numpy().min() >= 0.0
    assert rows[["predicted", "observed"]].to_numpy().max() <= 1.0


def test_steps_that_ended_early_are_done_again(tmp_path, capsys, monkeypatch):
    def ended(_name, folder):
        (folder / "scene.toml").write_text("half", encoding="utf-8")
        raise InputError("softaim check: expected exit code 0, found 2")

    monkeypatch.setattr(study, "stepped", ended)
    for _ in range(2):
        assert study.main(["--out", str(tmp_path / "study"), "--phantoms", "0"]) == 2
        assert "softaim check" in capsys.readouterr().err
    assert not (tmp_path / "study" / "plane-of-5-masses").exists()


def test_tables_of_the_study():
    """Two recordings of two insertions, off by 0.1 and 0.3: 0.2 with a standard error of 0.1, hence 19.6 points."""
    rates = {"predicted": [0.5, 0.5, 0.6, 0.6], "observed": [0.6, 0.6, 1.0, 0.8]}
    found = pd.DataFrame({"phantom": "one", "seed": [1, 1, 2, 2], "advice": ["GO", "WAIT", "GO", "GO"], **rates})
    *_, row = reliability_table(found).splitlines()
    assert row == "| one | 2 | 4 | 55.0% | 75.0% | +20.0 ± 19.6 points | 75% | 56.7% | 80.0% |"
    *_, row = reliability_table(found.assign(advice="WAIT")).splitlines()
    assert row.endswith("| 0% | – | – |")
    commands = ["simulate a --out b", "simulate c --out d", "identify a --at-rest", "identify b"]
    times = pd.DataFrame({"phantom": "one", "command": commands, "seconds": [1.0, 2.0, 3.0, 4.0]})
    expected = ["simulate | 3", "identify --at-rest | 3", "identify | 4", "all | 10"]
    assert times_table(times).splitlines()[2:] == [f"| {row} |" for row in expected]
