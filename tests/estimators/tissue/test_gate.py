"""Marks that cannot be where they are said to be, and what must not be mistaken for them."""

from dataclasses import replace

import numpy as np

from dynamics import HIDDEN, OUTER
from estimators import MarkMeasurement, Status, TissueFilter

FRAME_S = 4 / 120.0
SD = 1e-3


def follow(phantom, states, marks_of, moved, settings=None):
    """The filter after following marks of 1 mm, those of `moved` shifted: {(frame, node): offset [m]}; its errors."""
    rng = np.random.default_rng(8)
    tissue, errors = TissueFilter(phantom, HIDDEN, OUTER, settings), []
    for k, state in enumerate(states[::4]):
        marks = [
            replace(mark, position=mark.position + moved.get((k, mark.node), 0.0))
            for mark in marks_of(phantom, state, SD, rng)
        ]
        tissue.predict(k * FRAME_S)
        errors.append(np.linalg.norm(tissue.update(marks).mean - state[phantom.coordinates(HIDDEN)]))
    return tissue, np.array(errors)


def test_wild_marks_are_refused_counted_and_do_no_harm(phantom, rest_state, driven, poke_forces, marks_of):
    """One mark in ten frames 0.25 m off; the errors are those of a run without it, to a tenth of a mark's noise.

    Taken in, such a mark moves the hidden mass by over 50 mm, as the open gate shows.
    """
    states = driven(phantom, rest_state, poke_forces(phantom, 3.0, np.random.default_rng(8)))
    wild = {(k, OUTER[k % 3]): np.array([0.25, 0.0]) for k in range(5, 90, 10)}
    tissue, errors = follow(phantom, states, marks_of, wild)
    _, clean = follow(phantom, states, marks_of, {})
    assert sum(tissue.rejected.values()) == len(wild)
    assert abs(errors.mean() - clean.mean()) < 0.1 * SD
    assert errors.max() < 3.0 * clean.max()
    open_gate = replace(tissue.settings, gate=np.inf)
    _, harmed = follow(phantom, states, marks_of, wild, open_gate)
    assert harmed.max() > 0.05


def test_pokes_are_never_refused(phantom, rest_state, driven, poke_forces, marks_of):
    """Half-sine pokes of up to 10 m/s², every frame of 6 s: no mark is refused."""
    states = driven(phantom, rest_state, poke_forces(phantom, 6.0, np.random.default_rng(9)))
    tissue, _ = follow(phantom, states, marks_of, {})
    assert sum(tissue.rejected.values()) == 0


def test_what_stays_away_is_the_tissue(phantom):
    """All marks of a phantom at rest jump by 0.25 m and stay: refused for stubborn_s = 0.1 s, then taken in.

    No belief about the tissue explains that: DIVERGED, and in doubt about where the marks are.
    """
    at = dict(zip(phantom.names, phantom.positions, strict=True))
    tissue = TissueFilter(phantom, HIDDEN, OUTER)
    statuses = []
    for k, jump in enumerate([0.0] * 5 + [0.25] * 5):
        tissue.predict(k * FRAME_S)
        marks = [MarkMeasurement(node, at[node] + [0.0, jump], SD**2 * np.eye(2)) for node in OUTER]
        statuses.append(tissue.update(marks).status)
    assert statuses[3:5] == [Status.TRACKING] * 2
    assert statuses[5:9] == [Status.COASTING] * 4  # 0, 1/30, 2/30, 3/30 s after the first that was off
    assert statuses[9] is Status.DIVERGED
    assert tissue.rejected == dict.fromkeys(OUTER, 4)
    assert tissue.repairs == {"inflated": 1}
    np.testing.assert_allclose(tissue.expected("M3")[0], at["M3"] + [0.0, 0.25], atol=5 * SD)
