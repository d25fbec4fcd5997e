"""Settings of the association of marks over time."""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial, log


@dataclass(frozen=True, slots=True)
class IdentitySettings:
    """Settings of the association of interchangeable marks: when alternative names are tried and adopted.

    decisive: log odds from which one assignment of names is preferred to another [1]; choice
    exchange: prior log odds against an exchange of two names [1]; choice
    longest_s: longest time for which an undecided alternative is followed [s]. The pause between two restarts with
        other names has the same limit; choice
    max_hypotheses: largest number of alternatives [1]; source: number of other orders of three marks, 3! - 1
    """

    decisive: float = log(1e3)
    exchange: float = log(1e2)
    longest_s: float = 5.0
    max_hypotheses: int = factorial(3) - 1
