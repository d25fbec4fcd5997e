"""A needle (dimensions, part that has to hit, uncertainty of the tip) and its insertion (entry, axis, speed, depth)."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from estimators.arrays import Floats

STEEP = 0.5
"""Lower limit of the cosine by which `Insertion.tracked` divides, which is the cosine of 60 degrees; choice."""


class Hit(StrEnum):
    """Part of the needle that has to lie in the lesion for a hit."""

    TIP = "TIP"
    """The needle's tip."""
    NOTCH = "NOTCH"
    """The middle of the notch."""
    CORE = "CORE"
    """At least the length core_m of the notch. The tissue core then contains this length of the lesion."""


@dataclass(frozen=True, slots=True)
class Needle:
    """A side-notch core needle.

    hit: part of the needle that has to lie in the lesion; source: needle.toml
    notch_offset_m: distance from the tip back to the notch [m]; source: a biopsy gun takes no sample from the first
        5 mm behind its tip, [skiparea]
    notch_length_m: length of the notch [m]; source: 20 mm, for a common biopsy gun, [deflection]
    core_m: for `Hit.CORE`, length of the notch that the pathologist needs in the lesion [m]; source: needle.toml
    tip_sd_m: standard deviation of the tracked tip on each axis [m]; source: needle.toml, the tracker's accuracy
    bending_sd: standard deviation of the tip across the needle due to bending, divided by the depth [m/m]; source:
        0.9 mm at 45 mm, the mean deflection of a biopsy gun in a phantom, [deflection]

    Needles bend more in patients, see `docs/guidance.md`.
    """

    hit: Hit = Hit.NOTCH
    notch_offset_m: float = 5e-3
    notch_length_m: float = 20e-3
    core_m: float = 5e-3
    tip_sd_m: float = 0.5e-3
    bending_sd: float = 0.02

    def __post_init__(self) -> None:
        if self.hit not in list(Hit):
            raise ValueError(f"needle hit: expected {', '.join(Hit)}, found {self.hit}")
        object.__setattr__(self, "hit", Hit(self.hit))
        for name in ("notch_offset_m", "tip_sd_m", "bending_sd"):
            if not 0.0 <= getattr(self, name) < np.inf:
                raise ValueError(f"needle {name}: expected 0 or more, found {getattr(self, name)}")
        for name in ("notch_length_m", "core_m"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise ValueError(f"needle {name}: expected more than 0, found {getattr(self, name)}")
        if self.hit is Hit.CORE and self.core_m > self.notch_length_m:
            raise ValueError(
                f"needle core_m: expected no more than notch_length_m ({self.notch_length_m}), found {self.core_m}"
            )

    @property
    def reach_m(self) -> float:
        """Distance from the tip back to the middle of the notch [m]; 0 if the tip has to hit."""
        return 0.0 if self.hit is Hit.TIP else self.notch_offset_m + 0.5 * self.notch_length_m

    @property
    def sampled(self) -> tuple[float, float]:
        """For `Hit.CORE`, notch_length_m and core_m [m]; otherwise 0 and 0, because a point has to hit."""
        return (self.notch_length_m, self.core_m) if self.hit is Hit.CORE else (0.0, 0.0)

    @property
    def spread(self) -> tuple[float, float]:
        """Variance of the tracked tip on each axis [m²]; variance due to bending, divided by the squared depth [1]."""
        return self.tip_sd_m**2, self.bending_sd**2

    def tip_cov(self, axis: Floats, depth_m: float) -> Floats:
        """Covariance of the tip [m²], (dim, dim), at a depth [m]; axis: unit vector along the needle, (dim,)."""
        every, across = self.spread
        dim = len(axis)
        return every * np.eye(dim) + across * depth_m**2 * (np.eye(dim) - np.outer(axis, axis))


@dataclass(frozen=True, slots=True, eq=False)
class Insertion:
    """Entry, direction, speed and present depth of a needle.

    entry: point where the needle enters the tissue [m], (dim,)
    axis: unit vector along the needle, (dim,); a vector of another length is normalised
    speed_m_s: speed of insertion [m/s]
    depth_m: present depth of the tip beyond the entry [m]; 0 before the insertion
    """

    entry: Floats
    axis: Floats
    speed_m_s: float
    depth_m: float = 0.0

    def __post_init__(self) -> None:
        entry, axis = np.array(self.entry, dtype=float), np.array(self.axis, dtype=float)
        size = float(np.linalg.norm(axis))
        if entry.shape not in ((2,), (3,)) or axis.shape != entry.shape:
            raise ValueError(f"insertion: expected entry and axis of length 2 or 3, found {entry.shape}, {axis.shape}")
        if not (np.isfinite(entry).all() and 0.0 < size < np.inf):
            raise ValueError(f"insertion: expected a finite entry and direction, found {entry} and {axis}")
        if not 0.0 < self.speed_m_s < np.inf:
            raise ValueError(f"insertion speed_m_s: expected more than 0, found {self.speed_m_s}")
        if not 0.0 <= self.depth_m < np.inf:
            raise ValueError(f"insertion depth_m: expected 0 or more, found {self.depth_m}")
        object.__setattr__(self, "entry", entry)
        object.__setattr__(self, "axis", axis / size)

    def tracked(self, tip: Floats, axis: Floats) -> Insertion:
        """The insertion of a needle whose tip and direction a tracker has measured.

        tip: measured position of the tip [m], (dim,); axis: measured direction, of any length, (dim,)
        The skin is the plane through this insertion's entry, perpendicular to this insertion's axis. If the tip is in
        front of the skin, the depth is 0. If the measured direction differs from this insertion's axis by more than 60
        degrees, the depth is computed as if the angle were 60 degrees. Raises ValueError for a direction without
        length.
        """
        length = float(np.linalg.norm(axis))
        if not 0.0 < length < np.inf:
            raise ValueError(f"insertion: expected a finite non-zero direction, found {axis}")
        along = np.array(axis, dtype=float) / length
        below_m = float((np.asarray(tip) - self.entry) @ self.axis)
        depth_m = max(below_m, 0.0) / max(float(along @ self.axis), STEEP)
        return Insertion(np.asarray(tip) - depth_m * along, along, self.speed_m_s, depth_m)
