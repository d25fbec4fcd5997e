"""The target of a phantom by the filter: truths by SciPy's DOP853 under pushes that it does not know."""

from collections.abc import Callable

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER, four_mass_phantom
from estimators import MarkMeasurement, OpenLoop, Status, normalised_error_squared
from estimators.core.discrepancy import Discrepancy
from estimators.core.track import TissueFilter
from tests.estimators.conftest import STEP, driven

FRAME = 4
"""Steps of the truth in a frame: 30 frames/s."""

Frames = list[tuple[float, list[MarkMeasurement]]]


def breath(t: float) -> np.ndarray:
    """2 m/s² on all marked nodes, over 3 s, slantwise."""
    return 2.0 * np.sin(2.0 * np.pi * t / 3.0) * np.array([0.8, 0.6])


def poke(t: float) -> np.ndarray:
    """8 m/s² for a fifth of a second, each 1.5 s."""
    return np.array([0.0, 8.0]) * (t % 1.5 > 1.3)


def still(_t: float) -> np.ndarray:
    return np.zeros(2)


def truth_of(push: Callable[[float], np.ndarray], seconds: float) -> np.ndarray:
    """Positions of the free nodes in each frame [m], (n_frames, n_free, 2)."""
    network = four_mass_phantom()
    n = round(seconds / STEP)
    forces = np.zeros((n, len(network.free), 2))
    for node in OUTER:
        at = list(network.free).index(network.index(node))
        mass = network.masses[network.index(node)]
        forces[:, at] = mass * np.array([push(k * STEP) for k in range(n)])
    rest = np.concatenate([network.positions[network.free].ravel(), np.zeros(2 * len(network.free))])
    states = np.array(driven(network, rest, forces))[::FRAME]
    return states[:, : rest.size // 2].reshape(len(states), -1, 2)


def seen(truth: np.ndarray, sd_m: float, stated_m: float | None = None, seed: int = 1) -> Frames:
    """Marks of the outer nodes with this noise, stated as such or otherwise."""
    network, rng = four_mass_phantom(), np.random.default_rng(seed)
    cov = (sd_m if stated_m is None else stated_m) ** 2 * np.eye(2)
    places = [list(network.free).index(network.index(node)) for node in OUTER]
    frames = []
    for k, x in enumerate(truth):
        noisy = [x[at] + sd_m * rng.normal(size=2) for at in places]
        frames.append((k / 30.0, [MarkMeasurement(n, z, cov) for n, z in zip(OUTER, noisy, strict=True)]))
    return frames


def hidden(truth: np.ndarray) -> np.ndarray:
    network = four_mass_phantom()
    return truth[:, list(network.free).index(network.index(HIDDEN))]


def tracked(frames: Frames, **priors: Discrepancy) -> tuple[np.ndarray, np.ndarray, list[Status]]:
    """Means, covariances and statuses from the second on."""
    tissue = TissueFilter(four_mass_phantom(), HIDDEN, OUTER, **priors)
    found = [one for block in tissue.run(frames) for one in block][30:]
    return np.array([one.mean for one in found]), np.array([one.cov for one in found]), [one.status for one in found]


def rms(errors: np.ndarray) -> float:
    return float(np.sqrt((errors**2).sum(axis=-1).mean()))


@pytest.fixture(scope="module")
def breathing() -> np.ndarray:
    return truth_of(breath, 4.0)


@pytest.mark.parametrize("sd_mm", [1.0, 10.0])
def test_a_breath_is_covered_by_coarse_marks_too(breathing: np.ndarray, sd_mm: float) -> None:
    """And the error is a third of the open loop's where marks are coarse."""
    frames = seen(breathing, 1e-3 * sd_mm)
    means, covs, statuses = tracked(frames)
    errors = means - hidden(breathing)[30:]
    covered = normalised_error_squared(errors, covs) < 5.991
    assert covered.mean() > 0.9
    assert set(statuses) == {Status.TRACKING}
    method = OpenLoop(four_mass_phantom(), HIDDEN)
    led = np.array([method.update(time_s, marks).mean for time_s, marks in frames])[30:]
    assert rms(errors) < (0.8 if sd_mm == 1.0 else 0.33) * rms(led - hidden(breathing)[30:])


def test_coarser_statements_never_make_it_surer(breathing: np.ndarray) -> None:
    """The same marks, stated as they are, five and twenty-five times as coarse: sigma rises, the truth is covered.

    As a mean over frames: single ones differ by which mode they are taken for.
    """
    sigmas = []
    for times in (1.0, 5.0, 25.0):
        means, covs, _ = tracked(seen(breathing[:90], 1e-3, times * 1e-3))
        sigmas.append(float(np.sqrt(np.trace(covs, axis1=1, axis2=2).mean())))
        covered = normalised_error_squared(means - hidden(breathing[:90])[30:], covs) < 5.991
        assert covered.mean() > 0.9
    assert np.all(np.diff(sigmas) > 0.0)


def test_a_level_that_identification_found_makes_it_surer() -> None:
    """A body at rest whose constants are exact: a tenth of the usual discrepancy gives less than half of sigma."""
    frames = seen(truth_of(still, 2.0), 1e-3)
    sigmas = []
    for prior in (Discrepancy(), Discrepancy(levels=(3e-4,))):
        _, covs, _ = tracked(frames, discrepancy=prior)
        sigmas.append(np.sqrt(np.trace(covs, axis1=1, axis2=2).mean()))
    assert sigmas[1] < 0.5 * sigmas[0]


def test_pokes_are_followed_and_said() -> None:
    truth = truth_of(poke, 4.5)
    tissue = TissueFilter(four_mass_phantom(), HIDDEN, OUTER)
    found = [one for block in tissue.run(seen(truth, 1e-3)) for one in block]
    pokes = np.array([one.poked for one in found])
    acting = np.array([bool(np.any(poke(k * FRAME * STEP - 0.05))) for k in range(len(truth))])
    for each in range(3):
        assert pokes[45 * each : 45 * (each + 1)][acting[45 * each : 45 * (each + 1)]].max(initial=0.0) > 0.7
    assert np.median(pokes[~acting]) < 0.1
    assert rms(np.array([one.mean for one in found]) - hidden(truth)) < 1e-3


def test_a_mark_that_is_something_else_is_rejected(breathing: np.ndarray) -> None:
    """One of three marks is 80 mm off in one frame: the estimate is as if it had not been seen, to a micrometre."""
    frames = seen(breathing[:90], 1e-3)
    node, other = OUTER[0], OUTER[1:]
    moved = [replaced(mark, node, 0.08) for mark in frames[60][1]]
    without = [mark for mark in frames[60][1] if mark.node in other]
    ends = []
    for marks in (moved, without):
        tissue = TissueFilter(four_mass_phantom(), HIDDEN, OUTER)
        shown = [*frames[:60], (frames[60][0], marks), *frames[61:]]
        found = [one for block in tissue.run(shown) for one in block]
        assert found[60].marks_used == 2
        ends.append(found[60].mean)
    np.testing.assert_allclose(*ends, rtol=0.0, atol=1e-6)


def replaced(mark: MarkMeasurement, node: str, by_m: float) -> MarkMeasurement:
    return MarkMeasurement(mark.node, mark.position + by_m, mark.cov) if mark.node == node else mark


def test_without_marks_it_coasts_then_is_lost_then_begins_again(breathing: np.ndarray) -> None:
    frames = seen(breathing[:60], 1e-3)
    tissue = TissueFilter(four_mass_phantom(), HIDDEN, OUTER)
    first = [one.status for block in tissue.run(frames) for one in block]
    assert first[0] == Status.INITIALISING
    assert first[-1] == Status.TRACKING
    last_s, sigmas = frames[-1][0], []
    for after_s, status in ((0.5, Status.COASTING), (1.5, Status.LOST), (4.0, Status.LOST)):
        tissue.predict(last_s + after_s)
        estimate = tissue.update([])
        assert estimate.status == status
        assert estimate.cov is not None
        sigmas.append(np.trace(estimate.cov))
    assert sigmas[0] < sigmas[1] <= 1.5 * sigmas[2]
    tissue.predict(last_s + 20.0)
    assert tissue.update([]).status == Status.LOST
    again = tissue.update(frames[-1][1])
    assert (again.status, again.marks_used) == (Status.INITIALISING, len(OUTER))
