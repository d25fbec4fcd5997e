"""Bodies that the tests of this folder share."""

from collections.abc import Sequence

import numpy as np

from dynamics import MassSpringNetwork
from dynamics import build_network as named_network
from estimators.core.protocols import Transition
from tests.networks import build_network


def cable(n: int, *, held: bool = True) -> MassSpringNetwork:
    """A chain of free nodes of 10 g along a line in space, 50 mm apart, after an anchor if it is held."""
    m = n + held
    positions = 0.05 * np.arange(m)[:, None] * [1.0, 0.0, 0.0]
    constants = {"masses": 0.01, "drag": 0.01, "stiffness": 200.0, "damping": 0.05, "gravity": [0.0, 0.0, -9.81]}
    springs, names = [(k, k + 1) for k in range(m - 1)], [f"n{k}" for k in range(m)]
    return build_network(positions, springs, range(held), names, **constants)


def two_masses(stiffness: float, gravity_m_s2: float = 0.0) -> MassSpringNetwork:
    """Masses x and y of 50 g on anchors a to d in space, springs of one stiffness [N/m]; gravity along -z."""
    places = 1e-3 * np.array([[0, 0, 0], [80, 0, 0], [40, 70, 0], [40, 30, -60], [40, 30, 30], [45, 25, -25]])
    return named_network(
        list("abcdxy"),
        places,
        [(a, b) for a in "abcd" for b in "xy"] + [("x", "y")],
        masses=0.05,
        stiffness=stiffness,
        damping=0.2 * np.sqrt(stiffness),
        fixed=list("abcd"),
        gravity=[0.0, 0.0, -gravity_m_s2],
    )


SPEED = np.array([[1.0, 0.5], [0.0, 1.0]])
"""Half a second of constant velocity."""
PUSHED = np.outer([0.125, 0.5], [0.125, 0.5])
"""Covariance of that motion by a constant acceleration of variance 1."""


class Point:
    """A point on a line with nearly constant velocity, its acceleration of these standard deviations by mode."""

    def __init__(self, sds: Sequence[float], rates: np.ndarray | None = None, bend: float = 0.0) -> None:
        self.sds, self.bend = np.array(sds), bend
        self.rates = np.zeros((len(sds),) * 2) if rates is None else rates
        self.parts = {"position": slice(0, 1), "velocity": slice(1, 2)}
        self.tolerance = np.array([1e-9, 1e-9]) if bend else np.full(2, np.inf)

    def prior(self, level: float) -> tuple[np.ndarray, np.ndarray]:
        return np.zeros(2), np.tile(np.diag([4.0, 1.0]), (len(self.sds), 1, 1))

    def variances(self, level: float) -> np.ndarray:
        return self.sds[:, None] ** 2

    def moved(self, state: np.ndarray, dt: float) -> np.ndarray:
        assert dt == 0.5
        return SPEED @ state + self.bend * np.array([0.0, np.sin(state[0])])

    def linearize(self, state: np.ndarray, dt: float, cov: object = None) -> Transition:
        matrix = SPEED.copy()
        matrix[1, 0] += self.bend * np.cos(state[0])
        return Transition(self.moved(state, dt), matrix, PUSHED[None])

    def fresh(self, dt: float) -> float:
        return 1.0


class Seen:
    """The position, or a function of it with its derivative, with this variance."""

    def __init__(self, value: float, variance: float, of=lambda x: x, slope=lambda x: 1.0) -> None:
        self.names, self.blocks = ("point",), (slice(0, 1),)
        self.value, self.cov, self.of, self.slope = np.array([value]), np.array([[variance]]), of, slope

    def linearize(self, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.array([self.of(state[0])]), np.array([[self.slope(state[0]), 0.0]])
