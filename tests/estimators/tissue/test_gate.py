"""Marks that cannot be where they are said to be, and what must not be mistaken for them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import cholesky
from scipy.spatial.distance import mahalanobis
from scipy.stats import multivariate_normal

from dynamics import HIDDEN, OUTER
from estimators import FilterSettings, MarkMeasurement, Status, TissueFilter
from estimators.tissue.gate import Frame, gate_marks, squared_distance

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

    Taken in, such a mark moves the hidden mass by over 50 mm, as the open gate shows where no mark is ever an outlier.
    """
    states = driven(phantom, rest_state, poke_forces(phantom, 3.0, np.random.default_rng(8)))
    wild = {(k, OUTER[k % 3]): np.array([0.25, 0.0]) for k in range(5, 90, 10)}
    tissue, errors = follow(phantom, states, marks_of, wild)
    _, clean = follow(phantom, states, marks_of, {})
    assert sum(tissue.rejected.values()) == len(wild)
    assert abs(errors.mean() - clean.mean()) < 0.1 * SD
    assert errors.max() < 3.0 * clean.max()
    open_gate = replace(tissue.settings, gate=np.inf, outlier_odds=1e-300)
    _, harmed = follow(phantom, states, marks_of, wild, open_gate)
    assert harmed.max() > 0.05


def test_pokes_are_never_refused(phantom, rest_state, driven, poke_forces, marks_of):
    """Half-sine pokes of up to 10 m/s², every frame of 6 s: no mark is refused."""
    states = driven(phantom, rest_state, poke_forces(phantom, 6.0, np.random.default_rng(9)))
    tissue, _ = follow(phantom, states, marks_of, {})
    assert sum(tissue.rejected.values()) == 0


def test_what_stays_away_is_the_tissue(phantom):
    """All marks of a phantom at rest jump by 0.25 m and stay: refused for stubborn_s = 0.1 s, then taken in.

    No belief about the tissue explains that, but a blow in every frame: DIVERGED within 0.2 s of those.
    """
    at = dict(zip(phantom.names, phantom.positions, strict=True))
    tissue = TissueFilter(phantom, HIDDEN, OUTER)
    statuses = []
    for k, jump in enumerate([0.0] * 5 + [0.25] * 10):
        tissue.predict(k * FRAME_S)
        marks = [MarkMeasurement(node, at[node] + [0.0, jump], SD**2 * np.eye(2)) for node in OUTER]
        statuses.append(tissue.update(marks).status)
    assert statuses[3:5] == [Status.TRACKING] * 2
    assert statuses[5:9] == [Status.COASTING] * 4  # 0, 1/30, 2/30, 3/30 s after the first that was off
    assert Status.COASTING not in statuses[9:]
    assert statuses[14] is Status.DIVERGED
    assert all(tissue.rejected[node] >= 4 for node in OUTER)
    assert tissue.repairs["inflated"] == 1


MEANS = {"A": np.array([0.1, -0.2]), "B": np.array([0.3, 0.05])}
OWN = {"A": 1e-4 * np.array([[4.0, 1.0], [1.0, 2.0]]), "B": 1e-4 * np.array([[1.0, -0.5], [-0.5, 3.0]])}
COLUMNS = {"A": 3e-2 * np.array([[1.0, 0.2], [0.3, -1.0]]), "B": 1e-2 * np.array([[0.5, 0.0], [-0.4, 0.8]])}
SHARED = 1e-2 * np.array([[0.7, -0.3], [0.2, 1.1]])
NOISE = 1e-5 * np.array([[3.0, -1.0], [-1.0, 2.0]])


def where(node, shared):
    """A node whose own error has covariance OWN, with calibration errors moving it by COLUMNS and its mark by both."""
    total = COLUMNS[node] if shared is None else COLUMNS[node] + shared
    return MEANS[node], OWN[node] + total @ total.T


def frame(settings, *, considered=False):
    """A frame at 1 s, the first."""
    return Frame(1.0, -np.inf, settings, considered)


def at_distance(node, squared, S, shared=None):
    """A mark of that squared Mahalanobis distance by S from where the node is expected."""
    off = cholesky(S, lower=True) @ np.array([0.6, -0.8]) * np.sqrt(squared)
    return MarkMeasurement(node, MEANS[node] + off, NOISE, shared)


@pytest.mark.parametrize("shared", [None, SHARED])
@pytest.mark.parametrize("considered", [True, False])
def test_the_distance_of_a_mark_allows_for_a_shared_error_once(shared, considered):
    """(C + F)(C + F)' where the columns hold the calibration; C C' and F F', independent, where they do not. 1e-10."""
    mark = MarkMeasurement("A", np.array([0.15, -0.1]), NOISE, shared)
    C, F = COLUMNS["A"], np.zeros((2, 2)) if shared is None else SHARED
    S = OWN["A"] + NOISE + ((C + F) @ (C + F).T if considered else C @ C.T + F @ F.T)
    expected = mahalanobis(mark.position, MEANS["A"], np.linalg.inv(S)) ** 2
    assert squared_distance(mark, where, considered=considered) == pytest.approx(expected, rel=1e-10)


def test_rejected_marks_are_as_likely_as_marks_at_the_gate():
    """SciPy's log density of marks put at the gate, of each the sum; one of them shares an error. 1e-10.

    S = P + R, both with what is shared; of a mark within the gate nothing is added.
    """
    settings = FilterSettings(gate=9.0)
    shared = {"A": None, "B": SHARED}
    S = {
        node: OWN[node] + COLUMNS[node] @ COLUMNS[node].T + NOISE + (0.0 if F is None else F @ F.T)
        for node, F in shared.items()
    }
    far = [at_distance(node, 100.0, S[node], F) for node, F in shared.items()]
    near = at_distance("A", 0.5, S["A"])
    gated = gate_marks([*far, near], where, where, {}, frame=frame(settings))
    expected = sum(
        multivariate_normal(MEANS[node], S[node]).logpdf(at_distance(node, 9.0, S[node]).position) for node in shared
    )
    assert gated.rejected == ("A", "B")
    assert gated.accepted == [near]
    assert gated.log_likelihood == pytest.approx(expected, rel=1e-10)
    assert gate_marks([near], where, where, {}, frame=frame(settings)).log_likelihood == 0.0


def test_the_gate_considers_what_columns_hold():
    """A calibration error that undoes that of the columns: 20 where they hold it, and below 9 as independent noise."""
    undone = -COLUMNS["A"]
    mark = at_distance("A", 20.0, OWN["A"] + NOISE, undone)
    settings = FilterSettings(gate=9.0)
    for considered, rejected in ((True, ("A",)), (False, ())):
        gated = gate_marks([mark], where, where, {}, frame=frame(settings, considered=considered))
        assert gated.rejected == rejected


def test_a_mark_on_the_gate_is_within_it():
    """3, 4 and 5, in numbers without rounding."""

    def there(_node, _shared):
        return np.zeros(2), 0.75 * np.eye(2)

    mark = MarkMeasurement("A", np.array([3.0, 4.0]), 0.25 * np.eye(2))
    for gate, rejected in ((25.0, ()), (np.nextafter(25.0, 0.0), ("A",))):
        gated = gate_marks([mark], there, there, {}, frame=frame(FilterSettings(gate=gate)))
        assert gated.rejected == rejected
