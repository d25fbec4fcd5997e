"""Settings of the filter: assumptions about unknown forces, and thresholds of tests."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimators.process.process_model import FixBias, ForceMode


@dataclass(frozen=True, slots=True)
class FilterSettings:
    """Settings of the filter: assumptions about unknown forces, and thresholds of its tests.

    poked: strength and duration of pokes (brief forces on marked nodes); source: see `ForceMode`
    led_nodes: marked nodes that an external force, such as a gripper's, may drag at any time; source: the scene
    discrepancy: standard deviation of the model's error, relative to the body's extent [1]; source: the scene. If it is
        None, the filter estimates it
    sigma_points: whether the motion is linearised by sigma points instead of derivatives; source: the caller
    fix_bias: common error of all fixes (direct measurements) of the target, or None; source: the scene
    outlier_odds: prior odds that a mark is an outlier, whose position is uniform over the body's extent [1]; choice
    gate: squared Mahalanobis distance beyond which a fix is rejected [1]; source: chi-square, 2 dof, 99.999 %
    impulse_m_s: largest sudden change of a node's velocity [m/s]; choice
    impulse_s: time for which the node moves at impulse_m_s before the springs pull it back [s]; choice
    confirm_s: time from the first used marks until the filter is TRACKING [s]; choice
    lost_s: time without marks after which the target is LOST [s]; choice
    forget_s: time between two frames, at least lost_s, after which the state is reset [s]; choice
    test_s: time over which innovations are tested together for divergence [s]; choice
    test_sigmas: threshold of the test for divergence, in standard deviations of a normal variable [1]; choice
    model_only_share: an estimate is `model_only` if its variance exceeds this share of the variance before any mark
        [1]; choice
    """

    poked: ForceMode = ForceMode(white=0.043, poke=5.0, lasting_s=0.2)
    led_nodes: tuple[str, ...] = ()
    discrepancy: float | None = None
    sigma_points: bool = False
    fix_bias: FixBias | None = None
    outlier_odds: float = 1e-4
    gate: float = 23.03
    impulse_m_s: float = 1.0
    impulse_s: float = 0.05
    confirm_s: float = 0.1
    lost_s: float = 1.0
    forget_s: float = 5.0
    test_s: float = 0.25
    test_sigmas: float = 10.0
    model_only_share: float = 0.5

    def __post_init__(self) -> None:
        for name in ("outlier_odds", "gate", "test_sigmas", "model_only_share"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"settings {name}: expected more than 0, found {getattr(self, name)}")
        for name in ("impulse_m_s", "impulse_s", "confirm_s", "lost_s", "forget_s", "test_s"):
            if not getattr(self, name) >= 0.0:
                raise ValueError(f"settings {name}: expected 0 or more, found {getattr(self, name)}")
        if self.discrepancy is not None and not 0.0 <= self.discrepancy < np.inf:
            raise ValueError(f"settings discrepancy: expected 0 or more, found {self.discrepancy}")
        if isinstance(self.led_nodes, str):
            raise ValueError(f"settings led_nodes: expected a list of names, found the text {self.led_nodes!r}")
