"""Filter for the pose error of a camera or tracker: a Kalman filter for each hypothesis about the last sudden move.

A reference mark with the stated place x is measured at `p = R (x + e - c) + c + t + B k + n`. The rigid motion (R, t)
about the centre c is the pose error, e is the error of the stated place, and n is noise. B contains the effects of
calibration errors k with unit variance. The errors e and k are considered, not estimated (Schmidt-Kalman filter). In
3-D, a camera measures the projection of p. The pose drifts; the rate of the drift is an Ornstein-Uhlenbeck process. In
each frame, one more hypothesis assumes that the camera was moved after the last frame. Hypotheses are weighted by their
likelihoods, and improbable ones are dropped.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from estimators.arrays import Floats
from estimators.pose.rigid import RigidMotion
from estimators.pose.settings import PoseSettings
from estimators.tissue.estimate import MarkMeasurement

ITERATIONS, NEAR = 5, 1e-3
"""Limits for an iterated update; numerical. It ends after ITERATIONS, or when an iteration changes translation [m] and
rotation [rad] by less than NEAR. The remaining error is about half the square of this change."""

START_S = 1.0
"""Time before the first frame during which a camera may have been moved [s]; choice."""

LEAST_SEEN = 3
"""Smallest number of reference marks for which a wrong mark can be identified. If two disagree, either may be wrong."""


SURE = 10.0
"""A pose change is reported if its squared Mahalanobis norm per degree of freedom exceeds this number [1]; choice."""


@dataclass(frozen=True, slots=True)
class CameraMove:
    """A reported change of a camera's pose.

    time_s: time of the change [s]; distance_m: apparent shift of the centre of the reference marks [m]
    angle_rad: apparent rotation of the reference marks [rad]
    """

    time_s: float
    distance_m: float
    angle_rad: float


@dataclass(frozen=True, slots=True, eq=False)
class PoseEstimate:
    """Estimate of the pose error at one time.

    motion: rigid motion from the true positions of points to their measured positions
    cov: error covariance of translation [m] and rotation [rad], (n, n), including errors of the reference marks'
        places. Several cameras share these errors, but each camera's filter treats them as independent (approximation).
    columns: change of translation [m] and rotation [rad] per standard deviation of each calibration error,
        (n, n_calibration)
    """

    motion: RigidMotion
    cov: Floats
    columns: Floats

    def corrected(self, mark: MarkMeasurement) -> MarkMeasurement:
        """The mark without the pose error. In the result, the last n columns of `shared` are the pose's uncertainty."""
        turned = self.motion.rotation.T
        shared = turned @ self.seen_shared(mark.position, mark.shared)
        place = self.motion.back(mark.position[None])[0]
        return MarkMeasurement(mark.node, place, _symmetric(turned @ mark.cov @ turned.T), shared)

    def seen_shared(self, seen_m: Floats, shared: Floats | None) -> Floats:
        """Shift of a mark per standard deviation of each shared error [m], (dim, n_calibration + n).

        The calibration errors come first, then the errors of the pose. seen_m: position of the mark [m], (dim,)
        shared: shift that calibration errors alone cause, as in `MarkMeasurement`, (dim, n_calibration)
        """
        J = self.motion.change_of(seen_m[None])[0]
        own = np.zeros((len(seen_m), self.columns.shape[1])) if shared is None else shared
        return np.concatenate([own + J @ self.columns, J @ np.linalg.cholesky(self.cov)], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class _Hypothesis:
    """Gaussian of the motion (n,) and of its rate (n,), with covariance P (2 n, 2 n).

    columns: change of motion and rate per standard deviation of each calibration error, then of each error in the
        stated places of the reference marks, (2 n, n_errors)
    wrong: names of the reference marks that the hypothesis rejects in this frame
    """

    motion: RigidMotion
    rate: Floats
    P: Floats
    columns: Floats
    log_weight: float = 0.0
    wrong: frozenset[str] = frozenset()


def _as_they_are(points: Floats) -> tuple[Floats, Floats]:
    """Default measurement function: the points [m], (k, dim), and unit matrices as derivatives, (k, dim, dim)."""
    return points, np.broadcast_to(np.eye(points.shape[1]), (*points.shape, points.shape[1]))


class PoseFilter:
    """Filter that estimates the pose error of a camera or tracker, frame by frame.

    places: stated positions of the reference marks by name [m], (dim,) each
    n_calibration: number of columns of the marks' `shared`
    place_sd_m: standard deviation of the error of `places` on each axis [m]
    seen: measurement function. From points [m], (k, dim), it returns measured values, (k, m), and their derivatives,
        (k, m, dim). A value that cannot be measured is not finite. A shift of a point by 1 m should change the values
        by about 1. Default: the measured values are the points themselves.
    State: time_s, the time of the state [s], None before the first frame; hypotheses, the most probable first; time of
    the last mark; pose error at the last report; wrong, names of the reference marks rejected in the last frame.
    """

    def __init__(
        self,
        places: Mapping[str, Floats],
        settings: PoseSettings | None = None,
        *,
        n_calibration: int = 0,
        place_sd_m: float = 0.0,
        seen: Callable[[Floats], tuple[Floats, Floats]] = _as_they_are,
    ) -> None:
        if not places:
            raise ValueError("reference marks: expected one or more, found none")
        self.places = {name: np.asarray(place, dtype=np.float64) for name, place in places.items()}
        self.settings = s = settings or PoseSettings()
        self._seen = seen
        centre = np.mean(list(self.places.values()), axis=0)
        dim, turns = len(centre), len(centre) * (len(centre) - 1) // 2
        self.n = n = dim + turns
        self._rate_var = np.repeat([s.rate_m_s, s.rate_rad_s], [dim, turns]) ** 2
        self._moved_var = np.repeat([s.moved_m, s.moved_rad], [dim, turns]) ** 2
        start = np.diag(np.concatenate([np.repeat([s.start_m, s.start_rad], [dim, turns]) ** 2, self._rate_var]))
        none = RigidMotion.none(centre)
        self._n_calibration, n_places = n_calibration, len(self.places) if place_sd_m > 0.0 else 0
        self._place_errors = dict(zip(self.places, place_sd_m * np.eye(len(self.places), n_places), strict=True))
        no_columns = np.zeros((2 * n, n_calibration + n_places * dim))
        self._hypotheses = [_Hypothesis(none, np.zeros(n), start, no_columns)]
        self.time_s: float | None = None
        self._seen_s: float | None = None
        self._reported = none
        self.wrong: frozenset[str] = frozenset()

    @property
    def estimate(self) -> PoseEstimate:
        """Mean and covariance of the pose error over all hypotheses."""
        first, n = self._hypotheses[0], self.n
        weights = np.exp([one.log_weight for one in self._hypotheses])
        changes = np.array([first.motion.change_to(one.motion) for one in self._hypotheses])
        mean = weights @ changes
        spread = np.einsum("k,ki,kj->ij", weights, changes - mean, changes - mean)
        own = np.einsum("k,kij->ij", weights, np.array([one.P[:n, :n] for one in self._hypotheses]))
        columns = np.einsum("k,kij->ij", weights, np.array([one.columns[:n] for one in self._hypotheses]))
        return self._pose(first.motion.changed(mean), own + spread, columns)

    @property
    def after_move(self) -> PoseEstimate:
        """Estimate of the pose error under the hypothesis that the camera has just been moved."""
        first, n = self._hypotheses[0], self.n
        return self._pose(first.motion, self._moved(first.P)[:n, :n], first.columns[:n])

    def _pose(self, motion: RigidMotion, cov: Floats, columns: Floats) -> PoseEstimate:
        by_calibration, by_places = columns[:, : self._n_calibration], columns[:, self._n_calibration :]
        return PoseEstimate(motion, _symmetric(cov + by_places @ by_places.T), by_calibration)

    def predict(self, time_s: float) -> None:
        """Predict the state at a time [s]."""
        dt = 0.0 if self.time_s is None else time_s - self.time_s
        self.time_s = time_s
        if dt <= 0.0:
            return
        n, T = self.n, self.settings.lasting_s
        a, x = np.exp(-dt / T), dt / T
        F = np.block([[np.eye(n), T * (1.0 - a) * np.eye(n)], [np.zeros((n, n)), a * np.eye(n)]])
        rate, both = np.diag(self._rate_var), T * (1.0 - a) ** 2
        moved = T**2 * max(2.0 * x - 3.0 + 4.0 * a - a**2, 0.0)
        Q = np.block([[moved * rate, both * rate], [both * rate, (1.0 - a**2) * rate]])
        self._hypotheses = [
            replace(
                one,
                motion=one.motion.changed(T * (1.0 - a) * one.rate),
                rate=a * one.rate,
                P=F @ one.P @ F.T + Q,
                columns=F @ one.columns,
            )
            for one in self._hypotheses
        ]

    def update(self, marks: Sequence[MarkMeasurement]) -> CameraMove | None:
        """Update with the reference marks at the state's time. Returns a move if one has to be reported, else None."""
        if self.time_s is None:
            raise ValueError("update: expected predict(time_s) first, found no time")
        self.wrong = frozenset()
        if not marks:
            return None
        s = self.settings
        first = self._hypotheses[0]
        unseen_s = START_S if self._seen_s is None else self.time_s - self._seen_s
        self._seen_s = self.time_s
        log_moved = float(np.log(-np.expm1(-max(unseen_s, 1e-3) / s.moved_each_s)))
        born = replace(
            first,
            rate=np.zeros(self.n),
            P=self._moved(first.P),
            columns=np.concatenate([first.columns[: self.n], np.zeros_like(first.columns[self.n :])]),
            log_weight=first.log_weight + log_moved,
        )
        updated = [self._updated(one, marks) for one in (*self._hypotheses, born)]
        order = sorted(range(len(updated)), key=lambda k: -updated[k].log_weight)
        best = updated[order[0]].log_weight
        if best == -np.inf:
            return None
        kept = [updated[k] for k in order[: s.n_hypotheses] if updated[k].log_weight > best + np.log(s.least)]
        total = float(np.logaddexp.reduce([one.log_weight for one in kept]))
        self._hypotheses = [replace(one, log_weight=one.log_weight - total) for one in kept]
        self.wrong = kept[0].wrong
        return self._report(jumped=order[0] > 0)

    def _moved(self, P: Floats) -> Floats:
        """Covariance after a sudden move, which also resets the rate of the drift."""
        n = self.n
        pose = P[:n, :n] + np.diag(self._moved_var)
        return np.block([[pose, np.zeros((n, n))], [np.zeros((n, n)), np.diag(self._rate_var)]])

    def _updated(self, one: _Hypothesis, marks: Sequence[MarkMeasurement]) -> _Hypothesis:
        """The hypothesis, updated with the marks. Marks that are more probably wrong than right are left out."""
        s, dim = self.settings, len(marks[0].position)
        found, nis = self._with(one, marks)
        used = list(marks)
        log_wrong = float(np.log(s.wrong_share) - 0.5 * dim * np.log(2.0 * np.pi * s.wrong_m**2))
        while len(used) >= LEAST_SEEN and nis > s.gate * dim * len(used):
            tried = [self._with(one, [mark for mark in used if mark is not other]) for other in used]
            k = int(np.argmax([other.log_weight for other, _ in tried]))
            n_wrong = len(marks) - len(used) + 1
            better = replace(tried[k][0], log_weight=tried[k][0].log_weight + n_wrong * log_wrong)
            if better.log_weight <= found.log_weight:
                break
            found, nis = replace(better, wrong=found.wrong | {used[k].node}), tried[k][1]
            del used[k]
        return found

    def _with(self, one: _Hypothesis, marks: Sequence[MarkMeasurement]) -> tuple[_Hypothesis, float]:
        """The hypothesis, updated with all these marks, and the marks' normalised innovation squared."""
        n, places = self.n, np.array([self.places[mark.node] for mark in marks])
        z = np.array([mark.position for mark in marks])
        dim, C = z.shape[1], one.columns
        R = np.zeros((z.size, z.size))
        for k, mark in enumerate(marks):
            R[k * dim : (k + 1) * dim, k * dim : (k + 1) * dim] = mark.cov
        none = np.zeros((dim, self._n_calibration))
        by_calibration = np.concatenate([none if mark.shared is None else mark.shared for mark in marks])
        errors = np.array([self._place_errors[mark.node] for mark in marks])
        change = np.zeros(2 * n)
        for _ in range(ITERATIONS):
            motion = one.motion.changed(change[:n])
            moved = motion.moved(places)
            seen, by_place = self._seen(moved)
            if not np.isfinite(seen).all():
                return replace(one, log_weight=-np.inf), np.inf
            H = np.zeros((z.size, 2 * n))
            H[:, :n] = (by_place @ motion.change_of(moved)).reshape(z.size, n)
            by_places = np.einsum("kmd,kN->kmNd", by_place @ motion.rotation, errors).reshape(z.size, -1)
            B = np.concatenate([by_calibration, by_places], axis=1)
            considered = H @ C + B
            S = H @ one.P @ H.T + considered @ considered.T + R
            y = (z - seen).ravel() + H @ change
            K = np.linalg.solve(S, H @ one.P + considered @ C.T).T
            before, change = change, K @ y
            if np.abs(change - before)[:n].max() < NEAR:
                break
        kept = np.eye(2 * n) - K @ H
        P = _symmetric(kept @ one.P @ kept.T + K @ R @ K.T)
        nis = float(y @ np.linalg.solve(S, y))
        log_likelihood = -0.5 * (nis + float(np.linalg.slogdet(2.0 * np.pi * S)[1]))
        after = _Hypothesis(
            one.motion.changed(change[:n]),
            one.rate + change[n:],
            P,
            kept @ C - K @ B,
            one.log_weight + log_likelihood,
        )
        return after, nis

    def _report(self, *, jumped: bool) -> CameraMove | None:
        """Change of the pose since the last report; None if the change is uncertain, or if it is only a small drift."""
        s, first, n = self.settings, self._hypotheses[0], self.n
        change = self._reported.change_to(first.motion)
        dim = len(first.motion.centre)
        distance, angle = float(np.linalg.norm(change[:dim])), float(np.linalg.norm(change[dim:]))
        certain = change @ np.linalg.solve(first.P[:n, :n], change) > SURE * n
        drifted = distance > s.drifted_m or angle > s.drifted_rad
        if not (certain and (jumped or drifted)):
            return None
        self._reported = first.motion
        assert self.time_s is not None
        return CameraMove(self.time_s, distance, angle)


def _symmetric(P: Floats) -> Floats:
    return np.asarray(0.5 * (P + P.T))
