"""What a scene leaves unsaid: targets and forces against rest shapes of bodies and pictures that are so far off."""

from dataclasses import replace

import numpy as np
import pytest

from dynamics import ParameterUncertainty, parameters, rest_shape, scale_parameters
from estimators import StaticBalance, Status, TargetEstimate, TissueFilter
from experiments.formats.scenario import read_scenario
from experiments.formats.scene.reference import Reference
from experiments.formats.scene.scene import Scene, network_digest
from experiments.formats.scene.schema import Step
from experiments.pipeline.events import rest_is_known
from experiments.pipeline.integrity import USUAL, balance_of, error_budget, target_variances, unstated, variance_shares
from experiments.pipeline.line import Line
from experiments.pipeline.sight.space import calibration_shifts
from experiments.simulation.simulate import scene_of
from tests.experiments.in_space import breast
from tests.experiments.pipeline.tables import measured
from vision import triangulated

SMALL = 1e-3
"""Relative change by which slopes are taken: shifts of the target bend by as much."""


@pytest.fixture(scope="module")
def scene() -> Scene:
    """The phantom that comes along; nothing is stated of its constants, its camera's scale, nor of drift."""
    return replace(scene_of(read_scenario("webcam")), reference=Reference())


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


def target_m(scene: Scene, changes: np.ndarray, seen: np.ndarray | None = None, heavier: float = 0.0) -> np.ndarray:
    """Where the target rests while marks stay where they are seen, springs stiffer by exp(changes).

    seen: where all nodes are seen, (n_nodes, dim); heavier: by how much the target's node is, relative
    """
    network = scale_parameters(scene.network, stiffnesses(scene), changes)
    positions, held, masses = network.positions.copy(), network.fixed.copy(), network.masses.copy()
    positions[marked(scene)] = (network.positions if seen is None else seen)[marked(scene)]
    masses[network.index(scene.target.node)] *= 1.0 + heavier
    held[marked(scene)] = True
    body = replace(network, positions=positions, fixed=held, masses=masses)
    return rest_shape(body)[network.index(scene.target.node)]


@pytest.fixture(scope="module")
def lacks(scene: Scene) -> dict[str, np.ndarray]:
    """Covariances of the target [m²] by usual errors of each spring, the target's mass, the camera's scale and drift.

    The marks hold all other free nodes.
    """
    n, step_m = len(stiffnesses(scene)), 1e-5
    none = np.zeros(n)
    rest = target_m(scene, none)
    moved = {
        "springs": [USUAL.stiffness / SMALL * (target_m(scene, SMALL * one) - rest) for one in np.eye(n)],
        "mass": [USUAL.mass / SMALL * (target_m(scene, none, heavier=SMALL) - rest)],
        "scale": [USUAL.scale / SMALL * (target_m(scene, none, larger(scene, SMALL)) - rest)],
        "drift": [
            USUAL.drift_m / step_m * (target_m(scene, none, scene.network.positions + step_m * one) - rest)
            for one in np.eye(2)
        ],
    }
    return {name: np.einsum("ki,kj->ij", slopes, slopes) for name, slopes in moved.items()}


def stated(scene: Scene, *, constants: bool = False, scale_sd: float | None = None, seen: bool = True) -> Scene:
    """The scene with constants known to 1 %, a scale that is known, or no camera at all."""
    which = stiffnesses(scene)
    known = ParameterUncertainty(which, np.full((1, len(which)), 0.01))
    cameras = tuple(replace(one, scale_sd=scale_sd) for one in scene.cameras) if seen else ()
    return replace(scene, uncertainty=known if constants else None, cameras=cameras)


def probability(scene: Scene, tissue: TissueFilter, positions: np.ndarray) -> float:
    """Of the force that marks ask for that are seen here for a second."""
    balance, marks = balance_of(scene, tissue), measured(scene, scene.measured_nodes, 10**-4.5, positions)
    *_, found = (balance.update(k / 30.0, marks) for k in range(31))
    return found.probability


@pytest.mark.parametrize("constants", [False, True])
@pytest.mark.parametrize(("scale_sd", "seen"), [(None, True), (0.01, True), (None, False)])
def test_the_filter_lacks_what_the_scene_leaves_unstated_and_no_more(scene, tissue, lacks, constants, scale_sd, seen):
    """Within 1 %: the slopes are those of small changes; the scale's is the largest, 2.5 mm."""
    expected = lacks["drift"].copy()
    if not constants:
        expected += lacks["springs"] + lacks["mass"]
    if seen and scale_sd is None:
        expected += lacks["scale"]
    cov = unstated(error_budget(stated(scene, constants=constants, scale_sd=scale_sd, seen=seen), tissue))
    np.testing.assert_allclose(cov, expected, atol=0.01 * (2.5e-3) ** 2, rtol=0.01)


def test_a_place_that_is_not_stated_widens_what_is_advised_and_a_stated_one_the_estimate(scene, tissue):
    known = unstated(error_budget(scene, tissue))
    silent = replace(scene, target=replace(scene.target, position_sd_m=None))
    more = unstated(error_budget(silent, Line(silent, baseline=False).filter)) - known
    np.testing.assert_allclose(more, USUAL.position_m**2 * np.eye(2), rtol=1e-9)
    loose = replace(scene, target=replace(scene.target, position_sd_m=4e-3))
    wider = Line(loose, baseline=False).filter
    np.testing.assert_allclose(unstated(error_budget(loose, wider)), known, rtol=1e-9)
    estimates = []
    for each in (tissue, wider):
        filter_ = TissueFilter(scene.network, each.target.point, scene.measured_nodes, scene.settings)
        filter_.predict(0.0)
        estimates.append(filter_.update(measured(scene, scene.measured_nodes, 1e-3)))
    added = estimates[1].cov - estimates[0].cov
    np.testing.assert_allclose(added, 16e-6 * np.eye(2), rtol=1e-6, atol=1e-12)


def test_a_body_that_rests_elsewhere_than_it_is_drawn_is_as_uncertain_as_that_unless_measured(scene):
    """The sag of the target by `rest_shape`, where the scene takes the body to be weightless.

    After `identify --at-rest` it is no error: the constants' covariance has what later steps move the rest by.
    """
    floating = replace(scene, network=replace(scene.network, gravity=np.zeros(2)))
    at = scene.network.index(scene.target.node)
    sag = np.linalg.norm((rest_shape(floating.network) - floating.network.positions)[at])
    assert sag > 1e-3
    budget = error_budget(floating, Line(floating, baseline=False).filter)
    [source] = [one for one in budget if one.name.startswith("rest")]
    np.testing.assert_allclose(source.cov, sag**2 * np.eye(2), rtol=1e-9)
    step = Step(step="at-rest", program="0.9.0", network_sha256=network_digest(floating), scene_sha256="0" * 64)
    rested = replace(floating, steps=(step,))
    assert rest_is_known(rested)
    budget = error_budget(rested, Line(rested, baseline=False).filter)
    assert not [one for one in budget if one.name.startswith("rest")]


def test_the_largest_source_is_named_first(scene, tissue):
    silent = replace(scene, target=replace(scene.target, position_sd_m=20e-3))
    estimate = TargetEstimate(0.0, np.zeros(2), 5e-4 * np.eye(2), Status.TRACKING, 3)
    budget = error_budget(silent, tissue)
    shares = variance_shares(budget, estimate)
    variances = target_variances(budget, estimate)
    assert variances["marks and disturbances"] == pytest.approx(1e-3 - sum(s.variance for s in budget if s.considered))
    assert variances["the target's position in the tissue"] == pytest.approx(2 * 20e-3**2)
    fixed = target_variances(budget, replace(estimate, cov=1e-6 * np.eye(2)))
    assert sum(fixed.values()) == pytest.approx(2e-6 + np.trace(unstated(budget)))
    assert fixed["marks and disturbances"] == pytest.approx(0.0, abs=1e-12)
    assert next(iter(shares)) == "the target's position in the tissue"
    assert sum(shares.values()) == pytest.approx(1.0)
    assert shares["marks and disturbances"] == pytest.approx(0.25 * shares["the target's position in the tissue"])


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
    balance = balance_of(stated(scene, constants=True, scale_sd=0.0), tissue)
    other = StaticBalance(tissue, stated(scene, constants=True).uncertainty)
    marks = measured(scene, scene.measured_nodes, 10**-4.5)
    found = [(balance.update(k / 30.0, marks), other.update(k / 30.0, marks)) for k in range(31)][-1]
    np.testing.assert_allclose(found[0].cov, found[1].cov, rtol=1e-12)


def test_the_calibration_of_cameras_in_space_is_in_the_budget() -> None:
    """A camera further away by one standard deviation moves marks and target as the source says; usual: the scale."""
    step = np.zeros((1, 15))
    step[0, 14] = 1e-3
    exact = breast()
    stated = replace(exact, space_cameras=tuple(replace(one, calibration=step) for one in exact.space_cameras))
    for scene, name in ((stated, "the camera's calibration"), (exact, "the camera's calibration (default)")):
        filters = Line(scene, baseline=False).filter
        (source,) = [one for one in error_budget(scene, filters) if one.name.startswith("the camera's")]
        assert source.name == name
        assert source.considered == (scene is stated)
        assert 1e-5 < np.sqrt(source.variance) < 2e-3
        assert balance_of(scene, filters) is not None
    places = exact.network.positions[[exact.network.index(node) for node in exact.measured_nodes]]
    shifts = calibration_shifts(stated)(places)
    for place, shift in zip(places, shifts, strict=True):
        aways = []
        for k in range(2):  # each camera has an error of its own
            seen_by = list(exact.space_cameras)
            seen_by[k] = replace(seen_by[k], pose=seen_by[k].pose.moved(step[0, 9:]))
            seen_px = np.array([camera.project(place[None])[0] for camera in seen_by])
            found = triangulated(exact.space_cameras, seen_px, np.tile(np.eye(2), (2, 1, 1)))
            aways.append(found.positions[0] - place)
        np.testing.assert_allclose(shift @ shift.T, np.transpose(aways) @ aways, rtol=0.05, atol=1e-11)
