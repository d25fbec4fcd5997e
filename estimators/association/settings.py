"""Settings of data association over time."""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial, log


@dataclass(frozen=True, slots=True)
class IdentitySettings:
    """When other names of interchangeable marks are followed, and when they are adopted.

    Other names are tried from a start when a mark is refused, and again no sooner than twice the filter's test_s later.

    decisive: log odds at which names are ruled out or adopted [1]; choice
    exchange: prior log odds against one exchange of two names [1]; choice
    longest_s: for this long undecided names are followed, and restarts are put off after vain ones [s]; choice
    max_hypotheses: number of alternatives at a time [1]; source: all for three interchangeable marks, 3! - 1
    """

    decisive: float = log(1e3)
    exchange: float = log(1e2)
    longest_s: float = 5.0
    max_hypotheses: int = factorial(3) - 1
