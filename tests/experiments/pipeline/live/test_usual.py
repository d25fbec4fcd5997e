"""What a scene leaves unsaid: targets and forces against rest shapes of bodies and pictures that are so far off."""

from dataclasses import replace

import numpy as np
import pytest

from dynamics import ParameterUncertainty, parameters, rest_shape, scale_parameters
from estimators import MarkMeasurement, StaticBalance, TissueFilter
from experiments.formats.scenario import read_scenario
from experiments.formats.scene.scene import Scene
from experiments.pipeline.line import Line
from experiments.pipeline.live.usual import USUAL, balance_of
from experiments.simulation.simulate import scene_of

SMALL = 1e-3
"""Relative change by which slopes are taken: shifts of the target bend by as much."""


@pytest.fixture(scope="module")
def scene() -> Scene:
    """The phantom that comes along; nothing is said of its constants, nor of its camera's scale."""
    return scene_of(read_scenario("webcam"))


@pytest.fixture(scope="module")
def tissue(scene: Scene) -> TissueFilter:
    return Line(scene, baseline=False).filter


def stiffnesses(scene: Scene) -> list:
    return parameters(scene.network, ("stiffness",))


def marked(scene: Scene) -> list[int]:
    return [scene.network.index(node) for node in scene.measured_nodes]


def larger(scene: Scene, share: float) -> np.ndarray:
    """The nodes as a camera sees them whose millimetres are so much too large, about the middle of its picture [m]."""
    camera = scene.cameras[0]
    middle = camera.to_plane((np.array([camera.size_px]) - 1.0) / 2.0)
    return middle + (1.0 + share) * (scene.network.positions - middle)


def target_m(scene: Scene, changes: np.ndarray, share: float = 0.0) -> np.ndarray:
    """Where the target rests while marks stay where they are seen, springs stiffer by exp(changes)."""
    network = scale_parameters(scene.network, stiffnesses(scene), changes)
    positions, held = network.positions.copy(), network.fixed.copy()
    positions[marked(scene)] = larger(scene, share)[marked(scene)]
    held[marked(scene)] = True
    return rest_shape(replace(network, positions=positions, fixed=held))[network.index(scene.target.node)]


def of_stiffnesses(scene: Scene) -> np.ndarray:
    """Covariance of the target by usual errors of the springs, each by itself [m²]."""
    n = len(stiffnesses(scene))
    slopes = [(target_m(scene, SMALL * one) - target_m(scene, np.zeros(n))) / SMALL for one in np.eye(n)]
    return USUAL.stiffness**2 * np.einsum("ki,kj->ij", slopes, slopes)


def of_scale(scene: Scene) -> np.ndarray:
    """Covariance of the target by the usual error of the camera's scale [m²]."""
    none = np.zeros(len(stiffnesses(scene)))
    slope = (target_m(scene, none, SMALL) - target_m(scene, none)) / SMALL
    return USUAL.scale**2 * np.outer(slope, slope)


def stated(scene: Scene, *, constants: bool = False, scale_sd: float | None = None, seen: bool = True) -> Scene:
    """The scene with constants known to 1 %, a scale that is known, or no camera at all."""
    which = stiffnesses(scene)
    known = ParameterUncertainty(which, np.full((1, len(which)), 0.01))
    cameras = tuple(replace(one, scale_sd=scale_sd) for one in scene.cameras) if seen else ()
    return replace(scene, uncertainty=known if constants else None, cameras=cameras)


def probability(scene: Scene, tissue: TissueFilter, positions: np.ndarray) -> float:
    """Of the force that marks ask for that are seen here for a second."""
    balance, found = balance_of(scene, tissue)[0], None
    for k in range(31):
        marks = [
            MarkMeasurement(node, positions[scene.network.index(node)], 1e-9 * np.eye(2))
            for node in scene.measured_nodes
        ]
        found = balance.update(k / 30.0, marks)
    assert found is not None
    return found.probability


@pytest.mark.parametrize("constants", [False, True])
@pytest.mark.parametrize(("scale_sd", "seen"), [(None, True), (0.01, True), (None, False)])
def test_a_target_is_as_uncertain_as_what_is_unsaid_makes_it_and_no_more(scene, tissue, constants, scale_sd, seen):
    """Within 1 %: the slopes are those of small changes; the largest, 2.5 mm, is of the scale."""
    expected = np.zeros((2, 2))
    if not constants:
        expected += of_stiffnesses(scene)
    if seen and scale_sd is None:
        expected += of_scale(scene)
    cov = balance_of(stated(scene, constants=constants, scale_sd=scale_sd, seen=seen), tissue)[1]
    np.testing.assert_allclose(cov, expected, atol=0.01 * (2.5e-3) ** 2, rtol=0.01)


def test_a_cut_spring_contradicts_whichever_it_is(scene, tissue):
    """Where each stiffness was off by itself, that of one would be hidden."""
    n = len(stiffnesses(scene))
    cut = [rest_shape(scale_parameters(scene.network, stiffnesses(scene), np.log(1e-3) * one)) for one in np.eye(n)]
    assert max(probability(scene, tissue, positions) for positions in cut) < 1e-3


def test_a_scale_that_may_be_off_contradicts_nothing_and_one_that_is_said_to_be_exact_does(scene, tissue):
    seen = larger(scene, USUAL.scale)
    assert probability(scene, tissue, seen) > 0.05
    assert probability(stated(scene, scale_sd=0.0), tissue, seen) < 1e-3


def test_constants_that_are_stated_are_those_of_the_balance(scene, tissue):
    """By the covariance of its force, which no stiffness known to 1 % makes as wide as one known to 30 %."""
    balance = balance_of(stated(scene, constants=True, scale_sd=0.0), tissue)[0]
    other = StaticBalance(tissue, stated(scene, constants=True).uncertainty)
    marks = [
        MarkMeasurement(node, scene.network.positions[scene.network.index(node)], 1e-9 * np.eye(2))
        for node in scene.measured_nodes
    ]
    found = [(balance.update(k / 30.0, marks), other.update(k / 30.0, marks)) for k in range(31)][-1]
    assert found[0] is not None
    assert found[1] is not None
    np.testing.assert_allclose(found[0].cov, found[1].cov, rtol=1e-12)
