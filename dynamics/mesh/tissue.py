"""Constants of a kind of tissue."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Tissue:
    """Young's modulus [Pa], Poisson's ratio [1], density [kg/m³] and ratio of damping to stiffness [s] of a tissue."""

    name: str
    young_pa: float
    poisson: float
    density_kg_m3: float
    damping_s: float

    def __post_init__(self) -> None:
        is_valid = {
            "young_pa": 0.0 < self.young_pa < float("inf"),
            "poisson": -1.0 < self.poisson < 0.5,
            "density_kg_m3": 0.0 < self.density_kg_m3 < float("inf"),
            "damping_s": 0.0 <= self.damping_s < float("inf"),
        }
        for key, valid in is_valid.items():
            if not valid:
                raise ValueError(
                    f"tissue {self.name} {key}: expected a possible constant, found {getattr(self, key):g}"
                )
