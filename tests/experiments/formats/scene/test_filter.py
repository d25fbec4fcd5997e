"""What a scene states of the filter: uncertainty in both forms, noise levels, led nodes, faults, and back to a file."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dynamics import parameter_label, parameters
from estimators import FilterSettings, FixBias
from experiments.formats.scenario import read_scenario
from experiments.formats.scene.scene import read_scene, write_scene
from experiments.simulation.simulate import scene_of
from tests.experiments.rows import complaint, rows


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """The file of the phantom's scene, which says nothing of the filter."""
    path = tmp_path / "scene.toml"
    write_scene(replace(scene_of(read_scenario("webcam")), settings=FilterSettings()), path)
    return path


def scene_with(path: Path, text: str):
    """The scene read from the file with this before its first mark."""
    content = path.read_text(encoding="utf-8")
    path.write_text(content.replace("\n[[mark]]", f"\n{text}\n[[mark]]", 1), encoding="utf-8")
    return read_scene(path)


def test_nothing_said_is_the_usual_filter_and_exact_constants(path):
    scene = read_scene(path)
    assert scene.settings == FilterSettings()
    assert scene.uncertainty is None
    assert "[filter]" not in path.read_text()


def test_kinds_are_every_constant_of_the_kind_by_itself(path):
    """Covariance of the logs: 0.1² on ten stiffnesses, 0.5² on four drags, nothing across."""
    scene = scene_with(path, "[uncertainty]\nstiffness = 0.1\ndrag = 0.5\n")
    assert scene.uncertainty.parameters == parameters(scene.network, ("stiffness", "drag"))
    np.testing.assert_allclose(scene.uncertainty.cov, np.diag([0.01] * 10 + [0.25] * 4), rtol=0, atol=1e-15)


def test_directions_are_distinguished_by_name(path):
    directions = "directions = [[0.1, 0.2], [0.0, 0.3], [1.0, 0.0]]"
    scene = scene_with(path, f'[uncertainty]\nparameters = ["drag M2", "stiffness M1-M2"]\n{directions}\n')
    labels = [parameter_label(scene.network, one) for one in scene.uncertainty.parameters]
    assert labels == ["drag M2", "stiffness M1-M2"]
    np.testing.assert_allclose(scene.uncertainty.cov, [[1.01, 0.02], [0.02, 0.13]], rtol=0, atol=1e-15)


def test_priors_take_the_place_of_the_usual_ones(path):
    scene = scene_with(path, "[filter]\npoke_m_s2 = 2.0\npoke_lasting_s = 0.4\nfix_bias_mm = 2.5\nstrain = 0.02\n")
    usual = FilterSettings()
    assert scene.settings == replace(
        usual, poked=replace(usual.poked, poke=2.0, lasting_s=0.4), fix_bias=FixBias(2.5e-3), discrepancy=0.02
    )


def test_the_key_of_an_older_scene_is_read(path):
    """Before, a scene chose between two filters."""
    assert scene_with(path, "[filter]\nunified = true\n").settings == FilterSettings()
    path.write_text(path.read_text().replace("unified = true", "unified = false"))
    assert "filter.unified: expected True, found false" in complaint(read_scene, path)


@pytest.mark.parametrize("level", ["poke_m_s2 = 2.0", "poke_lasting_s = 0.3", "strain = 0.0"])
def test_what_is_read_is_written_and_read_again(path, level):
    uncertainty = '[uncertainty]\nparameters = ["drag M2", "damping M1-M2"]\ndirections = [[0.1, -0.2]]\n'
    scene = scene_with(path, f"{uncertainty}[filter]\n{level}\nfix_bias_mm = 2.5\n")
    write_scene(scene, path)
    again = read_scene(path)
    assert again.settings == scene.settings
    assert again.uncertainty.parameters == scene.uncertainty.parameters
    np.testing.assert_allclose(again.uncertainty.directions, [[0.1, -0.2]], rtol=1e-14)


def test_led_nodes_are_written_and_read_again_whatever_their_names(path):
    """Beside usual levels and beside others; a name with quotes, a backslash and letters beyond ASCII."""
    scene = read_scene(path)
    name = 'gr"i\\p ü'
    network = replace(scene.network, names=(name, *scene.network.names[1:]))
    marks = tuple(replace(mark, node=name) if mark.node == "M1" else mark for mark in scene.marks)
    assert scene.network.names[0] == "M1"
    for usual in (FilterSettings(), scene_with(path, "[filter]\npoke_m_s2 = 2.0\nstrain = 0.01\n").settings):
        settings = replace(usual, led_nodes=(name, "M4"))
        write_scene(replace(scene, network=network, marks=marks, settings=settings), path)
        assert read_scene(path).settings == settings
        write_scene(scene, path)


FAULTS = r"""
[uncertainty]\n | uncertainty: expected one or more of stiffness, rest_length, damping, drag, friction, or
[uncertainty]\nstiffness = -0.1\n | uncertainty.stiffness: expected more than 0, found -0.1
[uncertainty]\nparameters = ["drag M2"]\n | uncertainty: expected parameters and directions together
[uncertainty]\nparameters = ["drag M2"]\ndirections = [[0.1, 0.2]]\n | uncertainty: expected directions of 1 numbers
    each, found 2
[uncertainty]\ndrag = 0.1\nparameters = ["drag M2"]\ndirections = [[0.1]]\n | uncertainty: expected either
    parameters and directions, or kinds, found both, drag
[filter]\nled_nodes = ["M1", "M9"]\n | filter.led_nodes[1]: no node named "M9"
[filter]\nled_nodes = ["In1"]\n | filter.led_nodes[0]: expected a node with a measured mark, found "In1" without
[uncertainty]\nparameters = ["stiffness M1-M9"]\ndirections = [[0.1]]\n | uncertainty.parameters[0]: no positive
    constant named "stiffness M1-M9"
[uncertainty]\nstiffness = 1e9\n | uncertainty.stiffness: expected 700 or less
[uncertainty]\nparameters = ["stiffness M1-M2"]\ndirections = [[1e4]]\n | uncertainty.directions: expected the log of
    stiffness 0
[filter]\npoke_m_s2 = 0\n | filter.poke_m_s2: expected more than 0, found 0
[filter]\nled_nodes = "M1"\n | filter.led_nodes: expected a list, found "M1"
[filter]\nled_nodes = [1]\n | filter.led_nodes[0]: expected text in quotes, found 1
[filter]\nnoise = 1.0\n | filter.noise: expected one of poke_m_s2, poke_lasting_s,
"""


@pytest.mark.parametrize(("text", "message"), rows(FAULTS))
def test_faults_are_reported_in_one_line(path, text, message):
    assert complaint(scene_with, path, text).startswith(f"{path}: {message}")
