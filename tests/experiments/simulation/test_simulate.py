"""The truth of a scenario against independent integration of its equations, and the film against the truth."""

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import vision
from dynamics import HIDDEN, OUTER, four_mass_phantom, pack, plain_derivative, unpack
from experiments.errors import InputError
from experiments.formats.scenario import read_scenario
from experiments.formats.scenario_forces import Pokes, Release, Tremor
from experiments.simulation.film import film
from experiments.simulation.forces import poke_force, tremor_force
from experiments.simulation.simulate import exposures, scene_of, simulate, true_motion

NETWORK = four_mass_phantom()
FREE = NETWORK.free
STILL = read_scenario("webcam").model_copy(update={"tremor": None, "pokes": None, "duration_s": 1.0})
POKES = Pokes(nodes=["M1", "M4"], acceleration_m_s2=10.0, shortest_s=0.1, longest_s=0.3, pause_s=0.2)
PUSHED = STILL.model_copy(update={"pokes": POKES, "frame_interval_s": 0.05})


def solved(network, start, times_s, *, method: str, rtol: float, force=None, max_step: float = np.inf) -> np.ndarray:
    """Positions [m], (n_times, n_free, dim), by SciPy of the plain NumPy equations, from rest at the start.

    force: force on the free nodes at a time, (n_free, dim)
    """
    nothing = np.zeros_like(start)

    def rate(t: float, state: np.ndarray) -> np.ndarray:
        pushed = nothing if force is None else force(t) / network.masses[network.free, None]
        return plain_derivative(network, state) + pack(nothing, pushed)

    options = {"method": method, "t_eval": times_s, "rtol": rtol, "atol": 1e-10, "max_step": max_step}
    done = solve_ivp(rate, (times_s[0], times_s[-1]), pack(start, nothing), **options)
    assert done.success
    return unpack(done.y.T, network.dim)[0]


def test_pokes_move_the_phantom_by_newtons_law():
    """The same pokes given to Radau: positions to 1e-5 m, both integrators stepping over the pokes' ends."""
    times, positions = exposures(PUSHED), true_motion(NETWORK, PUSHED, np.random.default_rng(5)).positions
    force = poke_force(NETWORK, PUSHED.pokes, PUSHED.duration_s, np.random.default_rng(5))
    assert np.abs(positions - positions[0]).max() > 0.01
    options = {"method": "Radau", "rtol": 1e-8, "max_step": 1 / 120}
    expected = solved(NETWORK, NETWORK.positions[FREE], times, force=force, **options)
    np.testing.assert_allclose(positions, expected, rtol=0, atol=1e-5)


def test_pokes_push_one_outer_node_at_a_time_as_hard_as_was_said():
    """Half sine waves between 0.3 and 1 of acceleration times mass, each as long as was said, nothing in between."""
    pokes = read_scenario("poked").pokes
    force = poke_force(NETWORK, pokes, 100.0, np.random.default_rng(3))
    dt = 2e-3
    times = dt * np.arange(50_000)
    pushes = np.array([np.linalg.norm(force(t), axis=1) for t in times])  # (n, n_free)
    names = [NETWORK.names[i] for i in FREE]
    assert (pushes[:, names.index(HIDDEN)] == 0).all()
    assert {names[k] for k in np.flatnonzero(pushes.max(axis=0))} == set(OUTER)
    assert ((pushes > 0).sum(axis=1) <= 1).all()
    strength = pushes.sum(axis=1)
    edges = np.flatnonzero(np.diff(np.r_[0, strength > 0, 0]))
    starts, ends = edges[::2], edges[1::2]
    lasting = dt * (ends - starts)
    peaks = np.array([strength[a:b].max() for a, b in zip(starts, ends, strict=True)])
    full = pokes.acceleration_m_s2 * NETWORK.masses[FREE[0]]
    # A wave sampled each 2 ms: its peak to 1 - cos(pi dt / 2 lasting) = 5e-4, its length to two samples
    assert (peaks <= full).all()
    assert (peaks > 0.3 * full * (1 - 6e-4)).all()
    assert peaks.min() < 0.4 * full
    assert peaks.max() > 0.9 * full
    assert pokes.shortest_s - 2 * dt <= lasting.min() < lasting.max() <= pokes.longest_s + 2 * dt
    longest = int(np.argmax(lasting))
    phase = np.pi * (np.arange(ends[longest] - starts[longest]) + 0.5) / (ends[longest] - starts[longest])
    wave = strength[starts[longest] : ends[longest]]
    np.testing.assert_allclose(wave, peaks[longest] * np.sin(phase), atol=0.02 * full)
    # Pauses: exponential, mean 1.5 s; about 55 of them, so 1.5 / sqrt(55) = 0.2 s for one standard deviation
    pauses = dt * (starts[1:] - ends[:-1])
    assert pauses.mean() == pytest.approx(pokes.pause_s, abs=0.6)


def test_tremor_has_the_density_that_was_asked_for():
    """Variance of knots: density² / interval, times mass²; of 80,000 numbers to 0.5 %, here 2 %. Straight between."""
    tremor = Tremor(acceleration_m_s2_sqrt_hz=0.05, interval_s=0.01)
    force = tremor_force(NETWORK, tremor, 100.0, np.random.default_rng(0))
    knots = np.array([force(0.01 * k + 1e-12) for k in range(10_000)])
    np.testing.assert_allclose((knots**2).mean(axis=(0, 2)), (0.05 * NETWORK.masses[FREE]) ** 2 / 0.01, rtol=0.06)
    assert (knots**2).mean() == pytest.approx((0.05 * 0.2) ** 2 / 0.01, rel=0.02)
    np.testing.assert_allclose(force(0.0325), 0.75 * force(0.03) + 0.25 * force(0.04), rtol=1e-9, atol=1e-12)
    assert force(100.0).shape == (4, 2)


@pytest.mark.parametrize(
    ("update", "reported"),
    [
        ({"release": Release(node="M9", force_n=[1.0, 0.0])}, 'no node named "M9"'),
        ({"release": Release(node="In1", force_n=[1.0, 0.0])}, "expected a free node"),
        ({"release": Release(node="M1", force_n=[1e60, 0.0])}, "release: rest shape: expected"),
        ({"tremor": Tremor(acceleration_m_s2_sqrt_hz=1e300)}, "expected forces that the motion can follow"),
        ({"pokes": PUSHED.pokes.model_copy(update={"nodes": ["M7"]})}, 'no node named "M7"'),
    ],
)
@pytest.mark.filterwarnings("ignore:overflow encountered:RuntimeWarning", "ignore:invalid value:RuntimeWarning")
def test_a_scenario_that_cannot_be_moved_is_reported_and_leaves_nothing(tmp_path: Path, update: dict, reported: str):
    with pytest.raises(InputError, match="scenario: ") as fault:
        simulate(STILL.model_copy(update=update), tmp_path / "out")
    assert reported in str(fault.value)
    assert list(tmp_path.iterdir()) == []


def test_marks_are_drawn_where_the_truth_says():
    """Detected by hue in the frames as drawn, nearest mark each: 0.15 px RMS, the accuracy asked of the detection.

    In the raw frame the row of circles is found at projected truth, so this holds camera, drawing and order of nodes.
    """
    scenario = read_scenario("webcam").model_copy(update={"duration_s": 0.5, "frame_interval_s": 0.05})
    rng = np.random.default_rng(8)
    scene = scene_of(scenario)
    truth = true_motion(scene.network, scenario, rng)
    off = []
    for image, positions in zip(film(scenario, scene, truth, rng), truth.positions, strict=True):
        assert (image.shape, image.dtype) == ((480, 640, 3), np.uint8)
        found = np.array([d.center_px for d in vision.detect_marks(image, [vision.MarkHue(0.0)], min_area_px=200.0)])
        for x, y in 1e3 * positions:
            # 1.25 mm a pixel, (0, 190) mm in the middle of 640 x 480, centres of pixels whole numbers
            expected = np.array([319.5 + x / 1.25, 239.5 - (y - 190.0) / 1.25])
            off.append(np.linalg.norm(found - expected, axis=1).min())
    assert len(off) == 40
    assert np.sqrt(np.mean(np.square(off))) < 0.15


def test_a_recording_is_its_seeds(tmp_path: Path):
    """Same seed: same bytes of tables, same frames. Another seed: another tremor and another film."""
    camera = STILL.camera.model_copy(update={"size_px": [320, 240]})
    short = read_scenario("webcam").model_copy(update={"duration_s": 0.25, "camera": camera})
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        simulate(short.model_copy(update={"seed": seed}), tmp_path / name)
    assert sorted(p.name for p in (tmp_path / "a").iterdir()) == ["frames.csv", "scene.toml", "truth.csv", "video.avi"]

    def read(name: str) -> tuple[bytes, bytes, np.ndarray]:
        folder = tmp_path / name
        with vision.VideoFileFrames(folder / "video.avi") as frames:
            images = np.array([frame.image for frame in frames])
        return (folder / "truth.csv").read_bytes(), (folder / "frames.csv").read_bytes(), images

    (truth_a, times_a, frames_a), (truth_b, times_b, frames_b), (truth_c, times_c, frames_c) = map(read, "abc")
    assert truth_a == truth_b
    assert truth_a != truth_c
    assert times_a == times_b == times_c
    assert np.array_equal(frames_a, frames_b)
    assert not np.array_equal(frames_a, frames_c)
    assert (tmp_path / "a" / "scene.toml").read_bytes() == (tmp_path / "c" / "scene.toml").read_bytes()
