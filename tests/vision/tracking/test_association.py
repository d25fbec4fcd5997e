"""Assignments against the best of all permutations, gates against the chi-square distribution."""

from itertools import permutations

import numpy as np
import pytest
from scipy.stats import chi2

from vision import Detection, Expected, associate_marks
from vision.tracking.settings import GATE

UNIT = np.eye(2)


def seen(u: float, v: float, hue_deg: float = 0.0, cov: np.ndarray = 0.01 * UNIT) -> Detection:
    return Detection(np.array([u, v]), cov, 100.0, hue_deg, False)


def awaited(name: str, u: float, v: float, hue_deg: float = 0.0, cov: np.ndarray = UNIT) -> Expected:
    return Expected(name, np.array([u, v]), cov, hue_deg)


def pairs(detections: list[Detection], expected: list[Expected], **gate: float) -> dict[str, int]:
    found = associate_marks(detections, expected, **gate)
    return {f.name: next(k for k, d in enumerate(detections) if d is f.detection) for f in found}


def test_the_gate_is_the_chi_square_quantile() -> None:
    assert pytest.approx(chi2.ppf(0.9999, 2), rel=1e-12) == GATE


def test_nothing_seen_or_nothing_expected_gives_nothing() -> None:
    assert associate_marks([], [awaited("M1", 0, 0)]) == []
    assert associate_marks([seen(0, 0)], []) == []
    assert associate_marks([], []) == []


def test_the_assignment_is_the_best_of_all() -> None:
    rng = np.random.default_rng(0)
    for _ in range(30):
        A = rng.normal(size=(2, 4, 2, 2))
        covs = A @ A.transpose(0, 1, 3, 2) + 0.5 * UNIT
        expected = [awaited(str(i), *rng.normal(0, 1.5, 2), cov=covs[0, i]) for i in range(4)]
        detections = [seen(*rng.normal(0, 1.5, 2), cov=covs[1, j]) for j in range(4)]

        def cost(order: tuple[int, ...], detections: list = detections, expected: list = expected) -> float:
            total = 0.0
            for e, j in zip(expected, order, strict=True):
                S = e.cov_px2 + detections[j].cov_px2
                off = detections[j].center_px - e.center_px
                total += off @ np.linalg.inv(S) @ off + np.log(np.linalg.det(S))
            return total

        best = min(permutations(range(4)), key=cost)
        # With the gate out of the way every mark is paired, as in the permutations.
        assert pairs(detections, expected, gate=1e6) == {str(i): j for i, j in enumerate(best)}


A, B, C = awaited("A", 0.0, 0.0), awaited("B", 20.0, 0.0), awaited("C", 100.0, 0.0)
RED, GREEN = awaited("red", 0.0, 0.0), awaited("green", 2.0, 0.0, hue_deg=120.0)
FOUR = [seen(50.0, 50.0), seen(0.1, 0.0), seen(20.0, 0.2), seen(-40.0, 0.0)]
EXPECTED = {
    # nearest first would give detection 0 to A and leave B with one beyond its gate
    "crossing": ([seen(2.4, 0.0), seen(-2.0, 0.0)], [awaited("A", 1.0, 0.0), awaited("B", 4.0, 0.0)], {"A": 1, "B": 0}),
    # d² alone would prefer the vague one; log det S sets that right
    "sure or vague": (
        [seen(0.0, 0.0)],
        [awaited("vague", 1.0, 0.0, cov=25.0 * UNIT), awaited("sure", -1.0, 0.0, cov=0.5 * UNIT)],
        {"sure": 0},
    ),
    "hues": ([seen(0.0, 0.0, hue_deg=120.0), seen(2.0, 0.0)], [RED, GREEN], {"red": 1, "green": 0}),
    "another hue": ([seen(0.0, 0.0, hue_deg=120.0)], [RED], {}),
    "more detections": (FOUR, [A, B], {"A": 1, "B": 2}),
    "more marks": (FOUR[1:2], [A, B, C], {"A": 0}),
}


@pytest.mark.parametrize("case", EXPECTED)
def test_detections_are_assigned_as_a_whole(case: str) -> None:
    detections, expected, found = EXPECTED[case]
    assert pairs(detections, expected) == found


@pytest.mark.parametrize(("factor", "found"), [(0.999, True), (1.001, False)])
def test_the_gate_counts_both_covariances(factor: float, found: bool) -> None:
    cov_expected, cov_seen = np.array([[2.0, 0.7], [0.7, 1.0]]), np.array([[0.5, -0.2], [-0.2, 0.9]])
    S = cov_expected + cov_seen
    direction = np.array([1.0, 0.5])
    direction *= np.sqrt(factor * GATE / (direction @ np.linalg.inv(S) @ direction))
    detections = [seen(*direction, cov=cov_seen)]
    assert bool(associate_marks(detections, [awaited("M1", 0, 0, cov=cov_expected)])) is found


def test_a_covariance_that_is_none_is_refused() -> None:
    with pytest.raises(ValueError, match="expected mark M1: expected a positive definite covariance"):
        associate_marks([seen(0, 0)], [awaited("M1", 0, 0, cov=-UNIT)])
