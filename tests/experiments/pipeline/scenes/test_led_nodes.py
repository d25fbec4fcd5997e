"""`[filter] led_nodes` of a scene: read by the filters of `track`, kept in scenes that `identify` and `tune` write."""

import json
from dataclasses import replace

import numpy as np
import pytest

from estimators import FilterSettings
from estimators.core.tissue import SOURCES
from experiments.formats.recording import read_recording
from experiments.formats.scenario import read_scenario
from experiments.formats.scene.scene import read_scene
from experiments.pipeline.line import Line
from experiments.simulation.simulate import scene_of
from tests.experiments.command import softaim
from tests.experiments.pipeline.tables import near, write_recording


@pytest.fixture
def recording(tmp_path):
    """Marks of the phantom where it is drawn, to 0.5 mm, 12 frames at 30 a second; followed by the usual filter."""
    scene = replace(scene_of(read_scenario("poked")), cameras=(), settings=FilterSettings())
    rng = np.random.default_rng(0)
    frames = [(k / 30.0, near(scene, ("M1", "M2", "M3", "M4"), 5e-4, rng)) for k in range(12)]
    return write_recording(tmp_path / "rec", scene, frames, 0.5)


def state_led(folder, *nodes):
    """State in the scene of a recording that these nodes are led."""
    path = folder / "scene.toml"
    names = ", ".join(f'"{node}"' for node in nodes)
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("\n[[mark]]", f"\n[filter]\nled_nodes = [{names}]\n\n[[mark]]", 1), encoding="utf-8")


def test_a_led_node_bears_the_forces_of_a_hand_in_every_mode_of_the_tracks_filter(recording):
    state_led(recording, "M1")
    filters = Line(read_recording(recording).scene, baseline=False, check=True)
    assert len(filters.checks.without) == 3
    for tissue in (filters.filter, *filters.checks.without.values()):
        assert tissue.settings.led_nodes == ("M1",)
        force, sources = tissue.process.parts["force"].start, tissue.process.variances(0.0)
        led, short = (sources[:, SOURCES.index(name)] for name in ("led", "short"))
        assert led.min() > 10.0 * short.min()
        found = tissue.process.prior(0.0)[1].diagonal(axis1=1, axis2=2)[:, force : force + 6]
        np.testing.assert_allclose(found, np.stack([short] * 4 + [led] * 2, axis=1))


def test_identify_and_tune_keep_led_nodes_in_the_scenes_they_write(recording, tmp_path, capsys):
    """And the level that tracking uses is the one that was reported."""
    state_led(recording, "M1")
    assert softaim("identify", recording, "--at-rest", "--out", tmp_path / "rest.toml") == 0
    assert read_scene(tmp_path / "rest.toml").settings.led_nodes == ("M1",)
    capsys.readouterr()
    assert softaim("tune", recording, "--out", tmp_path / "tuned.toml", "--json") == 0
    report, tuned = json.loads(capsys.readouterr().out), read_scene(tmp_path / "tuned.toml")
    assert tuned.settings.discrepancy == report["strain"]
    assert tuned.settings.led_nodes == ("M1",)
