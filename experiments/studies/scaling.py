"""Cost of an estimate for meshes of different sizes: breasts of 1,000 to 14,000 nodes with 40 marks.

A separate process measures each mesh; its figures are a row of the table.
prepare_s: time to prepare a mesh and compute the first estimate; cached_s: time if the network is already prepared
ms_per_estimate: median time of an estimate while the body bends; memory_mb: peak memory of the process

    python -m experiments.studies.scaling      # writes docs/images/scaling.png, and the table of docs/meshes.md
"""

from __future__ import annotations

import pickle
import resource
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
from matplotlib.figure import Figure

from dynamics import MassSpringNetwork
from dynamics.elements import continuum_network
from dynamics.phantoms import TISSUES, breast_mesh, breast_points
from estimators import MarkMeasurement, TissueFilter
from experiments.formats.outputs import write_whole
from experiments.formats.page import markdown_table, rewrite_page
from experiments.plots.style import COLUMN_MM, GREY, OURS, new_figure, saved, styled
from experiments.studies.bench_recording import FRAME_S, median_ms, seconds_of
from experiments.studies.grid import DOCS

CELLS = ((10, 7), (16, 10), (24, 15), (28, 16))
"""Numbers of cells of the meshes, across and in depth."""

N_MARKS, SD_M, N_FRAMES = 40, 5e-4, 60
BENT_M, BENT_HZ = 5e-3, 0.5
"""Largest displacement of a mark [m], and frequency of the body's bending [Hz]."""

CAMERA_MS = 1e3 / 60.0
"""Time between two frames of a fast camera [ms]."""

HEAD = ("nodes", "time per estimate [ms]", "preparation [s]", "memory [MB]")

Row = dict[str, float]


def scaling() -> list[Row]:
    """Figures of each mesh, see `row`. Each mesh is measured in a new process."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn"), max_tasks_per_child=1) as alone:
        return [alone.submit(row, *cells).result() for cells in CELLS]


def row(across: int, deep: int) -> Row:
    """Figures of a mesh; across, deep: its numbers of cells across and in depth."""
    mesh, fixed = breast_mesh(across, deep)
    points = breast_points(mesh, fixed, N_MARKS)
    began = time.perf_counter()
    network = continuum_network(mesh, TISSUES, fixed, points)
    tissue = _started(network)
    prepare_s = time.perf_counter() - began
    saved = pickle.dumps(network)
    per_mb = 2**20 if sys.platform == "darwin" else 2**10
    return {
        "nodes": len(mesh.nodes),
        "elements": len(mesh.elements),
        "marks": N_MARKS,
        "ms_per_estimate": median_ms([seconds_of(_frame(tissue, k)) for k in range(1, N_FRAMES)]),
        "prepare_s": prepare_s,
        "cached_s": seconds_of(lambda: _started(pickle.loads(saved))),
        "memory_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / per_mb,
    }


def _started(network: MassSpringNetwork) -> TissueFilter:
    """A filter that has estimated the first frame."""
    tissue = TissueFilter(network, "target", [name for name in network.names if name.startswith("M")])
    _frame(tissue, 0)()
    return tissue


def _frame(tissue: TissueFilter, k: int) -> Callable[[], None]:
    """Function that estimates the target in frame k."""
    network, rng = tissue.network, np.random.default_rng(k)
    shape = network.continuum.shapes[:, 0].reshape(-1, 3)  # type: ignore[union-attr]
    shift = BENT_M * np.sin(2.0 * np.pi * BENT_HZ * k * FRAME_S) / np.abs(shape).max() * shape
    marks = [
        MarkMeasurement(name, place + SD_M * rng.normal(size=3), SD_M**2 * np.eye(3))
        for name, place in zip(network.names, network.positions[network.free] + shift, strict=False)
        if name.startswith("M")
    ]

    def estimate() -> None:
        tissue.predict(k * FRAME_S)
        tissue.update(marks)

    return estimate


def table(rows: Sequence[Row]) -> str:
    """The table of docs/meshes.md as text."""
    cells = [
        (f"{one['nodes']:,}", f"{one['ms_per_estimate']:.0f}", f"{one['prepare_s']:.1f}", f"{one['memory_mb']:.0f}")
        for one in rows
    ]
    return markdown_table(HEAD, cells, left=())


@styled
def picture(rows: Sequence[Row]) -> Figure:
    """Plot of the time per estimate over the number of nodes."""
    figure = new_figure(COLUMN_MM, 45.0)
    ax = figure.subplots()
    nodes = [one["nodes"] for one in rows]
    ax.plot(nodes, [one["ms_per_estimate"] for one in rows], color=OURS, marker="o")
    ax.axhline(CAMERA_MS, color=GREY, linestyle="--")
    ax.annotate("60 frames/s", (0.0, CAMERA_MS), (2, 2), textcoords="offset points", color=GREY)
    ax.set(xlabel="nodes of the mesh", ylabel="time per estimate [ms]", xlim=(0.0, None), ylim=(0.0, 20.0))
    return figure


def main() -> None:
    """Measure; write the table and the picture."""
    rows = scaling()
    rewrite_page(DOCS / "meshes.md", {"scaling": table(rows)})
    write_whole(DOCS / "images" / "scaling.png", saved(picture(rows), "png"))


if __name__ == "__main__":
    main()
