"""What the filter of the tissue assumes about forces that it cannot see, and where its tests stand."""

from __future__ import annotations

from dataclasses import dataclass

from estimators.process.process_model import FixBias, ForceMode


@dataclass(frozen=True, slots=True)
class FilterSettings:
    """What the filter assumes about forces that it cannot see, and where its tests stand.

    poked: forces of a poke; source: fields of `ForceMode`
    led_nodes: marked nodes that are led all the time, as fast as it may be; source: the scene
    discrepancy: standard deviation of what the model leaves out, by the body's extent; None: the marks choose it [1];
        source: the scene
    sigma_points: whether the motion is linearised by sigma points, the unscented way, in place of its tangent; source:
        the caller
    fix_bias: the error that fixes of the target have in common; None where none are to come; source: the scene
    outlier_odds: of a mark to be anywhere in the tissue's reach [1]; choice
    gate: squared Mahalanobis distance beyond which a fix is rejected [1]; source: chi-square, 2 dof, 99.999 %
    impulse_m_s: a node's velocity may change by this at once [m/s]; choice
    impulse_s: for so long, then the springs have it back; marks are expected that far away [s]; choice
    confirm_s: marks that began, or that lie beyond the gate, count after so long [s]; choice
    lost_s: without marks for longer the target is LOST [s]; choice
    forget_s: over more than this without marks, or than lost_s, the state is forgotten [s]; choice
    test_s: innovations of this time are tested together for divergence [s]; choice
    test_sigmas: standard deviations of a normal variable at which they have diverged [1]; choice
    model_only_share: share of the variance without marks above which the model alone speaks [1]; choice
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
