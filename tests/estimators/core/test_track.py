"""The target of a phantom by the filter: truths by SciPy's DOP853 under pushes that it does not know."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER, four_mass_phantom, pack
from estimators import MarkMeasurement, OpenLoop, Status, TargetEstimate, normalised_error_squared
from estimators.core.track import TissueFilter
from tests.estimators.conftest import STEP, driven, followed, marks_of

FRAME = 4
"""Steps of the truth in a frame: 30 frames/s."""
PHANTOM = four_mass_phantom()

Frames = list[tuple[float, list[MarkMeasurement]]]


def breath(t: float) -> np.ndarray:
    """2 m/s² on all marked nodes, over 3 s, slantwise."""
    return 2.0 * np.sin(2.0 * np.pi * t / 3.0) * np.array([0.8, 0.6])


def poke(t: float) -> np.ndarray:
    """8 m/s² for a fifth of a second, each 1.5 s."""
    return np.array([0.0, 8.0]) * (t % 1.5 > 1.3)


def truth_of(push: Callable[[float], np.ndarray], seconds: float) -> np.ndarray:
    """States of the phantom in each frame, (n_frames, n_state)."""
    free = PHANTOM.free
    marked = np.isin(free, [PHANTOM.index(node) for node in OUTER])
    pushes = np.array([push(k * STEP) for k in range(round(seconds / STEP))])
    forces = (marked * PHANTOM.masses[free])[:, None] * pushes[:, None]
    rest = pack(PHANTOM.positions[free], np.zeros((len(free), 2)))
    return driven(PHANTOM, rest, forces)[::FRAME]


def seen(truth: np.ndarray, sd_m: float, times: float = 1.0) -> Frames:
    """Marks of the outer nodes with this noise, stated as so many times as large."""
    rng = np.random.default_rng(1)
    frames = [(k / 30.0, marks_of(PHANTOM, state, sd_m, rng)) for k, state in enumerate(truth)]
    return [(t, [replace(mark, cov=times**2 * mark.cov) for mark in marks]) for t, marks in frames]


def tracked(frames: Frames, truth: np.ndarray) -> tuple[np.ndarray, np.ndarray, list[TargetEstimate]]:
    """Errors of the target, their covariances and the estimates from half a second on."""
    found = followed(TissueFilter(PHANTOM, HIDDEN, OUTER), frames)[15:]
    errors = np.array([one.mean for one in found]) - truth[15:, PHANTOM.coordinates(HIDDEN)]
    return errors, np.array([one.cov for one in found]), found


def rms(errors: np.ndarray) -> float:
    return float(np.sqrt((errors**2).sum(axis=-1).mean()))


@pytest.fixture(scope="module")
def breathing() -> np.ndarray:
    return truth_of(breath, 1.5)


@pytest.mark.parametrize("sd_mm", [1.0, 10.0])
def test_a_breath_is_covered_by_coarse_marks_too(breathing: np.ndarray, sd_mm: float) -> None:
    """And the error is a third of the open loop's where marks are coarse."""
    frames = seen(breathing, 1e-3 * sd_mm)
    errors, covs, found = tracked(frames, breathing)
    assert (normalised_error_squared(errors, covs) < 5.991).mean() > 0.9
    assert {one.status for one in found} == {Status.TRACKING}
    method = OpenLoop(PHANTOM, HIDDEN)
    led = np.array([method.update(time_s, marks).mean for time_s, marks in frames])
    off = led - breathing[:, PHANTOM.coordinates(HIDDEN)]
    assert rms(errors) < (0.8 if sd_mm == 1.0 else 0.33) * rms(off[15:])


def test_coarser_statements_never_make_it_surer(breathing: np.ndarray) -> None:
    """The same marks, stated as they are, five and twenty-five times as coarse: sigma rises, the truth is covered."""
    sigmas = []
    for times in (1.0, 5.0, 25.0):
        errors, covs, _ = tracked(seen(breathing, 1e-3, times), breathing)
        sigmas.append(float(np.sqrt(np.trace(covs, axis1=1, axis2=2).mean())))
        assert (normalised_error_squared(errors, covs) < 5.991).mean() > 0.9
    assert np.all(np.diff(sigmas) > 0.0)


def test_pokes_are_followed_and_said() -> None:
    truth = truth_of(poke, 3.0)
    errors, _, found = tracked(seen(truth, 1e-3), truth)
    pokes = np.array([one.poked for one in found])
    acting = np.array([bool(np.any(poke(k / 30.0 - 0.05))) for k in range(15, len(truth))])
    for each in (slice(0, 40), slice(40, 75)):
        assert pokes[each][acting[each]].max(initial=0.0) > 0.8
    assert np.median(pokes[~acting]) < 0.1
    assert rms(errors) < 1e-3
