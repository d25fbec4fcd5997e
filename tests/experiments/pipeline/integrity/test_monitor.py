"""When an estimate may guide: bodies that rest otherwise than their scene says, frame by frame."""

from dataclasses import replace

import numpy as np
import pytest

from dynamics import integrate_adaptive, pack, rest_shape, unpack
from estimators import CommonShift, Status, TargetEstimate
from experiments.formats.scenario import read_scenario
from experiments.formats.scene.marks import Mark
from experiments.formats.scene.reference import Reference, ReferenceMark
from experiments.formats.scene.scene import Scene
from experiments.pipeline.integrity import UNTESTED, IntegrityMonitor
from experiments.pipeline.line import Line
from experiments.pipeline.live.marks.receiver import MarksFrame
from experiments.pipeline.live.session import Session
from experiments.simulation.simulate import scene_of
from tests.experiments.pipeline.tables import measured

FRAME_S = 1.0 / 30.0
AWAY = np.array([0.6, 0.8])


@pytest.fixture(scope="module")
def scene() -> Scene:
    return scene_of(read_scenario("webcam"))


def faults(
    scene: Scene, positions: np.ndarray, *, frames: int = 60, seen_from: int = 0, restarts_at: int | None = None
) -> list[str | None]:
    """What a monitor says of each frame in which marks stand here [m], (n_nodes, dim), the filter TRACKING."""
    monitor, found = IntegrityMonitor(scene, Line(scene, baseline=False).filter), []
    for frame in range(frames):
        if frame == restarts_at:
            monitor.restart()
        shown = frame >= seen_from
        marks = measured(scene, scene.measured_nodes if shown else (), 1e-3, positions)
        estimate = TargetEstimate(frame * FRAME_S, np.zeros(2), 1e-6 * np.eye(2), Status.TRACKING, len(marks))
        found.append(monitor.take(estimate, marks))
    return found


def cut(scene: Scene) -> np.ndarray:
    """Where the body rests without the spring of its target that bears most [m], (n_nodes, dim)."""
    network = scene.network
    i, j = network.springs.T
    lengths = np.linalg.norm(network.positions[j] - network.positions[i], axis=1)
    tension = np.abs(network.stiffness * (lengths - network.rest_lengths))
    own = (network.springs == network.index(scene.target.node)).any(axis=1)
    stiffness = np.where(np.arange(len(own)) == np.argmax(np.where(own, tension, -1.0)), 1e-3, 1.0) * network.stiffness
    return rest_shape(replace(network, stiffness=stiffness))


def test_nothing_guides_before_the_forces_were_tested(scene):
    """Two seconds from the first marks on."""
    found = faults(scene, scene.network.positions, seen_from=10, frames=90)
    assert found == [UNTESTED] * 70 + [None] * 20


def test_a_spring_that_is_cut_from_the_start_never_guides(scene):
    found = faults(scene, cut(scene))
    assert None not in found
    assert "a persistent force on" in found[-1]


def test_what_was_tested_is_tested_again_after_a_reset(scene):
    found = faults(scene, scene.network.positions, frames=140, restarts_at=70)
    assert (found[69], found[70], found[139]) == (None, UNTESTED, None)


def pushed(scene: Scene, poke_m_s2: float, frames: int) -> np.ndarray:
    """Where the nodes are in each frame [m], (frames, n_nodes, dim): M1 is poked after 0.5 s; by SciPy's integrator."""
    network, rest, m = scene.network, rest_shape(scene.network)[scene.network.free], scene.network.index("M1")
    push = np.where(np.arange(len(rest)) == np.flatnonzero(network.free == m), poke_m_s2 * network.masses[m], 0.0)

    def force(t: float) -> np.ndarray:
        return np.column_stack([push, np.zeros(len(push))]) * (0.5 <= t < 0.7)

    start, times_s = pack(rest, np.zeros_like(rest)), FRAME_S * np.arange(frames)
    states = integrate_adaptive(network, start, times_s, force=force, max_step_s=0.05, rtol=1e-7, atol=1e-9)
    places = np.tile(network.positions, (frames, 1, 1))
    places[:, network.free] = unpack(states, 2)[0]
    return places


@pytest.mark.parametrize(
    ("moved_mm", "poke_m_s2", "of", "found"),
    [
        (10.0, 0.0, "all", True),
        (10.0, 5.0, "all", True),
        (0.0, 15.0, "all", False),
        (10.0, 0.0, "M3", False),
        (10.0, 0.0, "all and reference marks", False),
    ],
)
def test_marks_that_all_move_at_once_end_guidance_with_that_frame(scene, tmp_path, moved_mm, poke_m_s2, of, found):
    """Of marks to 1 mm, by 10 mm after 1 s; not a poke of 15 m/s², not a mark that is 10 mm off once.

    Reference marks show the camera's move, and correct the others by it.
    """
    places, rng, nodes = pushed(scene, poke_m_s2, 40), np.random.default_rng(5), scene.measured_nodes
    if "reference" in of:
        anchors = tuple(name for name, fixed in zip(scene.network.names, scene.network.fixed, strict=True) if fixed)
        look = Mark("", 300.0, 0.03)
        marks = tuple(ReferenceMark(name, name, look=replace(look, node=name)) for name in anchors)
        scene, nodes = replace(scene, reference=Reference(marks)), nodes + anchors
    session = Session(scene, tmp_path / "estimates.csv", lambda _text: None, clock=lambda: 0.0, rehearse=False)
    reasons = []
    for k, each in enumerate(places):
        off = each + 1e-3 * rng.normal(size=each.shape)
        if k == 30 or (k > 30 and "all" in of):
            off[[scene.network.index(node) for node in nodes if "all" in of or node == of]] += 1e-3 * moved_mm * AWAY
        session.take(MarksFrame(k, FRAME_S * k, tuple(measured(scene, nodes, 1e-3, off))))
        reasons.append(session.integrity.contradiction.reason)
    assert set(reasons[:30]) == {None}
    if found:
        assert set(reasons[30:]) == {"all marks moved together, as when the camera is moved: look, then reset"}
        session.reset()
    assert session.integrity.contradiction.reason is None
    session.close()


def test_marks_of_a_body_that_a_hand_may_lead_move_together(scene):
    found = []
    for settings in (scene.settings, replace(scene.settings, led_nodes=("M1",))):
        tissue = Line(scene, baseline=False).filter
        tissue.settings = settings
        monitor = IntegrityMonitor(scene, tissue)
        seen = TargetEstimate(0.0, np.zeros(2), 1e-6 * np.eye(2), Status.TRACKING, 3, 104.0)
        monitor.take(replace(seen, shift=CommonShift(3, 4.0, 100.0)), ())
        found.append(monitor.contradiction.reason is not None)
    assert found == [True, False]
