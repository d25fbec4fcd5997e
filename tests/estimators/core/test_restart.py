"""Where the filter restarts: where the body was, and as drawn if that fails too. The truth is a rigid motion."""

from copy import deepcopy
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from estimators import MarkMeasurement, Status
from estimators.core import TissueFilter, track
from tests.networks import build_network

SD_M, LAST = 5e-4, 60
"""Noise of the marks [m]; frame of the first trouble."""


class Followed:
    """A square without anchors, its middle hidden, moved by 0.3 m and turned by half in 1.5 s, or at rest."""

    def __init__(self, moves: float) -> None:
        places = [[-0.05, -0.05], [0.05, -0.05], [0.05, 0.05], [-0.05, 0.05], [0.0, 0.0]]
        springs = [(0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4)]
        self.network, self.moves, self.jump_m = build_network(places, springs, damping=0.3), moves, 0.0
        self.rng, self.tissue = np.random.default_rng(1), TissueFilter(self.network, "N4", self.network.names[:4])
        for k in range(LAST):
            self.frame(k)

    def frame(self, k: int, *, seen: bool = True) -> tuple[float, Status]:
        """The next frame: error of the target [m], and status."""
        done = self.moves * min(k / 45, 1.0)
        cos, sin = np.cos(np.pi * done), np.sin(np.pi * done)
        truth = self.network.positions @ np.array([[cos, sin], [-sin, cos]]) + [0.3 * done + self.jump_m, 0.0]
        noisy = truth + SD_M * self.rng.normal(size=truth.shape)
        names = self.network.names[:4] if seen else ()
        marks = [MarkMeasurement(name, noisy[i], SD_M**2 * np.eye(2)) for i, name in enumerate(names)]
        self.tissue.predict(k / 30)
        found = self.tissue.update(marks)
        return float(np.linalg.norm(found.mean - truth[4])), found.status

    def misplace(self, by: np.ndarray) -> None:
        """The filter restarts with its coordinates displaced by this [m]."""
        then = self.tissue.snapshot()
        self.tissue.restore(replace(then, own={**then.own, "_placed": then.own["_placed"] + by}))

    def diverge(self, k: int) -> tuple[float, Status]:
        """The next frame, after frames whose marks contradicted the filter."""
        self.tissue.health = replace(self.tissue.health, innovations=((k / 30 - 0.01, 1e4, 8, 0.0),))
        return self.frame(k)


first = lru_cache(Followed)


def until_trouble(moves: float) -> Followed:
    """A square followed until the first trouble, each time another."""
    return deepcopy(first(moves))


def test_after_a_divergence_it_restarts_where_the_body_was():
    followed = until_trouble(moves=1.0)
    found = [followed.diverge(LAST), *(followed.frame(LAST + k) for k in range(1, 15))]
    assert [found[0][1], found[-1][1]] == [Status.DIVERGED, Status.TRACKING]
    assert max(error for error, _ in found) < 2e-3


@pytest.mark.parametrize("seen", [range(45), [299]], ids=["1.5 s", "10 s without a frame"])
def test_after_a_loss_it_restarts_where_the_body_was(seen):
    followed, frames = until_trouble(moves=1.0), seen[-1] + 1
    lost = [followed.frame(LAST + k, seen=False) for k in seen]
    found = [followed.frame(LAST + frames + k) for k in range(15)]
    assert [lost[-1][1], found[-1][1]] == [Status.LOST, Status.TRACKING]
    assert max(error for error, _ in found) < 5e-3


def test_after_another_divergence_at_once_it_restarts_as_drawn():
    """The restart is in a wrong shape: the middle beyond a side."""
    followed = until_trouble(moves=0.0)
    followed.misplace(np.array([0.0] * 8 + [0.15, 0.0]))
    error, status = followed.diverge(LAST)
    assert (error > 0.05, status) == (True, Status.DIVERGED)
    error, status = followed.diverge(LAST + 1)
    assert (error < 2e-3, status) == (True, Status.DIVERGED)
    assert followed.tissue.repairs["restarted"] == 2


def test_marks_that_a_restart_refuses_lead_to_one_as_drawn():
    followed = until_trouble(moves=0.0)
    for k in range(45):
        followed.frame(LAST + k, seen=False)
    followed.misplace(np.full(10, 10.0))
    found = [followed.frame(LAST + 45 + k) for k in range(15)]
    assert found[0][1] is Status.LOST
    assert found[-1][1] is Status.TRACKING
    assert found[-1][0] < 2e-3


def test_a_body_that_jumps_is_found_with_its_second_frame(monkeypatch):
    """Four marks contradict the prediction, for 0.13 mark-seconds; a restart after one frame would follow a glitch."""
    monkeypatch.setattr(track, "REFUTED_S", 0.1)
    followed = until_trouble(moves=0.0)
    followed.jump_m = 0.1
    found = [followed.frame(LAST + k) for k in range(20)]
    assert [status for _, status in found[:2]] == [Status.COASTING, Status.DIVERGED]
    assert max(error for error, _ in found[1:]) < 5e-3
    assert found[-1][1] is Status.TRACKING


def test_a_glitch_of_all_marks_in_one_frame_is_not_followed():
    followed = until_trouble(moves=0.0)
    followed.jump_m = 0.1
    assert followed.frame(LAST)[1] is Status.COASTING
    followed.jump_m = 0.0
    found = [followed.frame(LAST + k) for k in range(1, 5)]
    assert {status for _, status in found} == {Status.TRACKING}
    assert followed.tissue.repairs["restarted"] == 0
