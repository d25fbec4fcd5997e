"""The filter of the tissue: unscented filters of its equations of motion, mixed by how they explain the marks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from dynamics import MassSpringNetwork, ParameterUncertainty, carried, rest_shape
from estimators.arrays import Floats
from estimators.filters.adaptation import VarianceScale
from estimators.process.known_force import ForceHistory
from estimators.process.open_loop_cov import OpenLoopCovariance
from estimators.process.target import TargetMap, TargetPoint, target_map
from estimators.tissue.estimate import GaussianMixture, MarkMeasurement, Status, TargetEstimate
from estimators.tissue.fix import fix_measurement
from estimators.tissue.gate import Frame, Gated, Outlying, confirmed, gate_marks, gate_start
from estimators.tissue.health import Health, after_frame
from estimators.tissue.model import model_of
from estimators.tissue.model_error import ModelError
from estimators.tissue.prediction import (
    MixtureViews,
    advance,
    expected_place,
    known_force,
    later_times,
    mixture_of_modes,
    place_and_cov,
    places_under_force,
    reported,
    reported_place,
    target_by_modes,
    target_path,
    until,
)
from estimators.tissue.settings import FilterSettings
from estimators.tissue.snapshot import Snapshot, all_or_nothing, mixture_state, restore_mixture, unchanged
from estimators.tissue.start import after_divergence, forget, restart_from_marks, restart_from_shape
from estimators.tissue.update import StackedMarks, check_marks, information_shares, innovation, outliers_of, stack_marks

Place: TypeAlias = tuple[Floats, Floats] | None


class TissueFilter(MixtureViews):
    """Position of the target: unscented filters of the tissue, quiet, poked and struck, mixed by the marks.

    target: the node that is meant, by name, or a point beside it or between several; as an attribute, its map from the
        state, by which every output is made
    network: one without anchors hangs on its marks, and its weight is left out
    n_calibration: directions that the `shared` of marks has, if these, errors of the camera's calibration, are the same
        in every frame and considered; at 0 they are taken to be drawn again in each
    uncertainty: None: known; of a stiff or large body a strain of `settings.strain_sd` is considered beside it
    State: mixture (the bank of filters); time_s, of the state, None before the first frame; health; when each mark was
    last taken in and what was seen of it beyond the gate; rejected, counts by node or `fix`; repairs, counts of sigma
    points `narrowed`, covariances made `definite`, states `inflated` after a divergence, `restarted` after another or a
    loss, `forgotten` in a gap; open_loop, the covariance that the paper's method would have; marks_scale, factor on the
    marks' variances; log_likelihood, of the last marks, a rejected one as if at the gate; 0 of those of a start. A call
    of predict, update or fix that raises leaves all of it as it was.
    """

    def __init__(
        self,
        network: MassSpringNetwork,
        target: str | TargetPoint,
        marked: Sequence[str],
        settings: FilterSettings | None = None,
        *,
        uncertainty: ParameterUncertainty | None = None,
        n_calibration: int = 0,
    ) -> None:
        self.n_calibration, sd_m = n_calibration, 0.0 if isinstance(target, str) else target.sd_m
        asked, network = settings or FilterSettings(), carried(network)
        self.model, self.settings = model_of(
            network, marked, asked, uncertainty=uncertainty, n_calibration=n_calibration, offset_sd_m=sd_m
        )
        network = self.model.network
        self.time_s: float | None = None
        self._updated_s: float | None = None
        self.health, self.log_likelihood = Health(), 0.0
        self.rejected: Counter[str] = Counter()
        self._before_s = self._refuted_s = -np.inf
        self._outlying: dict[str, Outlying] = {}
        self._seen_s: dict[str, float] = {}
        self._marked, self.target = tuple(marked), target_map(network, target, self.model.offset_rows)
        self._places = {name: network.coordinates(name) for name in (network.names[i] for i in network.free)}
        self._rest = rest_shape(network)
        self._modes, self._forget_s = self.settings.modes, max(self.settings.forget_s, self.settings.lost_s)
        self.mixture = mixture_of_modes(self.model, self.settings, self._modes)
        restart_from_shape(self.mixture, self.model, self.settings, self._rest)
        P, self._start_columns = self.mixture.filters[0].P, self.mixture.columns[0].copy()
        self._model_only_m2 = self.settings.model_only_share * self.target.tissue_m2(self.target.cov(P), P)
        self._start_cov = P.copy()
        self._start_cov[self.model.slow, self.model.slow] = 0.0
        driven = [node for node in marked if (node,) != self.target.point.nodes]
        self._driven = frozenset(driven)
        self.open_loop = OpenLoopCovariance(network, self.target.point, driven, self.settings.quiet.white)
        self._outliers = outliers_of(network, self._rest, self.settings)
        self.marks_scale, self.model_error = (
            VarianceScale(asked.marks_bounds),
            ModelError(self.model, self.settings, marked),
        )

    @property
    def seen_s(self) -> float | None:
        """When a mark was last taken in [s], None before the first."""
        return None if self.health.since_s is None else self.health.seen_s

    def snapshot(self) -> Snapshot:
        """The whole state now, for `restore`."""
        return Snapshot(
            self.time_s,
            mixture_state(self.mixture),
            self.health,
            self._seen_s.copy(),
            self._outlying.copy(),
            self.rejected.copy(),
            self._updated_s,
            self._before_s,
            self._refuted_s,
            self.open_loop.cov,
            (self.marks_scale.scale, self.marks_scale.information),
            self.log_likelihood,
            self.model_error.shown,
        )

    def restore(self, then: Snapshot) -> None:
        """Set the state back to a snapshot."""
        restore_mixture(self.mixture, then.mixture)
        self.time_s, self.health = then.time_s, then.health
        self._seen_s, self._outlying = then.seen_s.copy(), then.outlying.copy()
        self.rejected, self._before_s = then.rejected.copy(), then.before_s
        self._updated_s, self._refuted_s, self.open_loop.cov = then.updated_s, then.refuted_s, then.open_loop_cov
        self.marks_scale.scale, self.marks_scale.information = then.marks_scale
        self.log_likelihood, self.model_error.shown = then.log_likelihood, then.shown

    @all_or_nothing
    def predict(self, time_s: float, push: ForceHistory | None = None) -> None:
        """Move the state to this exposure time [s]; raises ValueError where time goes back or is not finite.

        Over more than forget_s the state is forgotten, and the target LOST. push: a known force, such as a needle's
        """
        if not np.isfinite(time_s):
            raise ValueError(f"time_s: expected a finite time, found {time_s}")
        if self.time_s is not None:
            dt = time_s - self.time_s
            if dt < 0:
                raise ValueError(f"time_s: expected {self.time_s} or later, found {time_s}")
            if dt > 0:
                self._advance(dt, push)
                self.model_error.passed(dt)
            if dt > self._forget_s and self.health.since_s is not None:
                self.health = replace(self.health, status=Status.LOST)
        self.time_s = time_s

    def _advance(self, dt: float, push: ForceHistory | None = None) -> None:
        moved = min(dt, self._forget_s)
        if moved < dt:
            forget(self.mixture, self.model, self.settings, self._rest, seconds=dt - moved)
        force = known_force(push, self.model, None if self.time_s is None else self.time_s + dt - moved)
        advance(self.mixture, self.model, self._modes, moved, mix_s=self.settings.mix_s, push=force)

    def predict_at(self, time_s: float, push: ForceHistory | None = None) -> TargetEstimate:
        """The target at a later time [s] given the marks until now, such as when the needle arrives; the state stays.

        push: as for `predict`. Raises ValueError before the first frame, and for a time that is past or not finite.
        """
        dt = until(time_s, self.time_s)
        with unchanged(self.mixture), reported(self.mixture, self.target, self.model_error):
            if dt > 0.0:
                self._advance(dt, push)
            return self._estimate(time_s, 0, None, place=place_and_cov(self.mixture, self.target))

    def predict_modes(self, time_s: float, push: ForceHistory | None = None) -> GaussianMixture:
        """As `predict_at`, of each mode of now and each of then by itself, n_modes² Gaussians.

        Nearer to the truth where a poke may have begun or ended and may not have: to merge those that go on in one mode
        would give the certain one the spread of the uncertain one. Costs n_modes times `predict_at`.
        """
        dt = until(time_s, self.time_s)
        with reported(self.mixture, self.target, self.model_error):
            return target_by_modes(self.mixture, self.target, lambda: self._advance(dt, push) if dt > 0.0 else None)

    def predict_path(self, times_s: Floats) -> tuple[Floats, Floats]:
        """The target at later times [s], (k,), as `predict_at`: means [m] (k, dim), covs [m²] (k, dim, dim).

        One way through all of them; the state stays. As `predict_at` of each, but for where its steps begin: modes
        are mixed at each of these times, too. Raises ValueError as that does, and for times that go back.
        """
        _, steps = later_times(times_s, self.time_s)
        with reported(self.mixture, self.target, self.model_error):
            return target_path(self.mixture, self.target, steps, self._advance)

    def expected(self, node: str, shared: Floats | None = None) -> tuple[Floats, Floats]:
        """Where to search for a free node's mark [m], (dim,), and the covariance of that [m²], (dim, dim).

        shared: what errors of the calibration move the mark by, as `MarkMeasurement.shared`; None for the node itself
        By the widest mode that is possible, not by the mixture: see `expected_place`.
        """
        own = None if shared is None else self.model.among_columns(shared)
        return expected_place(self.mixture, self._places[node], own, self.settings)

    def expected_of(self, nodes: Sequence[str]) -> tuple[Floats, Floats]:
        """Places of free nodes [m], (n, dim), and their covariances [m²], (n, dim, dim), where forces act."""
        return places_under_force(self.mixture, [self._places[node] for node in nodes])

    def expected_after_impulse(self, node: str, shared: Floats | None = None) -> tuple[Floats, Floats]:
        """As `expected`, [m] (dim,) and [m²] (dim, dim), had an impulse on the node followed just after its last mark.

        Before the first marks a node may be anywhere in the network's reach.
        """
        mean, cov = self.expected(node, shared)
        if self.seen_s is None or self.time_s is None:
            reach = float(np.ptp(self._rest, axis=0).max())
        else:
            since_s = self.time_s - self._seen_s.get(node, self.time_s)
            reach = self.settings.impulse_m_s * min(since_s, self.settings.impulse_s)
        return mean, cov + reach**2 * np.eye(len(mean))

    def expected_at_rest(self, node: str) -> tuple[Floats, Floats]:
        """As `expected`, [m] (dim,) and [m²] (dim, dim), at rest, without marks; inflated: it may be displaced."""
        place, mean = self._places[node], self._rest[self.model.network.index(node)].copy()
        return mean, self.settings.inflation * self._start_cov[place, place]

    def _expected_at_start(self, node: str, shared: Floats | None = None) -> tuple[Floats, Floats]:
        place = self._places[node]
        columns = self._start_columns[place]
        if shared is not None:
            columns = columns + self.model.among_columns(shared)
        return self._rest[self.model.network.index(node)], self._start_cov[place, place] + columns @ columns.T

    @all_or_nothing
    def update(self, marks: Sequence[MarkMeasurement]) -> TargetEstimate:
        """Take in the marks that were seen at the state's time, any number of them, and estimate the target.

        Raises ValueError for a mark that is not on a free node or has another dimension, CovarianceError where the
        marks leave no finite state.
        """
        if self.time_s is None:
            raise ValueError("update: expected predict(time_s) before, found no time")
        check_marks(marks, self._places, self.model)
        dt = 0.0 if self._updated_s is None else self.time_s - self._updated_s
        self._before_s = self._before_s if self._updated_s is None or dt <= 0.0 else self._updated_s
        self._updated_s = self.time_s
        scale = self.marks_scale.scale
        marks = marks if scale == 1.0 else [replace(mark, cov=scale * mark.cov) for mark in marks]
        starting = self.health.since_s is None or self.health.status is Status.LOST
        shift = None
        if marks and not starting:
            shift = innovation(self.mixture, stack_marks(marks, self._places, self.model), self.target).shift
        gated = self._gated(self.time_s, marks, starting=starting)
        accepted, self.log_likelihood = gated.accepted, gated.log_likelihood
        covs = {mark.node: mark.total_cov for mark in accepted if mark.node in self._driven}
        self.open_loop.take(min(dt, self._forget_s), covs)
        if not accepted:
            self.health = after_frame(self.health, self.time_s, None, 0, self.settings)
            return replace(self._estimate(self.time_s, 0, None), shift=shift)
        stacked = stack_marks(accepted, self._places, self.model)
        found = innovation(self.mixture, stacked, self.target)
        if starting:
            self._start(self.time_s, accepted, stacked)
            self.model_error.learn(accepted, self.mixture, None)
            return self._estimate(self.time_s, len(accepted), found.nis)
        self.mixture.update_linear(stacked.z, stacked.H(self.model.dim_x), stacked.R, stacked.shared, self._outliers)
        self.log_likelihood += self.mixture.log_likelihood
        nis, blow = min(f.nis for f in self.mixture.filters), self.settings.blow_share(self.mixture.mu)
        if self.settings.marks_bounds != (1.0, 1.0):
            self.marks_scale.learn(found.y, stacked.R / scale, found.S - stacked.R, dt)
        self.health = now = after_frame(self.health, self.time_s, nis, len(found.y), self.settings, blow=blow)
        if now.status is Status.DIVERGED and not now.innovations:
            self._refuted(self.time_s, accepted, stacked)
        self._seen_s |= dict.fromkeys((mark.node for mark in accepted), self.time_s)
        self.model_error.learn(accepted, self.mixture, found.nis)
        shares = information_shares(accepted, found, float(np.trace(self.target.cov(self.mixture.P))))
        estimate = self._estimate(self.time_s, len(accepted), found.nis)
        return replace(estimate, information_share=shares, shift=shift)

    @all_or_nothing
    def fix(self, position: Floats, cov: Floats) -> TargetEstimate:
        """Take in a direct sighting of the target at the state's time: position [m], (dim,), its covariance [m²].

        The error that fixes have in common is estimated beside it where the settings have a fix_bias. A fix beyond the
        gate is rejected, but the next one there is taken in. Raises ValueError for another dimension, for numbers that
        are not finite, and for a covariance that is none.
        """
        if self.time_s is None:
            raise ValueError("fix: expected predict(time_s) before, found no time")
        measured = fix_measurement(self.model, self.target, position, cov)
        seen = Outlying(self.time_s, self.time_s, measured.z, measured.R)
        nis, before = measured.nis(self.mixture), self._outlying.pop("fix", None)
        if nis <= self.settings.gate or (before is not None and confirmed(before, seen, self.settings)):
            self.mixture.update_linear(measured.z, measured.H, measured.R)
        else:
            self._outlying["fix"] = seen
            self.rejected["fix"] += 1
        return self._estimate(self.time_s, 0, nis)

    def _gated(self, time_s: float, marks: Sequence[MarkMeasurement], *, starting: bool) -> Gated:
        frame = Frame(time_s, self._before_s, self.settings, self.n_calibration > 0)
        if starting:
            gated = gate_start(marks, self._expected_at_start, self._outlying, frame=frame, n_marked=len(self._marked))
            self.model_error.start(gated)
        else:
            gated = gate_marks(marks, self.expected, self.expected_after_impulse, self._outlying, frame=frame)
        self._outlying = gated.outlying
        self.rejected.update(gated.rejected)
        return gated

    def _start(self, time_s: float, marks: Sequence[MarkMeasurement], stacked: StackedMarks) -> None:
        """Start from the first marks, or again from those after a loss."""
        self.repairs["restarted"] += int(self.health.since_s is not None)
        restart_from_marks(self.mixture, self.model, self.settings, marks, stacked=stacked)
        self._seen_s = dict.fromkeys(self._marked, time_s)
        self.health = after_frame(self.health, time_s, 0.0, 0, self.settings)

    def _refuted(self, time_s: float, marks: Sequence[MarkMeasurement], stacked: StackedMarks) -> None:
        """Give up the belief that marks refuted; see `after_divergence`."""
        again = time_s - self._refuted_s <= self.settings.lost_s
        linear, self._refuted_s = self.mixture.move.linear is not None, time_s
        self.repairs["restarted" if again or linear else "inflated"] += 1
        own = self.mixture, self.model, self.settings
        after_divergence(own, marks, stacked, linear=linear, again=again, start_cov=self._start_cov)

    def place_of(self, point: TargetMap) -> tuple[Floats, Floats]:
        """Mean [m], (dim,), and covariance [m²], (dim, dim), of a point of the tissue, as the target's are reported."""
        return reported_place(self.mixture, point, self.model_error)

    def _estimate(self, time_s: float, marks_used: int, nis: float | None, place: Place = None) -> TargetEstimate:
        mean, cov = place or self.place_of(self.target)
        tissue_m2, open_loop_m2 = self.target.tissue_m2(cov, self.mixture.P), float(np.trace(self.open_loop.target_cov))
        unseen_s = np.inf if self.seen_s is None else time_s - self.seen_s
        return TargetEstimate(
            time_s=time_s,
            mean=mean,
            cov=cov,
            status=self.model_error.status(self.health.status, self.target),
            marks_used=marks_used,
            nis=nis,
            poked=self.settings.poked_share(self.mixture.mu),
            model_only=unseen_s > self.settings.lost_s or tissue_m2 > self._model_only_m2,
            gain=None if open_loop_m2 <= 0.0 else 1.0 - tissue_m2 / open_loop_m2,
        )
