"""Breathing lungs of known motion, in the files of real ones."""

from pathlib import Path

import numpy as np


def landmarks(seed: int, n: int = 20, n_phases: int = 4) -> np.ndarray:
    """Two boxes of landmarks 150 mm apart that shrink along z phase by phase [mm], (n_phases, 2 n, 3)."""
    rng = np.random.default_rng(seed)
    start = rng.uniform(0.0, 80.0, (2 * n, 3))
    start[n:, 0] += 150.0
    shrunk = [start * [1.0, 1.0, 1.0 - 0.03 * phase] for phase in range(n_phases)]
    return np.round(shrunk, 4)


def write_case(path: Path, places: np.ndarray) -> None:
    """A table of landmarks [mm], (n_phases, n, 3), as the study reads it."""
    lines = ["landmark,phase,x_mm,y_mm,z_mm"]
    for phase, frame in enumerate(places):
        lines += [f"{k},{phase},{x:.4f},{y:.4f},{z:.4f}" for k, (x, y, z) in enumerate(frame)]
    path.write_text("\n".join(lines) + "\n")
