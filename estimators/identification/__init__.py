"""System identification: constants of the tissue and noise levels, from recordings.

What may enter: what is estimated once from a recording and then held.
"""

from estimators.identification.constants import IdentificationError, Identified, identify, principal
from estimators.identification.noise_levels import Tuned, tune

__all__ = [
    "IdentificationError",
    "Identified",
    "Tuned",
    "identify",
    "principal",
    "tune",
]
