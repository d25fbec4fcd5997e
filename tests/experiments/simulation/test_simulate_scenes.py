"""Recordings of scenes of one's own: a body in space as marks, a flat one as a film, several seeds at once."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import vision
from dynamics import MassSpringNetwork, four_mass_phantom, rest_shape
from experiments.errors import InputError
from experiments.formats.recording import read_recording
from experiments.formats.scenario import read_scenario
from experiments.formats.scenario_forces import Release
from experiments.simulation import simulate as module
from experiments.simulation.simulate import scene_of, simulate, true_motion, true_network
from tests.experiments.command import softaim
from tests.experiments.rows import complaint
from tests.experiments.simulation.test_simulate import solved
from tests.networks import build_network

HANGING = (Path(__file__).parents[1] / "hanging.toml").read_text()
SCENARIO = """version = 1
scene = "hanging.toml"
seed = 5
duration_s = 1.0
[release]
node = "a"
force_n = [0.2, 0.0, 0.3]
[marks]
sd_mm = 0.2
"""
CAMERA = """
[[camera]]
name = "front"
size_px = [320, 240]
plane_to_px = [[1.5, 0.0, 159.5], [0.0, -1.5, 20.5], [0.0, 0.0, 1.0]]
"""


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    """A scenario of two masses that hang in space on springs, pulled aside and let go."""
    (tmp_path / "hanging.toml").write_text(HANGING)
    path = tmp_path / "swing.toml"
    path.write_text(SCENARIO)
    return path


@pytest.fixture
def flat(tmp_path: Path) -> Path:
    """The same in the plane before a camera, the hidden mass without a mark."""
    text = HANGING.replace(", 0.0]\nmass", "]\nmass").replace(", 0.0]\nfixed", "]\nfixed")
    text = text.replace("-9.81, 0.0]", "-9.81]").replace("hue_deg = 0.0", "hue_deg = 120.0") + CAMERA
    (tmp_path / "hanging.toml").write_text(text)
    path = tmp_path / "swing.toml"
    path.write_text(SCENARIO.replace("[0.2, 0.0, 0.3]", "[0.2, 0.0]"))
    return path


def test_the_truth_in_space_is_newtons(scenario: Path):
    """A release let go: positions to 1e-6 m of SciPy's LSODA of the plain equations, as for the phantom."""
    read = read_scenario(str(scenario))
    network = scene_of(read).network
    held = np.array([[0.0, 0.0, 0.0], [0.2, 0.0, 0.3]])
    start = rest_shape(network, held)[network.free]
    truth = true_motion(network, read, np.random.default_rng(0))
    np.testing.assert_allclose(truth.positions[0], start, rtol=0, atol=1e-9)
    expected = solved(network, start, truth.times_s, method="LSODA", rtol=1e-8)
    np.testing.assert_allclose(truth.positions, expected, rtol=0, atol=1e-6)
    assert np.ptp(truth.positions[:, 1, 2]) > 0.02


def test_a_body_in_space_is_marks_and_truth(scenario: Path, tmp_path: Path):
    """Noise of 90 coordinates as stated, 0.2 mm to three of its standard errors (7.5 %); the scene as it was."""
    shares: list[float] = []
    simulate(read_scenario(str(scenario)), tmp_path / "rec", advance=shares.append)
    assert len(shares) > 20
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    names = sorted(path.name for path in (tmp_path / "rec").iterdir())
    assert names == ["frames.csv", "marks.csv", "scene.toml", "truth.csv"]
    own, step = (tmp_path / "rec" / "scene.toml").read_text().split("\n[[provenance]]\n")
    assert own == HANGING
    assert step.startswith('step = "simulate"\n')
    recording = read_recording(tmp_path / "rec")
    assert recording.scene.settings.poked.poke == 3.0
    assert recording.scene.uncertainty is not None
    truth = recording.truth.positions["a"]
    errors = np.array([row[0].position_m for row in recording.marks]) - truth
    assert {(mark.node, mark.sd_m) for row in recording.marks for mark in row} == {("a", 2e-4)}
    assert errors.std() == pytest.approx(2e-4, rel=0.225)
    assert set(pd.read_csv(tmp_path / "rec" / "truth.csv")["node"]) == {"a", "hidden"}


def test_a_flat_scene_is_filmed_with_its_own_marks(flat: Path, tmp_path: Path):
    """The green mark is found in the film where the truth projects to, by the camera written down, to 0.3 px."""
    simulate(read_scenario(str(flat)), tmp_path / "rec")
    names = sorted(path.name for path in (tmp_path / "rec").iterdir())
    assert names == ["frames.csv", "scene.toml", "truth.csv", "video.avi"]
    truth = pd.read_csv(tmp_path / "rec" / "truth.csv").query("node == 'a'")[["x_mm", "y_mm"]].to_numpy()
    with vision.VideoFileFrames(tmp_path / "rec" / "video.avi") as frames:
        images = [frame.image for frame in frames]
    assert len(images) == len(truth) == 30
    for image, (x, y) in zip(images, truth, strict=True):
        (found,) = vision.detect_marks(image, [vision.MarkHue(120.0)], min_area_px=50.0)
        np.testing.assert_allclose(found.center_px, [159.5 + 1.5 * x, 20.5 - 1.5 * y], atol=0.3)


def test_two_cameras_take_no_film_and_without_one_a_flat_scene_is_marks(flat: Path, tmp_path: Path):
    scene = tmp_path / "hanging.toml"
    scene.write_text(scene.read_text() + CAMERA.replace("front", "side"))
    expected = r"hanging\.toml: camera: expected one for a film, or --no-film, found 2"
    with pytest.raises(InputError, match=expected):
        simulate(read_scenario(str(flat)), tmp_path / "rec")
    assert not (tmp_path / "rec").exists()
    assert softaim("simulate", flat, "--out", tmp_path / "rec", "--no-film") == 0
    assert (tmp_path / "rec" / "marks.csv").is_file()
    assert not (tmp_path / "rec" / "video.avi").exists()


def test_several_recordings_are_of_successive_seeds(scenario: Path, tmp_path: Path, capsys: pytest.CaptureFixture):
    """The second of a run from seed 8 on is that of seed 9 alone; the network's sag is reported."""
    assert softaim("simulate", scenario, "--out", tmp_path / "all", "--seed", "8", "--runs", "2") == 0
    assert "the network rests up to" in capsys.readouterr().err
    assert softaim("simulate", scenario, "--out", tmp_path / "one", "--seed", "9") == 0
    names = {path.name for path in (tmp_path / "all").iterdir()}
    assert names == {"provenance.json", "seed-8", "seed-9", "softaim.log"}
    for name in ("marks.csv", "truth.csv", "frames.csv"):
        assert (tmp_path / "all" / "seed-9" / name).read_bytes() == (tmp_path / "one" / name).read_bytes()
    marks = [(tmp_path / "all" / f"seed-{k}" / "marks.csv").read_bytes() for k in (8, 9)]
    assert marks[0] != marks[1]


def test_a_scene_without_a_rest_is_reported_with_its_file(scenario: Path, tmp_path: Path):
    """Without gravity nothing keeps two masses below their anchor."""
    scene = tmp_path / "hanging.toml"
    scene.write_text(HANGING.replace("-9.81", "0.0"))
    scenario.write_text(SCENARIO.split("[release]", maxsplit=1)[0])
    said = complaint(read_scenario, str(scenario))
    assert said.startswith(f"{scene}: network: rest shape: expected a stable equilibrium")


def test_a_body_without_anchors_does_not_fall(scenario: Path):
    """What carries it acts on every node alike: its middle stays where it was to 1e-6 m."""
    read = read_scenario("quiet").model_copy(update={"release": None, "tremor": None, "duration_s": 1.0})
    phantom = four_mass_phantom()
    loose = replace(phantom, fixed=np.zeros(7, dtype=bool))
    truth = true_motion(loose, read, np.random.default_rng(0))
    middle = truth.positions.mean(axis=1)
    np.testing.assert_allclose(middle, np.broadcast_to(middle[0], middle.shape), rtol=0, atol=1e-6)


def chain(stiffness: float, dashpot: float, mass: float) -> MassSpringNetwork:
    """Three links that hang from an anchor in the plane."""
    places, links = [[0.0, -0.1 * k] for k in range(4)], [(0, 1), (1, 2), (2, 3)]
    constants = {"masses": mass, "drag": 0.01, "stiffness": stiffness, "damping": dashpot, "gravity": [0.0, -9.81]}
    return build_network(places, links, [0], ["top", "a", "b", "c"], **constants)


@pytest.mark.parametrize(("mass", "dashpot", "method"), [(0.02, 0.5, "RK45"), (0.001, 50.0, "Radau")])
def test_stiff_links_are_followed(mass: float, dashpot: float, method: str, monkeypatch: pytest.MonkeyPatch):
    """Links of 1e5 N/m: to 10 µm of SciPy's BDF, of a swing of a centimetre.

    Explicit steps of 0.6 ms for those of 20 g; implicit ones for those of 1 g and heavy dashpots, else 16 µs.
    """
    network, taken, integrate = chain(1e5, dashpot, mass), [], module.integrate_adaptive

    def noted(*arguments: object, method: str, **options: object) -> np.ndarray:
        taken.append(method)
        return integrate(*arguments, method=method, **options)

    monkeypatch.setattr(module, "integrate_adaptive", noted)
    release = Release(node="c", force_n=[0.4 * mass * 9.81, 0.0])
    read = read_scenario("quiet").model_copy(update={"release": release, "tremor": None, "duration_s": 0.12})
    truth = true_motion(network, read, np.random.default_rng(0))
    expected = solved(network, truth.positions[0], truth.times_s, method="BDF", rtol=1e-7)
    assert taken == [method]
    assert np.ptp(truth.positions[:, 2, 0]) > 0.01
    np.testing.assert_allclose(truth.positions, expected, rtol=0, atol=1e-5)


def test_constants_of_the_truth_are_drawn_about_the_scene_s(scenario: Path):
    """Of 400 seeds, the logs of a spring's stiffness: 0.1 to three standard errors (11 %), mean 0 to three (0.015)."""
    scenario.write_text(SCENARIO + "[constants]\nstiffness = 0.1\n")
    read = read_scenario(str(scenario))
    network = scene_of(read).network
    logs = np.array([np.log(true_network(network, read, seed).stiffness / 200.0) for seed in range(400)])
    np.testing.assert_allclose(logs.std(axis=0), 0.1, rtol=0.11)
    np.testing.assert_allclose(logs.mean(axis=0), 0.0, atol=0.015)
    assert abs(np.corrcoef(logs.T)[0, 1]) < 0.15
    other = true_network(network, read, 7)
    np.testing.assert_array_equal(other.damping, network.damping)
    np.testing.assert_array_equal(other.stiffness, true_network(network, read, 7).stiffness)


def test_the_recording_keeps_the_scene_whose_constants_are_wrong(scenario: Path, tmp_path: Path):
    """The truth hangs where springs of other stiffness let it; the scene of the recording is the file's."""
    scenario.write_text(SCENARIO.split("[release]", maxsplit=1)[0] + "[constants]\nstiffness = 0.2\n")
    read = read_scenario(str(scenario))
    simulate(read, tmp_path / "rec")
    recording = read_recording(tmp_path / "rec")
    assert recording.scene.network.stiffness.tolist() == [200.0, 200.0]
    k = true_network(recording.scene.network, read, 5).stiffness
    sag = 0.1 * 9.81 / k[0]  # both masses hang on the first spring
    assert recording.truth.positions["hidden"][0, 1] == pytest.approx(-(0.045 + sag), abs=1e-6)
    assert abs(sag - 0.1 * 9.81 / 200.0) > 1e-4
    assert recording.scene.steps == ()
    assert (tmp_path / "rec" / "scene.toml").read_text() == HANGING
