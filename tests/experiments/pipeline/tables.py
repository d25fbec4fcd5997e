"""Recordings of marks that a test makes up."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pandas as pd

from estimators import MarkMeasurement
from experiments.formats.scene.scene import Scene, write_scene

Seen = Iterable[tuple[str, np.ndarray]]
"""Nodes and where their marks are seen [m]."""


def write_recording(folder: Path, scene: Scene, frames: Iterable[tuple[float, Seen]], sd_mm: float) -> Path:
    """A folder with the scene and marks.csv of frames at these times [s], marks to this deviation; the folder."""
    folder.mkdir(exist_ok=True)
    write_scene(scene, folder / "scene.toml")
    axes = ["x_mm", "y_mm", "z_mm"][: scene.network.dim]
    rows = [(time_s, node, *(1e3 * place), sd_mm) for time_s, seen in frames for node, place in seen]
    table = pd.DataFrame(rows, columns=["time_s", "node", *axes, "sd_mm"])
    table.to_csv(folder / "marks.csv", index=False)
    return folder


def near(scene: Scene, nodes: Iterable[str], sd_m: float, rng: np.random.Generator) -> list[tuple[str, np.ndarray]]:
    """Marks where these nodes are drawn, with noise."""
    at = {node: scene.network.positions[scene.network.index(node)] for node in nodes}
    return [(node, place + rng.normal(0.0, sd_m, len(place))) for node, place in at.items()]


def measured(
    scene: Scene, nodes: Iterable[str], sd_m: float, positions: np.ndarray | None = None
) -> list[MarkMeasurement]:
    """Marks of these nodes, to this deviation, where they are among these positions of all nodes [m], or are drawn."""
    x = scene.network.positions if positions is None else positions
    return [MarkMeasurement(node, x[scene.network.index(node)], sd_m**2 * np.eye(x.shape[1])) for node in nodes]
