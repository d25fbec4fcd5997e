"""What a pass of the filter gives of made-up innovations."""

import numpy as np

from estimators.identification.filter_pass import Pass


def pass_of(y, slope=1.0, lost=0.0, share=1.0) -> Pass:
    """Of innovations of variance 1, (n,), one a frame, that fall by `slope` with the one constant.

    lost: taken off the log likelihood; share: of the information that is stated
    """
    n = len(y)
    information = np.array([[share * n * slope**2]])
    log_likelihood = -0.5 * float(y @ y) - lost
    return Pass(slope * y[:, None], information, log_likelihood, y**2, np.ones(n), np.zeros((1, 1)))
