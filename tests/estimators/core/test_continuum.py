"""The motion of a continuum against SciPy's exponentials, and its filter against finite elements of another mesh."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.sparse import csc_array, diags_array
from scipy.sparse.linalg import splu
from scipy.spatial.transform import Rotation

from dynamics import ParameterUncertainty, parameters
from dynamics.elements import continuum, continuum_network
from dynamics.mesh import Tissue, lumped_masses, rest_stiffness, surface
from estimators import FilterSettings, MarkMeasurement, OpenLoop, Status, TissueFilter, normalised_error_squared
from estimators.core import Discrepancy, TissueProcess
from estimators.core.disturbances import Disturbances
from estimators.core.motion import SOURCES
from estimators.core.motion.continuum import WALL_S
from estimators.core.statics import Statics
from estimators.process.process_model import accumulated_noise
from estimators.process.target import TargetPoint
from tests.dynamics.blocks import block

SIZE = (0.1, 0.08, 0.05)
FAT = Tissue("fat", 3e3, 0.4, 950.0, 0.03)
TARGET = np.array([0.055, 0.041, 0.022])
HZ, SD_M = 1.0 / 30.0, 5e-4


def marks_at(places):
    return {f"M{k}": place for k, place in enumerate(places)}


MARKS = marks_at(
    np.array([[x, y, 0.05] for x in (0.01, 0.05, 0.09) for y in (0.015, 0.04, 0.065)] + [[0.1, 0.03, 0.03]])
)


def seen(places, rng):
    """Marks at these places [m], by name, each coordinate off by noise."""
    return [MarkMeasurement(n, at + SD_M * rng.normal(size=3), SD_M**2 * np.eye(3)) for n, at in places.items()]


def held(mesh):
    return np.flatnonzero(mesh.nodes[:, 2] < 1e-9)


@pytest.fixture(scope="module")
def network():
    mesh = block((8, 6, 4), SIZE)
    return continuum_network(mesh, (FAT,), held(mesh), MARKS | {"target": TARGET})


@pytest.fixture(scope="module", params=[False, True], ids=["still wall", "driven wall"])
def process(request, network):
    mesh, usual = block((8, 6, 4), SIZE), Disturbances.of(FilterSettings(), solid=True)
    points = MARKS | {"target": TARGET}
    body = continuum_network(mesh, (FAT,), held(mesh), points, driven=True) if request.param else network
    return TissueProcess(body, list(MARKS), disturbances=usual)


def generator(process):
    """The matrix of the motion by its equations, and the noise density of each source at unit variance."""
    motion, solid = process.motion, process.network.continuum
    r, n, n_f = len(solid.rates), 1 + len(solid.rates), len(motion.driving)
    A = np.zeros((2 * n + n_f, 2 * n + n_f))
    A[1:n, n + 1 : 2 * n] = np.eye(r)
    A[n + 1 : 2 * n, 1:n] = -np.diag(solid.rates)
    A[n + 1 : 2 * n, n + 1 : 2 * n] = -np.diag(np.where(np.isinf(solid.masses), 1.0 / WALL_S, solid.damping))
    A[n + 1 : 2 * n, 2 * n :] = motion._basis
    A[2 * n :, 2 * n :] = -np.diag(1.0 / motion.fading_s)
    densities = np.zeros((4, len(A), len(A)))
    densities[0, n + 1 : 2 * n, n + 1 : 2 * n] = np.diag(process.span.white[1:] ** 2)
    growth = -(A[2 * n :, 2 * n :] @ motion.force_cov + motion.force_cov @ A[2 * n :, 2 * n :])
    for source in ("short", "slow"):
        own = motion.driving == SOURCES.index(source)
        densities[SOURCES.index(source), 2 * n :, 2 * n :] = growth * np.outer(own, own)
    return A, densities


@pytest.mark.parametrize("dt", [1.0 / 200.0, HZ, 0.4])
def test_the_motion_is_that_of_its_equations(process, dt):
    A, densities = generator(process)
    exact, moving = expm(A * dt), process.parts["velocity"].stop
    state = np.random.default_rng(0).normal(size=len(A))
    found = process.motion.along(state, dt)
    scale = np.abs(exact[:moving]).max()
    np.testing.assert_allclose(found.motion, exact[:moving], atol=1e-7 * scale)
    np.testing.assert_allclose(found.mean, exact @ state, atol=1e-7 * scale)
    for source, density in enumerate(densities):
        expected = accumulated_noise(A, density, dt)
        size = np.sqrt(np.outer(expected.diagonal(), expected.diagonal())) + 1e-30
        assert np.abs((found.noises[source] - expected) / size).max() < 1e-3, SOURCES[source]


def test_the_force_on_the_body_is_smooth_in_time(process):
    """Truth: the autocorrelation of an exponentially correlated force after a low-pass filter of first order."""
    motion, t = process.motion, 0.05
    (slow_s, fast_s), states = (process.disturbances.short_s, process.disturbances.smooth_s), [0, 3]
    cov, after = motion.force_cov[np.ix_(states, states)], np.exp(-t / motion.fading_s[states])
    sign = np.sign(motion._basis[np.abs(motion._basis[:, 0]).argmax(), states])
    assert sign @ cov @ sign == pytest.approx(1.0)
    expected = (slow_s * np.exp(-t / slow_s) - fast_s * np.exp(-t / fast_s)) / (slow_s - fast_s)
    assert abs(sign @ (after[:, None] * cov) @ sign) == pytest.approx(expected)
    assert 1.0 - expected < 0.1 * t / slow_s  # an exponentially correlated force would lose t / slow_s


def test_columns_of_constants_are_derivatives_of_the_motion_by_them(network):
    """Truth: the equations of motion of a tissue a little stiffer and softer, by central differences."""
    which = parameters(network)
    process = TissueProcess(network, list(MARKS), statics=Statics(ParameterUncertainty(which, [[1e-2]])))
    A, n = generator(process)[0], process.parts["position"].stop
    state = np.zeros(len(A))
    state[0], state[1:n] = 1.0, 1e-3 / network.continuum.rates  # as a force bends it
    column = process.motion.along(state, HZ / 8.0).by_constants[:, 0]
    ends = []
    for sign in (1.0, -1.0):
        other = A.copy()
        other[n + 1 : 2 * n, 1:n] -= sign * 1e-2 * network.continuum.by_tissue[0]
        ends.append(expm(other * HZ / 8.0) @ state)
    exact = 0.5 * (ends[0] - ends[1])[: 2 * n]
    for part in (slice(0, n), slice(n, 2 * n)):
        assert np.linalg.norm(column[part] - exact[part]) < 0.1 * np.linalg.norm(exact[part])


@pytest.fixture(scope="module")
def truth():
    """Places of marks and target [m] by finite elements: another mesh, pressed by a plate after 0.5 s, breathing."""
    mesh = block((11, 9, 6), SIZE, jitter=0.2)
    free = np.setdiff1d(np.arange(len(mesh.nodes)), held(mesh))
    K = csc_array(rest_stiffness(mesh, 1.5 * FAT.young_pa, FAT.poisson, free))  # the filter has two thirds of it
    masses = np.repeat(lumped_masses(mesh, FAT.density_kg_m3)[free], 3)
    M, C = diags_array(masses), FAT.damping_s * K
    outside = surface(mesh)
    drawn = np.array([*MARKS.values(), TARGET])
    weights = continuum.points_of(mesh, outside, drawn).weights
    rows = np.kron(weights.toarray()[:, free], np.eye(3))
    at = mesh.nodes[outside.nodes]
    plate = np.zeros((len(mesh.nodes), 3))
    near = np.exp(-(((at[:, :2] - [0.07, 0.05]) / 0.025) ** 2).sum(axis=1)) * (at[:, 2] > 0.0499) * outside.areas
    plate[outside.nodes, 2] = -near
    breath = masses * np.tile([1.0, 0.0, 0.0], len(free))
    h = HZ / 8.0
    factor = splu(csc_array(M + 0.5 * h * C + 0.25 * h**2 * K))
    x, v, found = np.zeros(len(masses)), np.zeros(len(masses)), []
    for step in range(round(1.5 / h)):
        t = (step + 0.5) * h
        force = 4.0 * np.sin(2.0 * np.pi * 0.3 * t) * breath
        force = force + 1500.0 * np.clip((t - 0.5) / 0.3, 0.0, 1.0) * plate[free].ravel()
        change = factor.solve(h * (force - K @ (x + 0.5 * h * v) - C @ v))
        x, v = x + h * (v + 0.5 * change), v + change
        if step % 8 == 7:
            found.append((rows @ x).reshape(-1, 3) + drawn)
    return np.array(found)


@pytest.fixture(scope="module")
def tracked(network, truth):
    """Errors of filter and open loop [m], covariances, and how far the target moves."""
    rng = np.random.default_rng(3)
    which = parameters(network)
    tissue = TissueFilter(network, "target", list(MARKS), uncertainty=ParameterUncertainty(which, [[0.4]]))
    loop, errors, loops, covs = OpenLoop(network, "target"), [], [], []
    for k, now in enumerate(truth):
        time_s = (k + 1) * HZ
        marks = seen(dict(zip(MARKS, now, strict=False)), rng)
        tissue.predict(time_s)
        found = tissue.update(marks)
        errors.append(found.mean - now[-1])
        covs.append(found.cov)
        loops.append(loop.update(time_s, marks).mean - now[-1])
    return np.array(errors), np.array(covs), np.array(loops), np.linalg.norm(truth[:, -1] - TARGET, axis=1)


def test_the_target_is_found_in_tissue_of_another_mesh_and_stiffness(tracked):
    errors, covs, loops, moved = (one[15:] for one in tracked)
    assert moved.max() > 2e-3
    rms, loop_rms = (np.sqrt((one**2).sum(axis=1).mean()) for one in (errors, loops))
    assert rms < 0.4 * loop_rms
    assert normalised_error_squared(errors, covs).mean() < 3.0 * 3.0


def test_a_known_force_displaces_the_body_as_its_stiffness_does(network):
    """0.5 N on the target for 1.5 s: u = K^-1 F, of which the modes have less than half."""
    push = np.zeros((len(network.free), 3))
    row = network.coordinates("target").start // 3
    push[row] = [0.3, 0.0, -0.4]
    shift = np.linalg.solve(network.continuum.stiffness, push.ravel()).reshape(-1, 3)
    by_modes = (network.continuum.shapes / network.continuum.rates) @ network.continuum.shapes.T @ push.ravel()
    assert np.linalg.norm(by_modes.reshape(-1, 3)[row]) < 0.5 * network.continuum.mass * np.linalg.norm(shift[row])
    rest = network.positions[network.free]
    names = [network.names[i] for i in network.free]

    def marks(by):
        return [
            MarkMeasurement(name, place, SD_M**2 * np.eye(3))
            for name, place in zip(names, rest + by, strict=True)
            if name != "target"
        ]

    tissue = TissueFilter(network, "target", list(MARKS))
    for k in range(45):
        tissue.predict(k * HZ, push if k else None)
        estimate = tissue.update(marks(shift if k else np.zeros_like(shift)))
    assert np.linalg.norm(shift[row]) > 1e-3
    np.testing.assert_allclose(estimate.mean, TARGET + shift[row], atol=2e-4)
    expected, _ = tissue.expected_of(["target", "M4"])
    np.testing.assert_allclose(expected, (rest + shift)[[row, names.index("M4")]], atol=2e-4)
    np.testing.assert_allclose(tissue.predict_at(tissue.time_s + HZ, push).mean, estimate.mean, atol=1e-4)

    fresh = TissueFilter(network, "target", list(MARKS))
    fresh.predict(0.0)
    fresh.update(marks(np.zeros_like(shift)))
    tables = fresh.tables(45, HZ)
    np.testing.assert_allclose(tables.shift(np.tile(push, (44, 1, 1)))[-1], shift[row], rtol=0.08)
    tissue.predict(tissue.time_s + HZ)
    assert not tissue.residual_m.any()


def test_marks_outside_a_coarse_mesh_do_not_displace_a_body_at_rest():
    rng = np.random.default_rng(5)
    drawn = marks_at(np.array(list(MARKS.values())) + np.outer(rng.uniform(0.0, 2.5e-3, len(MARKS)), [0.0, 0.0, 1.0]))
    mesh = block((8, 6, 4), SIZE)
    coarse = continuum_network(mesh, (FAT,), held(mesh), drawn | {"target": TARGET})
    tissue = TissueFilter(coarse, "target", list(drawn))
    for frame in range(10):
        tissue.predict(frame * HZ)
        estimate = tissue.update([MarkMeasurement(n, at, 1e-8 * np.eye(3)) for n, at in drawn.items()])
    assert np.linalg.norm(estimate.mean - TARGET) < 1e-5
    assert estimate.status is Status.TRACKING


def test_the_error_of_a_targets_place_is_apart_from_its_motion(network):
    """3 mm a coordinate beside the motion's, until fixes of 0.1 mm show it."""
    tissue = TissueFilter(network, TargetPoint(("target",), sd_m=3e-3), list(MARKS))
    exact = TissueFilter(network, "target", list(MARKS))
    for each in (tissue, exact):
        each.predict(0.0)
        each.update([MarkMeasurement(n, network.positions[network.index(n)], SD_M**2 * np.eye(3)) for n in MARKS])
    np.testing.assert_allclose(tissue.offset_cov, 9e-6 * np.eye(3), rtol=1e-9)
    np.testing.assert_allclose(tissue.tissue_cov, exact.place_of(exact.target)[1], rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(tissue.tissue_cov + tissue.offset_cov, tissue.place_of(tissue.target)[1], rtol=1e-6)
    np.testing.assert_array_equal(exact.offset_cov, np.zeros((3, 3)))
    tissue.fix(TARGET, 1e-8 * np.eye(3))
    assert np.sqrt(np.trace(tissue.offset_cov) / 3.0) < 1.5e-3


def test_strengths_of_forces_follow_the_stated_poke(network):
    """Surface forces of two strengths; the force on the body is as strong as the weaker. Twice the poke doubles all."""
    usual = FilterSettings()
    strong = replace(usual, poked=replace(usual.poked, poke=2.0 * usual.poked.poke))
    each = [TissueFilter(network, "target", list(MARKS), settings).process for settings in (usual, strong)]
    rows = np.sqrt([process.variances(0.0) for process in each]) / each[0].motion.raised
    np.testing.assert_allclose(rows[..., SOURCES.index("slow")], [[0.5, 5.0], [1.0, 10.0]])
    np.testing.assert_allclose(rows[..., SOURCES.index("short")], [[0.5, 0.5], [1.0, 1.0]])
    np.testing.assert_allclose(each[0].rates, np.array([[-1.0, 1.0], [1.0, -1.0]]) / 30.0)
    assert each[0].disturbances.calm_modes.all()
    assert [SOURCES[source] for source in each[0].motion.driving[:7]] == [*["short"] * 6, "slow"]


def test_what_the_field_of_the_discrepancy_leaves_out_is_no_contradiction():
    """A displacement drawn from the whole prior, 40 marks to 0.01 mm: the functions that are no states move by more."""
    mesh, rng, level = block((8, 6, 4), SIZE), np.random.default_rng(4), 0.005
    close = marks_at([[x, y, 0.05] for x in np.linspace(0.005, 0.095, 8) for y in np.linspace(0.005, 0.075, 5)])
    network = continuum_network(mesh, (FAT,), held(mesh), close | {"target": TARGET})
    x, prior = network.positions, Discrepancy(levels=(level,), least=1e-9, rank=1000)
    whole = prior.field(x[network.free], x[network.fixed])[0]
    moved = x.copy()
    moved[network.free] += level * whole @ rng.normal(size=(whole.shape[1], 3))
    tissue, estimates = TissueFilter(network, "target", list(close), FilterSettings(discrepancy=level)), []
    for k in range(12):
        tissue.predict(k * HZ)
        places = {n: moved[network.index(n)] + rng.normal(0.0, 1e-5, 3) for n in close}
        estimates.append(tissue.update([MarkMeasurement(n, at, 1e-10 * np.eye(3)) for n, at in places.items()]))
    assert {estimate.status for estimate in estimates[5:]} == {Status.TRACKING}
    assert np.mean([estimate.nis for estimate in estimates[5:]]) < 120.0  # its degrees of freedom


def test_unknown_forces_bend_a_floppy_body_as_far_as_a_stiff_one(process):
    """A hundredth of the stiffness has a hundredth of the force."""
    mesh = block((8, 6, 4), SIZE)
    floppy = continuum_network(
        mesh, (replace(FAT, young_pa=0.01 * FAT.young_pa),), held(mesh), MARKS | {"target": TARGET}
    )
    soft = TissueProcess(floppy, list(MARKS)).motion.raised
    assert soft < 1.0
    assert soft == pytest.approx(0.01 * process.motion.raised, rel=2e-3)


def test_constant_forces_displace_the_points_as_with_all_modes(network):
    """The omitted modes respond statically: few modes and many give the points the same static covariance."""
    found = []
    for left_out in (0.03, 0.0):
        mesh = block((8, 6, 4), SIZE)
        body = continuum_network(mesh, (FAT,), held(mesh), MARKS | {"target": TARGET}, left_out=left_out)
        process = TissueProcess(body, list(MARKS))
        n, moving, end = (process.parts[name].stop for name in ("position", "velocity", "force"))
        state = np.zeros((end - moving, process.n))
        state[:, moving:end] = np.eye(end - moving)
        state[:, 1:n] = (process.motion._basis / body.continuum.rates[:, None]).T
        moved = np.vstack([process.node(name) for name in (*MARKS, "target")]) @ state.T
        found.append((len(body.continuum.rates), moved @ moved.T))
    (few, rough), (many, exact) = found
    assert few < 0.2 * many
    np.testing.assert_allclose(rough, exact, atol=3e-3 * np.abs(exact).max())


def test_a_wall_that_moves_is_followed_apart_from_what_bends_the_body(network, truth):
    """Truth: that of above until it is pressed, on a wall that breathes by 10 mm and turns by 3 degrees."""
    mesh, which, rng = block((8, 6, 4), SIZE), parameters(network), np.random.default_rng(5)
    driven = continuum_network(mesh, (FAT,), held(mesh), MARKS | {"target": TARGET}, driven=True)
    each = [
        TissueFilter(body, "target", list(MARKS), uncertainty=ParameterUncertainty(which, [[0.4]]))
        for body in (driven, network)
    ]
    errors, nees = [], []
    for k, bent in enumerate(truth[:24]):
        share = 0.5 - 0.5 * np.cos(2.0 * np.pi * 0.4 * (k + 1) * HZ)
        turn = Rotation.from_rotvec(share * np.array([0.03, 0.04, 0.0]))
        now = turn.apply(bent) + share * np.array([0.0, 0.006, 0.008])
        marks = seen(dict(zip(MARKS, now, strict=False)), rng)
        for tissue in each:
            tissue.predict((k + 1) * HZ)
        found = [tissue.update(marks) for tissue in each]
        errors.append([one.mean - now[-1] for one in found])
        nees.append(normalised_error_squared(errors[-1][0][None], found[0].cov[None])[0])
    rms = np.sqrt((np.array(errors)[10:] ** 2).sum(axis=2).mean(axis=0))
    assert not each[0].process.span.onto[1:7].any()  # a known force moves no wall
    assert found[0].status is Status.TRACKING
    assert rms[0] < 7e-4
    assert rms[0] < 0.4 * rms[1]
    assert np.mean(nees[10:]) < 2.0 * 3.0


def test_a_body_that_nothing_holds_is_followed_as_it_drifts():
    """Shifted and turned slowly, marks to 0.5 mm: the target to 0.5 mm of it, within six standard deviations."""
    mesh, rng, errors = block((4, 3, 2), SIZE), np.random.default_rng(0), []
    free = continuum_network(mesh, (FAT,), np.empty(0, dtype=np.int64), MARKS | {"target": TARGET})
    tissue = TissueFilter(free, "target", tuple(MARKS))
    for k in range(30):
        angle, shift = 0.001 * k, 1e-3 * np.array([10.0 * np.sin(k / 10.0), 0.2 * k, 0.0])
        turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
        tissue.predict(k * HZ)
        estimate = tissue.update(seen({name: turn @ place + shift for name, place in MARKS.items()}, rng))
        errors.append(estimate.mean - turn @ TARGET - shift)
        assert normalised_error_squared(errors[-1][None], estimate.cov[None])[0] < 36.0
    assert estimate.status is Status.TRACKING
    assert np.sqrt(np.mean(np.square(errors[10:]))) < 5e-4
