"""scene.toml: what is read, what is written, and what is said of every fault."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dynamics import MassSpringNetwork, four_mass_phantom
from experiments.formats.scene.scene import Mark, Scene, Target, read_scene, write_scene
from vision import PlaneCamera

GOOD = (Path(__file__).parents[2] / "good_scene.toml").read_text(encoding="utf-8")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "scene.toml"


def test_reads_every_key_in_si_units(path: Path):
    path.write_text(GOOD, encoding="utf-8")
    scene = read_scene(path)
    network = scene.network
    assert network.names == ("M1", "M2", "In1")
    np.testing.assert_allclose(network.positions, [[-0.2, 0.2], [0.0, 0.2], [0.0, 0.0]], rtol=0, atol=1e-15)
    np.testing.assert_array_equal(network.masses[:2], [0.2, 0.25])
    np.testing.assert_array_equal(network.fixed, [False, False, True])
    np.testing.assert_array_equal(network.drag, [0.3, 0.0, 0.0])
    np.testing.assert_array_equal(network.friction, [0.0, 0.02, 0.0])
    np.testing.assert_array_equal(network.springs, [[0, 1], [1, 2]])
    np.testing.assert_array_equal(network.stiffness, [80.0, 90.0])
    np.testing.assert_allclose(network.rest_lengths, [0.19, 0.21], rtol=1e-15)
    np.testing.assert_array_equal(network.damping, [0.6, 0.0])
    np.testing.assert_array_equal(network.gravity, [0.0, -9.81])
    assert scene.marks == (Mark("M1", 120.0, 0.03, True), Mark("M2", 0.0, 0.02, False))
    assert scene.measured_nodes == ("M1",)
    assert scene.target == Target("M2", 0.005)
    (camera,) = scene.cameras
    assert (camera.name, camera.size_px, camera.calibration_sd_px) == ("front", (640, 480), 0.2)
    # the homography of the file is from mm: (-200, 200) mm is 0.8 px/mm from (319.5, 391.5) px
    np.testing.assert_allclose(camera.project([[-0.2, 0.2]]), [[159.5, 231.5]], rtol=0, atol=1e-9)


def numbers(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_nan=False, allow_subnormal=False)


@st.composite
def scenes(draw: st.DrawFn) -> Scene:
    """Chains of two to five nodes, the first of them free, with any values that make sense."""
    dim = draw(st.sampled_from([2, 3]))
    text = st.text(st.characters(codec="utf-8", exclude_categories=["C", "Z"]), min_size=1, max_size=5)
    names = draw(st.lists(text, min_size=2, max_size=5, unique=True))
    n = len(names)

    def column(size: int, low: float, high: float) -> np.ndarray:
        return np.array(draw(st.lists(numbers(low, high), min_size=size, max_size=size)))

    positions = column(n * dim, -0.4, 0.4).reshape(n, dim)
    positions[:, 0] += np.arange(n)  # at different places
    fixed = np.array([False, *draw(st.lists(st.booleans(), min_size=n - 1, max_size=n - 1))])
    free = [names[i] for i in np.flatnonzero(~fixed)]
    network = MassSpringNetwork(
        names=tuple(names),
        positions=positions,
        masses=column(n, 1e-6, 1e3),
        fixed=fixed,
        drag=column(n, 0.0, 10.0),
        friction=column(n, 0.0, 10.0),
        springs=np.array([(i, i + 1) for i in range(n - 1)]),
        stiffness=column(n - 1, 1e-3, 1e6),
        rest_lengths=column(n - 1, 1e-6, 10.0),
        damping=column(n - 1, 0.0, 10.0),
        gravity=column(dim, -100.0, 100.0),
    )
    marks = []
    for name in free:
        look = draw(numbers(0.0, 359.0)), draw(numbers(1e-6, 1.0))
        marks.append(Mark(name, *look, not marks or draw(st.booleans()), ball=draw(st.booleans())))
    cameras = []
    if dim == 2 and draw(st.booleans()):
        affine = column(6, 0.0, 200.0).reshape(2, 3) + 300.0 * np.eye(2, 3)
        homography = np.vstack([affine, [0.01, 0.02, 1.0]])  # 1 + 0.01 x + 0.02 y is positive all over the chain
        cameras.append(PlaneCamera(draw(text), (640, 480), homography, draw(numbers(0.0, 2.0))))
    return Scene(network, tuple(marks), Target(draw(st.sampled_from(free)), draw(numbers(1e-6, 1.0))), tuple(cameras))


@pytest.mark.slow
@given(scenes())
@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_what_is_written_is_read_again(tmp_path: Path, scene: Scene):
    """To 1e-9 of each value; positions are written to 1e-12 m."""
    path = tmp_path / "scene.toml"
    write_scene(scene, path)
    again = read_scene(path)
    ours, theirs = scene.network, again.network
    assert theirs.names == ours.names
    np.testing.assert_allclose(theirs.positions, ours.positions, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(theirs.fixed, ours.fixed)
    np.testing.assert_array_equal(theirs.springs, ours.springs)
    for key in ("masses", "drag", "friction", "stiffness", "rest_lengths", "damping", "gravity"):
        np.testing.assert_allclose(getattr(theirs, key), getattr(ours, key), rtol=1e-9, err_msg=key)
    for key in ("node", "measured", "ball"):
        assert [getattr(mark, key) for mark in again.marks] == [getattr(mark, key) for mark in scene.marks], key
    for mark, written in zip(again.marks, scene.marks, strict=True):
        assert (mark.hue_deg, mark.diameter_m) == pytest.approx((written.hue_deg, written.diameter_m), rel=1e-9)
    assert again.target.node == scene.target.node
    assert again.target.radius_m == pytest.approx(scene.target.radius_m, rel=1e-9)
    assert len(again.cameras) == len(scene.cameras)
    for camera, written in zip(again.cameras, scene.cameras, strict=True):
        assert (camera.name, camera.size_px) == (written.name, written.size_px)
        assert camera.calibration_sd_px == pytest.approx(written.calibration_sd_px, rel=1e-9)
        np.testing.assert_allclose(camera.plane_to_px, written.plane_to_px, rtol=1e-9)


def test_a_scene_is_written_as_a_person_would(path: Path):
    """In the phantom at rest, zeros are zeros and 0.0003 m is 0.3 mm, without the dust of binary fractions."""
    network = four_mass_phantom()
    write_scene(Scene(network, (Mark("M1", 0.0, 0.0003),), Target("M2", 0.005), ()), path)
    lines = path.read_text(encoding="utf-8").splitlines()
    assert "diameter_mm = 0.3" in lines
    assert "position_mm = [0.0, 0.0]" in lines
    assert not [line for line in lines if "e-" in line]
