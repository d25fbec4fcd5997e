"""Settings of the association of marks over time."""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial, log


@dataclass(frozen=True, slots=True)
class IdentitySettings:
    """Settings of the association: when other names of interchangeable marks are followed and adopted.

    If a mark is refused, filters restart with other names, at intervals of at least twice `FilterSettings.test_s`.

    decisive: log odds at which names are ruled out or adopted [1]; choice
    exchange: prior log odds against one exchange of two names [1]; choice
    longest_s: longest time that undecided names are followed, and longest pause between failed restarts [s]; choice
    max_hypotheses: largest number of alternatives [1]; source: 3! - 1, all for three interchangeable marks
    """

    decisive: float = log(1e3)
    exchange: float = log(1e2)
    longest_s: float = 5.0
    max_hypotheses: int = factorial(3) - 1
