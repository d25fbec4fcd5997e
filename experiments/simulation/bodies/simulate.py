"""Motion of a MuJoCo model, frame by frame."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from experiments.arrays import Floats

Act = Callable[[float, Any], None]
"""A function of the time [s] and of MuJoCo's data. It sets forces or prescribed positions for the next step."""

Push = tuple[float, float, Floats]
"""Constant forces on bodies: their start [s], their end [s], and their values [N], (n_bodies, 3)."""

Range = tuple[float, float]
"""Smallest and largest value of a uniformly distributed time [s]."""


def compiled(xml: str) -> tuple[Any, Any]:
    """MuJoCo's model and data from XML. The data have the computed positions of the bodies."""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def motion(
    model: Any, data: Any, read: Callable[[Any], Floats], *, times_s: Floats, longest_s: float, act: Act | None = None
) -> Floats:
    """Simulate a motion from the present `data`, and return `read(data)` at each time, (n_frames, ...).

    times_s: equally spaced times [s], (n_frames,); longest_s: longest permitted integration step [s]
    """
    interval = float(times_s[1] - times_s[0])
    n_steps = int(np.ceil(interval / longest_s - 1e-9))
    model.opt.timestep = interval / n_steps
    seen = []
    for time_s in times_s:
        mujoco.mj_forward(model, data)  # a step does not update positions that follow from the joints
        seen.append(np.array(read(data)))
        for step in range(n_steps):
            if act is not None:
                act(float(time_s) + step * model.opt.timestep, data)
            mujoco.mj_step(model, data)
    return np.array(seen)


def settled(model: Any, data: Any, *, seconds: float, step_s: float, kept: float) -> None:
    """Let the model come to rest: after each step, its velocities are multiplied by the factor `kept`."""
    model.opt.timestep = step_s
    for _ in range(int(seconds / step_s)):
        mujoco.mj_step(model, data)
        data.qvel[:] *= kept
    data.qvel[:] = 0.0
    mujoco.mj_forward(model, data)


def pushes(
    rng: np.random.Generator, seconds: float, forces: Callable[[], Floats], *, first: Range, lasts: Range, pause: Range
) -> list[Push]:
    """Successive forces before the time `seconds`; first start, durations and pauses are random in these ranges [s]."""
    found, start = [], float(rng.uniform(*first))
    while start < seconds:
        end = start + float(rng.uniform(*lasts))
        found.append((start, end, forces()))
        start = end + float(rng.uniform(*pause))
    return found


def pushing(bodies: NDArray[np.int64], found: Sequence[Push]) -> Act:
    """A function that applies the forces `found` to the bodies of the model with the indices `bodies`."""

    def act(time_s: float, data: Any) -> None:
        data.xfrc_applied[:] = 0.0
        for start_s, end_s, forces in found:
            if start_s <= time_s < end_s:
                data.xfrc_applied[bodies, :3] += forces

    return act
