"""Marks that are where the tissue is not: alone at a start, twice with a pause, or for one frame."""

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER, four_mass_phantom
from estimators import FilterSettings, FixBias, MarkMeasurement, Status, TissueFilter

FRAME_S = 1.0 / 30.0
SD = 1e-3
PHANTOM = four_mass_phantom()
AT = dict(zip(PHANTOM.names, PHANTOM.positions, strict=True))
ASIDE = [np.array([0.12, 0.0]), np.array([-0.12, 0.0]), np.array([0.0, 0.12]), np.array([0.0, -0.12])]


class Run:
    """A filter of the phantom at rest, frame by frame, with marks of 1 mm."""

    def __init__(self, sd=SD, settings=None, frame_s=FRAME_S):
        self.tissue, self.frame_s = TissueFilter(PHANTOM, HIDDEN, OUTER, settings), frame_s
        self.rng, self.sd, self.k = np.random.default_rng(0), sd, 0

    def frame(self, nodes=OUTER, off=None):
        """The estimate of a frame with the marks of these nodes, some of them off [m]."""
        self.tissue.predict(self.k * self.frame_s)
        self.k += 1
        off = {} if off is None else off
        return self.tissue.update(
            [
                MarkMeasurement(n, AT[n] + self.sd * self.rng.normal(size=2) + off.get(n, 0.0), self.sd**2 * np.eye(2))
                for n in nodes
            ]
        )

    def frames(self, n, nodes=OUTER, off=None):
        """The estimates of n such frames."""
        return [self.frame(nodes, off) for _ in range(n)]


def sigmas(estimate):
    """By how many standard deviations the target is off, by the largest of the estimate's."""
    error = np.linalg.norm(estimate.mean - AT[HIDDEN])
    return error / np.sqrt(np.linalg.eigvalsh(estimate.cov)[-1])


@pytest.mark.parametrize("others", [("M1",), ("M1", "M4")])
def test_others_at_their_places_start_without_it(others):
    """M3 120 mm off beside right marks in the first frame: the start is theirs, and M3 comes in with the second."""
    run = Run()
    estimates = [run.frame((*others, "M3"), {"M3": ASIDE[0]}), *run.frames(5, (*others, "M3"))]
    assert [e.marks_used for e in estimates] == [len(others)] + 5 * [len(others) + 1]
    assert max(sigmas(e) for e in estimates) < 3.0
    assert [e.status for e in estimates] == [Status.INITIALISING] * 3 + [Status.TRACKING] * 3
    assert run.tissue.rejected == {"M3": 1}


@pytest.mark.parametrize(("sd", "off_m"), [(1e-3, 0.25), (4.14e-3, 0.03)])
def test_an_outlier_of_one_frame_does_no_harm(sd, off_m):
    """30 to 250 mm off: never DIVERGED, and no error beyond that of a run without it by more than a mark's noise."""
    run, right = Run(sd), Run(sd)
    estimates = [run.frame(off={"M3": np.array([off_m, 0.0])} if k == 12 else None) for k in range(18)]
    expected = [right.frame() for _ in range(18)]
    assert {e.status for e in estimates[5:]} == {Status.TRACKING}
    assert run.tissue.rejected == {"M3": 1}
    assert max(np.linalg.norm(e.mean - f.mean) for e, f in zip(estimates, expected, strict=True)) < sd


@pytest.mark.parametrize("pause", [4, 60])
def test_what_was_seen_beyond_the_gate_is_forgotten_when_it_is_not_seen_there(pause):
    """The same outlier 0.25 m off again after so many frames without the mark: rejected again, as the first."""
    run = Run()
    run.frames(12)
    outlier = {"M3": np.array([0.25, 0.0])}
    assert run.frame(off=outlier).marks_used == 2
    run.frames(pause, ("M1", "M4"))
    estimate = run.frame(off=outlier)
    assert (estimate.marks_used, estimate.status) == (2, Status.TRACKING)
    assert run.tissue.rejected == {"M3": 2}
    assert np.linalg.norm(estimate.mean - AT[HIDDEN]) < SD


@pytest.mark.parametrize(("nodes", "used"), [(OUTER, 3), (("M1", "M3"), 2), (("M3",), 1)])
def test_a_slow_camera_accepts_an_impulse_at_once(nodes, used):
    """Ten frames a second, longer apart than impulse_s = 0.05 s: these marks 100 mm aside together are taken in."""
    run = Run(frame_s=0.1)
    run.frames(10)
    assert run.frame(nodes, dict.fromkeys(nodes, np.array([0.1, 0.0]))).marks_used == used
    assert not run.tissue.rejected


@pytest.mark.parametrize("off_m", [0.1, 0.15])
def test_a_slow_camera_rejects_what_the_others_contradict(off_m):
    """M3 alone beside two marks at their places, for one frame of ten a second."""
    run = Run(frame_s=0.1)
    used = [run.frame(off={"M3": np.array([0.0, off_m])} if k == 10 else None).marks_used for k in range(15)]
    assert used == [3] * 10 + [2] + [3] * 4


def test_fixes_at_different_places_do_not_confirm_each_other():
    """200 mm to one side, then to the other: both rejected; the next beside the second is taken in."""
    run = Run(settings=FilterSettings(fix_bias=FixBias(1e-3)))
    run.frames(12)
    for off_m, rejected in ((0.2, 1), (-0.2, 2), (-0.2, 2)):
        run.tissue.fix(AT[HIDDEN] + [off_m, 0.0], SD**2 * np.eye(2))
        assert run.tissue.rejected["fix"] == rejected
