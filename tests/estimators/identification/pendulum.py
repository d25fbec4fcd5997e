"""A double pendulum of rigid links by Lagrange's equations: truth of other physics than springs."""

import numpy as np
from scipy.integrate import solve_ivp

from tests.networks import build_network

LENGTHS = np.array([0.0917, 0.0693])
MASSES = np.array([0.030, 0.012])
GRAVITY = 9.81
SD = 5e-4


def hanging_links(factors=(1.0, 1.0), gravity=GRAVITY):
    """The pendulum as a network: links of 2,000 N/m, hanging, with rest lengths by these factors and this gravity."""
    depths = np.array([0.0, -LENGTHS[0], -LENGTHS.sum()])
    constants = {"masses": [1.0, *MASSES], "stiffness": 2000.0, "rest_lengths": LENGTHS * factors, "damping": 0.5}
    positions, names = np.column_stack([np.zeros(3), depths]), ("pin", "joint", "end")
    return build_network(positions, [(0, 1), (1, 2)], [0], names, gravity=[0.0, -gravity], **constants)


def swung(n_frames, frames_per_s=100.0):
    """Places of joint and end [m], (n_frames, 2, 2): [a, b] the links' angles from straight down, by DOP853.

    At first the joint is below the line from pin to end, where a mark holds the links.
    (m1 + m2) l1 a'' + m2 l2 (b'' cos d + b'^2 sin d) + (m1 + m2) g sin a = 0, d = a - b,
    l2 b'' + l1 (a'' cos d - a'^2 sin d) + g sin b = 0
    """
    (l1, l2), (m1, m2) = LENGTHS, MASSES

    def rate(_t, s):
        a, b, u, v = s
        c, d = np.cos(a - b), np.sin(a - b)
        matrix = [[(m1 + m2) * l1, m2 * l2 * c], [l1 * c, l2]]
        force = [-m2 * l2 * v * v * d - (m1 + m2) * GRAVITY * np.sin(a), l1 * u * u * d - GRAVITY * np.sin(b)]
        return [u, v, *np.linalg.solve(matrix, force)]

    times = np.arange(n_frames) / frames_per_s
    a, b, _, _ = solve_ivp(
        rate, (0.0, times[-1]), [0.6, 1.4, 1.0, 1.0], method="DOP853", t_eval=times, rtol=1e-10, atol=1e-12
    ).y
    joint = l1 * np.stack([np.sin(a), -np.cos(a)], axis=1)
    return times, np.stack([joint, joint + l2 * np.stack([np.sin(b), -np.cos(b)], axis=1)], axis=1)
