"""A simulated camera in front of the simulated phantom; the phantom's motion is computed in real time."""

from __future__ import annotations

import time
from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

import vision
from dynamics import integrate_adaptive, pack, unpack
from experiments.formats.scenario import Scenario
from experiments.formats.scene.scene import with_step
from experiments.simulation.film import draw, hues_of
from experiments.simulation.forces import start_and_forces
from experiments.simulation.simulate import scene_of
from experiments.version import version

BEHIND_S = 1.0
"""Largest delay for which the camera skips frames [s]; choice: computing the motion of 1 s takes 0.4 s."""

RTOL, ATOL, STEP_S = 1e-3, 1e-5, 1.0 / 120.0
"""Relative tolerance [1], absolute tolerance [m, m/s] and longest step [s] of the integrator; choice: errors are
0.003 mm. The slope of the tremor force changes every STEP_S. With tighter tolerances the integrator rejects steps
across these changes, and takes ten times as long."""

COMES_AGAIN_S = 360.0
"""Period of the random forces [s]; choice: forces for an hour would delay the first picture by 0.3 s."""


class PhantomCamera:
    """A camera in front of the phantom, with the interface of cv2.VideoCapture.

    The phantom moves under random forces. A picture is drawn when it is grabbed.
    time_s: time from the start of the motion to the last picture [s]
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.scenario = scenario
        self.scene = with_step(scene_of(scenario), "simulate", version())
        self._rng = np.random.default_rng(scenario.seed)
        lasting = scenario.model_copy(update={"duration_s": COMES_AGAIN_S})
        start, self._forces = start_and_forces(self.scene.network, lasting, self._rng)
        self._state = pack(start, np.zeros_like(start))
        self._strays = vision.distractors(
            scenario.distractors, self.scene.cameras[0].size_px, self._rng, hues_of(self.scene)
        )
        self._lighting = vision.Lighting()
        self._clock, self._sleep = clock, sleep
        self._began_s = clock()
        self.time_s = 0.0

    def isOpened(self) -> bool:  # noqa: N802 - OpenCV's name
        """Always true."""
        return True

    @property
    def positions(self) -> NDArray[np.float64]:
        """Positions of all nodes in the last grabbed frame [m], shape (n_nodes, dim)."""
        network = self.scene.network
        positions = network.positions.copy()
        positions[network.free] = unpack(self._state, network.dim)[0]
        return positions

    def grab(self) -> bool:
        """Draw the next frame, then wait until its exposure time.

        If drawing takes longer than a frame interval, frames are skipped. After a delay of more than BEHIND_S no frame
        is skipped, and all later exposure times move by this delay.
        """
        interval = self.scenario.frame_interval_s
        due = self.time_s + interval
        late = self._clock() - self._began_s - due
        if late > BEHIND_S:
            self._began_s += late
        elif late > 0:
            due += interval * np.floor(late / interval)
        self._move(due)
        self._image = draw(self.scene, self.positions, self._lighting, self._rng, strays=self._strays)
        early = self._began_s + due - self._clock()
        if early > 0:
            self._sleep(early)
        return True

    def retrieve(self) -> tuple[bool, NDArray[np.uint8]]:
        """The picture that `grab` drew."""
        return True, self._image

    def get(self, prop: int) -> float:
        """For CAP_PROP_POS_MSEC, the exposure time of the last picture on the camera's clock [ms]; otherwise 0."""
        return 1e3 * (self._began_s + self.time_s) if prop == cv2.CAP_PROP_POS_MSEC else 0.0

    def _move(self, due: float) -> None:
        nothing = np.zeros((len(self.scene.network.free), self.scene.network.dim))
        self._state = integrate_adaptive(
            self.scene.network,
            self._state,
            [self.time_s, due],
            force=lambda t: sum((force(t % COMES_AGAIN_S) for force in self._forces), nothing),
            method="RK45",  # steps end at the tremor's knots, so that a method of higher order is not faster
            rtol=RTOL,
            atol=ATOL,
            max_step_s=STEP_S,
        )[-1]
        self.time_s = due

    def release(self) -> None:
        """Nothing to release."""
