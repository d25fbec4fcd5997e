"""System identification: constants of the tissue and noise levels, from recordings.

What may enter: what is estimated once from a recording and then fixed.
"""

from estimators.identification.constants import (
    IdentificationError,
    IdentificationResult,
    IdentificationSettings,
    identify_constants,
    principal_uncertainty,
)
from estimators.identification.noise_levels import TuningResult, tune_noise

__all__ = [
    "IdentificationError",
    "IdentificationResult",
    "IdentificationSettings",
    "TuningResult",
    "identify_constants",
    "principal_uncertainty",
    "tune_noise",
]
