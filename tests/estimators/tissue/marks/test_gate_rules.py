"""The gate's rules, one by one, on numbers without rounding: times in binary fractions, covariances that sum to one."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from estimators import FilterSettings, MarkMeasurement
from estimators.tissue.gate import Frame, Gated, Outlying, confirmed, gate_marks, gate_start

SETTINGS = FilterSettings(gate=25.0, impulse_m_s=1.0, impulse_s=0.5, confirm_s=0.125)
ON_GATE, BEYOND, FAR = np.array([3.0, 4.0]), np.array([30.0, 40.0]), np.array([-300.0, 400.0])
WITHIN = np.array([1.0, 0.0])


def there(_node, _shared):
    """Marks with a covariance of a quarter have distances by the identity."""
    return np.zeros(2), 0.75 * np.eye(2)


def after_impulse(_node, _shared):
    """An impulse has BEYOND on the gate, and FAR beyond it."""
    return np.zeros(2), 99.75 * np.eye(2)


def mark(node: str, position: np.ndarray) -> MarkMeasurement:
    return MarkMeasurement(node, position, 0.25 * np.eye(2))


def at(time_s: float, before_s: float = -np.inf) -> Frame:
    return Frame(time_s, before_s, SETTINGS, False)


def seen(since_s: float, last_s: float, position: np.ndarray = BEYOND) -> Outlying:
    return Outlying(since_s, last_s, position, 0.25 * np.eye(2))


def nodes(gated: Gated) -> tuple[list[str], tuple[str, ...]]:
    """Nodes of the accepted marks, and of the rejected ones."""
    return [one.node for one in gated.accepted], gated.rejected


@pytest.mark.parametrize(
    ("places", "since_before_s", "accepted"),
    [
        ([BEYOND], 0.25, []),  # the next frame is soon enough to confirm it
        ([BEYOND], 0.5, []),
        ([BEYOND], 0.5 * (1.0 + 0.5e-6), []),  # by rounding only later than an impulse lasts
        ([BEYOND], 0.5 * (1.0 + 2e-6), ["A"]),  # the next frame is too late: now or never
        ([FAR], 1.0, []),  # not even an impulse brings it there
        ([BEYOND, WITHIN], 1.0, ["B"]),  # contradicted by another
        ([BEYOND, ON_GATE], 1.0, ["B"]),  # one on the gate is within it
        ([BEYOND, BEYOND, WITHIN], 1.0, ["A", "B", "C"]),  # two of them are not
        ([BEYOND, BEYOND], 1.0, ["A", "B"]),
        ([], 1.0, []),
    ],
)
def test_where_frames_are_slow_a_mark_is_believed_at_once(places, since_before_s, accepted):
    """Unless it is a single one that others contradict, or no impulse explains it."""
    marks = [mark(node, place) for node, place in zip("ABC", places, strict=False)]
    gated = gate_marks(marks, there, after_impulse, {}, frame=at(4.0 + since_before_s, 4.0))
    assert nodes(gated) == (accepted, tuple(one.node for one in marks if one.node not in accepted))


@pytest.mark.parametrize(
    ("known", "position", "accepted"),
    [
        (seen(0.9375, 0.9375), BEYOND, True),  # seen there before, and an impulse explains it
        (seen(0.9375, 0.9375, FAR), FAR, False),  # seen there before, but too far for an impulse
        (seen(0.875, 0.9375, FAR), FAR, False),  # for no more than confirm_s
        (seen(0.8125, 0.9375, FAR), FAR, True),  # for longer
        (seen(0.8125, 0.9375), FAR, False),  # seen, but elsewhere
    ],
)
def test_what_is_seen_again_beyond_the_gate_is_the_tissue(known, position, accepted):
    gated = gate_marks([mark("A", position)], there, after_impulse, {"A": known}, frame=at(1.0, 0.9375))
    assert nodes(gated) == ((["A"], ()) if accepted else ([], ("A",)))


@pytest.mark.parametrize(
    ("far", "within", "taken"),
    [
        ("ABCD", "", True),
        ("ABCD", "EFGH", True),  # half of the frame's
        ("ABCD", "EFGHI", False),  # less than half
        ("ABCDE", "FGHI", True),
        ("ABC", "", False),  # fewer than four
        ("AAAA", "", False),  # four marks of one node are one witness
    ],
)
def test_a_crowd_beyond_the_gate_is_the_tissue(far, within, taken):
    """Four nodes together that no impulse explains, half of a frame's marks or more, in its first frame."""
    marks = [*(mark(node, FAR) for node in far), *(mark(node, WITHIN) for node in within)]
    gated = gate_marks(marks, there, after_impulse, {}, frame=at(1.0, 0.9375))
    assert nodes(gated) == ([*(far if taken else ""), *within], () if taken else tuple(far))


@pytest.mark.parametrize(
    ("last_s", "before_s", "since_s"),
    [
        (0.5, 0.5, 0.25),  # in the frame before
        (0.5, 0.25, 0.25),
        (0.875, 0.9375, 0.25),  # not in the frame before, but confirm_s ago
        (0.75, 0.9375, 1.0),  # longer ago, with a frame without it between
    ],
)
def test_a_break_ends_what_was_seen_beyond_the_gate(last_s, before_s, since_s):
    gated = gate_start([mark("A", BEYOND)], there, {"A": seen(0.25, last_s)}, frame=at(1.0, before_s), n_marked=2)
    now = gated.outlying["A"]
    assert (now.since_s, now.last_s) == (since_s, 1.0)
    np.testing.assert_array_equal(now.position, BEYOND)
    np.testing.assert_array_equal(now.cov, 0.25 * np.eye(2))


@pytest.mark.parametrize(("gate", "within"), [(25.0, True), (float(np.nextafter(25.0, 0.0)), False)])
@pytest.mark.parametrize(("gap_s", "reach"), [(0.25, 0.25), (0.5, 0.5), (2.0, 0.5)])
def test_it_may_have_moved_by_an_impulse_meanwhile(gate, within, gap_s, reach):
    """Of 1 m/s for the gap, and for no longer than 0.5 s; 3, 4 and 5 by the sum of the covariances and that squared."""
    settings = FilterSettings(gate=gate, impulse_m_s=1.0, impulse_s=0.5)
    half = 0.5 * (1.0 - reach**2) * np.eye(2)
    then, now = Outlying(0.0, 4.0, WITHIN, half), Outlying(0.0, 4.0 + gap_s, WITHIN + ON_GATE, half)
    assert confirmed(then, now, settings) is within


def test_a_mark_within_the_gate_is_forgotten_as_an_outlier():
    known = {"A": seen(0.0, 0.5), "B": seen(0.25, 0.5)}
    for gated in (
        gate_marks([mark("A", ON_GATE)], there, there, known, frame=at(1.0, 0.5)),
        gate_start([mark("A", ON_GATE)], there, known, frame=at(1.0, 0.5), n_marked=2),
    ):
        assert nodes(gated) == (["A"], ())
        assert gated.outlying == {"B": known["B"]}
    assert set(known) == {"A", "B"}  # what came in is as it was


@pytest.mark.parametrize(
    ("places", "n_marked", "accepted"),
    [
        ({"A": [WITHIN], "B": [ON_GATE]}, 2, "AB"),
        ({"A": [BEYOND]}, 2, ""),
        ({"A": [BEYOND]}, 1, ""),  # the only mark there is: not at its first frame
        ({"A": [BEYOND, FAR]}, 2, ""),  # two marks of one node are one witness
        ({"A": [BEYOND], "B": [WITHIN], "C": [ON_GATE]}, 3, "BC"),
        ({"A": [WITHIN], "B": [BEYOND], "C": [ON_GATE]}, 3, "AC"),
        ({"A": [BEYOND], "B": [FAR]}, 2, "AB"),  # several together: the tissue is elsewhere
        ({"A": [BEYOND], "B": [WITHIN], "C": [FAR]}, 3, "ABC"),
    ],
)
def test_a_start_takes_what_is_not_alone_beyond_the_gate(places, n_marked, accepted):
    marks = [mark(node, place) for node, own in places.items() for place in own]
    gated = gate_start(marks, there, {}, frame=at(1.0), n_marked=n_marked)
    assert nodes(gated) == (list(accepted), tuple(one.node for one in marks if one.node not in accepted))
    assert set(gated.outlying) == {one.node for one in marks if np.linalg.norm(one.position) > 5.0}


@pytest.mark.parametrize(
    ("since_s", "n_marked", "accepted"),
    [(0.875, 1, False), (0.8125, 1, True), (0.8125, 2, False), (0.8125, 3, False)],
)
def test_the_only_mark_there_is_starts_it_after_confirm_s(since_s, n_marked, accepted):
    """Seen there for longer than 0.125 s, and where no other could be."""
    known = {"A": seen(since_s, 0.9375)}
    gated = gate_start([mark("A", BEYOND)], there, known, frame=at(1.0, 0.9375), n_marked=n_marked)
    assert nodes(gated) == ((["A"], ()) if accepted else ([], ("A",)))
    assert gated.outlying["A"].since_s == since_s


def test_a_rejected_start_is_as_likely_as_marks_at_the_gate():
    """SciPy's log density of a mark at the gate, of each of two; of none within it. 1e-10."""
    both = gate_start([mark("A", BEYOND), mark("A", FAR)], there, {}, frame=at(1.0), n_marked=2)
    expected = multivariate_normal(np.zeros(2), np.eye(2)).logpdf(ON_GATE)
    assert both.log_likelihood == pytest.approx(2.0 * expected, rel=1e-10)
    assert gate_start([mark("A", WITHIN)], there, {}, frame=at(1.0), n_marked=2).log_likelihood == 0.0


def test_a_start_considers_what_columns_hold():
    """A calibration error that undoes that of the columns counts only where they hold it."""
    shared = np.diag([6.0, 8.0])

    def calibrated(_node, own):
        total = -shared if own is None else own - shared
        return np.zeros(2), 0.75 * np.eye(2) + total @ total.T

    one = MarkMeasurement("A", 2.0 * ON_GATE, 0.25 * np.eye(2), shared)
    for considered, rejected in ((True, ("A",)), (False, ())):
        frame = Frame(1.0, -np.inf, SETTINGS, considered)
        assert gate_start([one], calibrated, {}, frame=frame, n_marked=2).rejected == rejected
