"""A needle straight down to a target that is healthily tracked 60 mm below its entry, in the plane."""

import numpy as np

from estimators import Hit, Insertion, Lesion, Needle, Status, TargetEstimate, TargetPath

NOW_S = 10.0
TIP = Needle(hit=Hit.TIP, tip_sd_m=0.3e-3, bending_sd=0.01)
DOWN = Insertion(np.array([0.0, 0.1]), np.array([0.0, -1.0]), speed_m_s=0.1)
DISC = Lesion.ball(4e-3, 2)
HEALTHY = TargetEstimate(NOW_S, np.array([0.0, 0.04]), 1e-6 * np.eye(2), Status.TRACKING, 3)


def path_of(where, sd=1e-3, seconds=4.0, step=1 / 30):
    """A path whose mean at each time since NOW_S is where(t), (k, dim), and whose sd an axis [m] is one number."""
    t = step * np.arange(int(seconds / step) + 1)
    means = where(t)
    return TargetPath(NOW_S + t, means, np.tile(sd**2 * np.eye(means.shape[1]), (len(t), 1, 1)))


def at(x, y):
    """Where a target is that rests at this place [m], as `path_of` takes it."""
    return lambda t: np.tile([x, y], (len(t), 1)).astype(float)
