"""Linearised motion of stiff or large tissues: implicit steps for means, transition matrices for covariances.

Sigma points of a network with stiff springs would leave the shapes that the springs allow, and their number grows with
the state. About a state the motion is x(t + dt) = end + F (x - about) + noise instead.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dynamics import DRIVEN, SAME_STEP, ImplicitStepper
from estimators.arrays import Floats
from estimators.filters.motion import LinearMotion
from estimators.process.kernels import with_pokes
from estimators.process.known_force import KnownForce
from estimators.process.process_model import LONGEST_STEP, ForceMode, TissueModel

SUBSTEPS = 2
"""Steps between two additions of noise that stability may ask for; choice, its gain in docs/decisions.md."""

GRAVITY = 9.81
"""By which the weight of a body is judged, in whatever direction it hangs [m/s²]."""

MANY_STATES = 48
"""From so many states of the network on, matrices in place of sigma points, whose cost grows faster."""

VERY_MANY_STATES = 96
"""From so many on all modes are linearised about one state, half way through a cycle: time counts."""

TURNED = 0.1
"""By so many of the links' lengths may an update move the ends of so large a body without another pass [1]; choice."""

TURN = 0.3
"""By so much a link may turn in a step [rad]; choice: motion is linearised about the middle of a step."""

MOST_STEPS = 2
"""So many times the steps that `LONGEST_STEP` asks for are made at most; choice: it bounds the time of a frame."""

PASSES = 3
"""How often a cycle is linearised at most; numerical: once leaves a cable shaken at 3 m/s 92 mm off, three times 15,
five times 19."""


def is_linearised(model: TissueModel) -> bool:
    """Whether a network is moved so: it has many states, or stability would much shorten the steps."""
    stiff = model.stiff or model.stepper.max_step_s < LONGEST_STEP / SUBSTEPS
    return stiff or model.network.n_state > MANY_STATES


class LinearisedTissue:
    """Motion of a `TissueModel` to first order, of means of several modes at once.

    A node that is known to be led is moved by the forces of its hand alone: neither the tissue nor weight act on it.
    passes: how often an update may linearise a cycle
    """

    def __init__(self, model: TissueModel) -> None:
        self.model = model
        self._once = model.network.n_state > VERY_MANY_STATES
        self.stepper = ImplicitStepper(model.network)
        self.passes = PASSES
        self._led = np.unique(model.network.free[model.led_rows // model.network.dim]).tolist()
        # factors on a hand's forces on the free coordinates [1], against the mass of a driven node
        self._by_hand = np.ones(model.network.n_state // 2)
        self._by_hand[model.led_rows] = DRIVEN
        half = model.network.n_state // 2
        self._straight = np.zeros(model.dim_x)
        if self._once:
            self._straight[:half], self._straight[half:] = TURNED * np.median(model.network.rest_lengths), np.inf

    def __call__(
        self, about: Floats, dt: float, modes: Sequence[ForceMode], push: KnownForce | None, level: float = 1.0
    ) -> LinearMotion:
        """From states about these means (n_modes, dim_x), dt [s] later, under the forces of these modes and a push.

        level: factor on the variances of the modes' white noise [1]
        """
        n_steps = 1 if self._once else self._n_steps(about, dt)
        h = dt / n_steps
        F, Q, shifts, white, now = self._step(about, h, modes, push, level)
        for _ in range(n_steps - 1):
            own, noise, shift, root, now = self._step(now, h, modes, push, level)
            F, Q, shifts = own @ F, own @ Q @ own.swapaxes(1, 2) + noise, own @ shifts + shift
            white = np.concatenate((own @ white, root), axis=2)
        return LinearMotion(now, F, Q, shifts, white, self.model.network.n_state, self._straight)

    def _n_steps(self, about: Floats, dt: float) -> int:
        """Steps in dt [s] from these states: none longer than `LONGEST_STEP`, in none does a link turn by `TURN`."""
        network, k, half = self.model.network, len(about), self.model.network.n_state // 2
        velocities = np.zeros((k, len(network.names), network.dim))
        velocities[:, network.free] = about[:, half : 2 * half].reshape(k, -1, network.dim)
        i, j = network.springs.T
        rates = np.linalg.norm(velocities[:, j] - velocities[:, i], axis=2) / network.rest_lengths
        by_time = dt / LONGEST_STEP * (1.0 - SAME_STEP)
        return max(1, int(np.ceil(max(by_time, min(dt * float(rates.max(initial=0.0)) / TURN, MOST_STEPS * by_time)))))

    def noise_after(self, state: Floats, mode: ForceMode, seconds: float) -> Floats:
        """Covariance (dim_x, dim_x) that so many seconds of this mode's forces make about a state, from none."""
        doublings = max(0, int(np.ceil(np.log2(seconds / LONGEST_STEP))))
        F, Q, *_ = (each[0] for each in self._step(state[None], seconds / 2**doublings, (mode,), None, 1.0))
        for _ in range(doublings):
            Q, F = F @ Q @ F.T + Q, F @ F
        return np.asarray(0.5 * (Q + Q.T))

    def _step(
        self, now: Floats, h: float, modes: Sequence[ForceMode], push: KnownForce | None, level: float
    ) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        """Transition matrices, noise, what the columns' constants do, a root of white noise, the means at the end."""
        model, k, n = self.model, len(now), self.model.network.n_state
        rows, (white, sd, lasting) = model.poked_rows, model.noise_of(modes)
        fade = np.exp(-h / lasting)
        shares = (1.0 - fade) * lasting / h
        pokes = shares * now[:, model.pokes]
        outside = np.zeros((k, n // 2))
        outside[:, rows] = pokes * self._by_hand[rows]
        if push is not None:
            push.step(h)
            outside = outside + push.forces(now[:, None, :n]).reshape(-1, n // 2)
        ends = np.empty_like(now)
        # about the middle: from its start to its end a link turns, and with it the direction in which it is stiff
        half_way = self.stepper.advance(now[:, :n], 0.5 * h, outside, driven=self._led)
        ends[:, :n] = self.stepper.advance(half_way, 0.5 * h, outside, driven=self._led)
        about = half_way.mean(axis=0, keepdims=True) if self._once else half_way
        tangent = self.stepper.linearised(about, h, driven=self._led)
        by_hand = tangent.by_force * self._by_hand
        ends[:, model.pokes] = fade * now[:, model.pokes]
        left, added = model.slow_step(h)
        ends[:, model.slow] = left * now[:, model.slow]
        same = np.array([modes.index(mode) if self._once else j for j, mode in enumerate(modes)])
        force = np.sqrt(level / h) * model.mass * white
        own, Q = with_pokes(
            tangent.F,
            by_hand,
            same,
            (rows, shares, fade),
            (force, sd * model.mass[rows] * np.sqrt(1.0 - fade**2)),
            (left, added),
        )
        shift = np.zeros((k, model.dim_x, model.n_columns))
        if model.n_constants:
            forces = 0.5 * (model.constant_forces(now) + model.constant_forces(ends))
            shift[:, :n, : model.n_constants] = tangent.by_force @ forces.swapaxes(1, 2)
        root = np.zeros((k, model.dim_x, n // 2))
        root[:, :n] = by_hand * force[:, None]
        return own, Q, shift, root, ends
