"""Recordings: folders with a scene, pictures or marks, exposure times and, if known, true positions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from experiments.arrays import Floats
from experiments.errors import InputError, no_node, shown
from experiments.formats.films.pictures import (
    MARKS,
    ONE_CAMERA,
    SEGMENTS,
    Pictures,
    check_pictures,
    open_pictures,
    source_in,
)
from experiments.formats.films.several import CameraFilm, films_in, merged, read_films
from experiments.formats.marks.drawing import first_marks_line
from experiments.formats.marks.rows import (
    AXES,
    MarkRow,
    are_definite,
    check_limits,
    cov_columns,
    cov_entries_mm2,
    cov_names,
    cov_of,
    without_repeats,
)
from experiments.formats.marks.times import check_seconds, check_within
from experiments.formats.scene.scene import Scene, usable_scene
from experiments.formats.tables import Table, read_rows, read_table, write_table
from experiments.log import LOG
from vision import FilePath

SAME_TIME_S = 1e-9
"""Largest difference of times that count as equal [s]: the resolution of files."""


@dataclass(frozen=True, slots=True, eq=False)
class Fix:
    """A direct measurement of the target at a time [s]: position [m], (dim,), and standard deviation per axis [m]."""

    time_s: float
    position_m: Floats
    sd_m: float

    @property
    def cov(self) -> Floats:
        """Covariance of the fix [m²], (dim, dim)."""
        return self.sd_m**2 * np.eye(len(self.position_m))


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """True positions of nodes. Filters do not use them.

    times_s: for each node, increasing times [s], (n,)
    positions: for each node, its positions at these times [m], (n, dim)
    """

    times_s: dict[str, Floats]
    positions: dict[str, Floats]

    @property
    def nodes(self) -> tuple[str, ...]:
        """Nodes whose true positions are known."""
        return tuple(self.times_s)

    def at(self, times_s: Floats, node: str) -> tuple[NDArray[np.bool_], Floats]:
        """Whether the node's position is known at each of the times [s], (n,), and the positions [m], (n, dim).

        Positions are interpolated linearly. At times outside the node's `times_s`, positions are NaN.
        KeyError for a node that is not in `nodes`.
        """
        own_s, own = self.times_s[node], self.positions[node]
        times = np.asarray(times_s, dtype=float)
        inside = (times >= own_s[0]) & (times <= own_s[-1])
        positions = np.stack([np.interp(times, own_s, own[:, a]) for a in range(own.shape[1])], axis=1)
        positions[~inside] = np.nan
        return inside, positions


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """A recording: a scene, and either pictures or marks with their times. `read_recording` checks it.

    folder: path of the recording
    exposures_s: exposure times of the frames, increasing [s], (n_frames,)
    source: the video file, the folder of pictures or of a film's pieces; None for recordings with `marks` or `films`
    films: films of cameras in space; in such a recording, exposures_s are the exposure times of all cameras
    marks: for each frame the marks of another tracker; None for a recording of pictures
    truth: true positions of nodes, if known
    fixes: direct measurements of the target, in order of time
    aside: message if the first marks seem to have axes or units that differ from the scene's; otherwise None
    """

    folder: Path
    scene: Scene
    exposures_s: Floats
    source: Path | None
    marks: tuple[tuple[MarkRow, ...], ...] | None
    truth: Truth | None
    fixes: tuple[Fix, ...]
    aside: str | None = None
    films: tuple[CameraFilm, ...] = ()

    def open_frames(self) -> Pictures:
        """Open the frames; raises InputError if there are none, or if they cannot be opened."""
        if self.source is None:
            found = "films of cameras in space" if self.films else f"{MARKS}, which has no frames to show"
            raise InputError.at(self.folder, "a video or frames", found)
        return open_pictures(self.source, self.exposures_s.tolist())

    def open_films(self) -> dict[str, Pictures]:
        """Frames by the camera's name. Without `films` there is one entry with the name "". Raises InputError."""
        return {film.camera: film.open_frames() for film in self.films} or {"": self.open_frames()}


def read_recording(
    folder: FilePath, scene_path: FilePath | None = None, advance: Callable[[float], None] = lambda _share: None
) -> Recording:
    """Read the recording in a folder; raises InputError.

    scene_path: file of a scene that replaces the scene in the folder
    advance: called with the completed share
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError.at(folder, "the folder of a recording", "a file" if folder.exists() else "none")
    named = films_in(folder)
    source = folder if named else source_in(folder)
    scene_path = folder / "scene.toml" if scene_path is None else Path(scene_path)
    scene = usable_scene(scene_path, rests=False)
    frames_csv = folder / "frames.csv"
    marks: tuple[tuple[MarkRow, ...], ...] | None = None
    films: tuple[CameraFilm, ...] = ()
    if named:
        films = read_films(folder, scene, scene_path, read_frames, advance)
        exposures_s = merged(films)[0]
    elif source.name == MARKS:
        exposures_s, marks = read_marks(source, scene, read_frames(frames_csv) if frames_csv.exists() else None)
    else:
        if len(scene.cameras) != 1:
            raise InputError.at(f"{scene_path}: camera", f"one for {source.name} ({ONE_CAMERA})", scene.n_cameras)
        exposures_s = read_frames(frames_csv, torn=source.name == SEGMENTS)
    truth_csv, fixes_csv = folder / "truth.csv", folder / "fixes.csv"
    recording = Recording(
        folder=folder,
        scene=scene,
        exposures_s=exposures_s,
        source=None if marks is not None or films else source,
        marks=marks,
        truth=_read_truth(truth_csv, scene, exposures_s) if truth_csv.exists() else None,
        fixes=_read_fixes(fixes_csv, scene, exposures_s) if fixes_csv.exists() else (),
        aside=None if marks is None else first_marks_line(scene, marks),
        films=films,
    )
    if recording.source is not None:
        size_px = scene.cameras[0].size_px
        check_pictures(source, exposures_s, frames_csv, size_px, f"{scene_path}: camera[0].size_px", advance)
    advance(1.0)
    if recording.aside is not None:
        LOG.warning("%s: %s", source, recording.aside)
    for event in () if marks is None else without_repeats(exposures_s, marks)[1]:
        LOG.warning("%s: %.2f s: %s: %s", source, event.time_s, event.kind, event.text)
    LOG.info(
        "read %s: %d frames of %s, scene %s, truth of %s, %d fixes",
        folder,
        len(exposures_s),
        ", ".join(film.source.name for film in films) or source.name,
        scene_path,
        "nothing" if recording.truth is None else ", ".join(recording.truth.nodes),
        len(recording.fixes),
    )
    return recording


def read_frames(path: Path, *, torn: bool = False) -> Floats:
    """Exposure times in frames.csv [s], (n_frames,); raises InputError. If `torn`, omits an incomplete last line."""
    table = read_table(path, ["frame", "exposure_s"], rejected={"camera": ONE_CAMERA}, torn=torn)
    if not table.n_rows:
        raise InputError.at(path, "a row for each frame", "none")
    table.check_each("frame", np.arange(table.n_rows, dtype=float))
    table.check_order("exposure_s", strictly=True)
    check_seconds(table, "exposure_s")
    return table.numbers["exposure_s"]


def read_marks(path: Path, scene: Scene, exposures_s: Floats | None) -> tuple[Floats, tuple[tuple[MarkRow, ...], ...]]:
    """Exposure times of the frames [s], and each frame's marks. If exposures_s is None, the file states the times."""
    spread = _spread_columns(path, scene.network.dim)
    table = _read_places(path, scene, ["time_s", *spread], ["node"])
    names = tuple(dict.fromkeys((*scene.network.names, *scene.mark_names)))
    nodes = _indices(table, names)
    marked = [names.index(name) for name in scene.mark_names]
    table.check("node", np.isin(nodes, marked), "a node with a mark in the scene")
    table.check_order("time_s", strictly=False)
    times_s = table.numbers["time_s"]
    if exposures_s is None:
        if not table.n_rows:
            raise InputError.at(path, "a row for each mark", "none, and no frames.csv")
        check_seconds(table, "time_s")
        exposures_s, frames = np.unique(times_s, return_inverse=True)
    else:
        frames, off_s = nearest_frames(times_s, exposures_s)
        table.check("time_s", off_s <= SAME_TIME_S, "an exposure time of frames.csv")
    _, first = np.unique(frames * len(names) + nodes, return_index=True)
    table.check("node", np.isin(np.arange(table.n_rows), first), "each node once at one time")
    rows = _mark_rows(table, scene, spread)
    starts = np.searchsorted(frames, np.arange(len(exposures_s) + 1)).tolist()
    return exposures_s, tuple(tuple(rows[a:b]) for a, b in pairwise(starts))


def read_points(path: Path, scene: Scene) -> tuple[Floats, list[MarkRow]]:
    """Times [s], (n,), and marks of a table like marks.csv. The table may have nodes without a mark in the scene."""
    spread = _spread_columns(path, scene.network.dim)
    table = _read_places(path, scene, ["time_s", *spread], ["node"])
    if unknown := sorted({*table.texts["node"]} - {*scene.network.names, *scene.mark_names}):
        raise InputError.at(f"{path}: node", "nodes or reference marks of the scene", ", ".join(map(shown, unknown)))
    return table.numbers["time_s"], _mark_rows(table, scene, spread)


def nearest_frames(times_s: Floats, exposures_s: Floats) -> tuple[NDArray[np.int64], Floats]:
    """Index of the frame nearest to each time, (n,), and the difference of their times [s], (n,)."""
    after = np.clip(np.searchsorted(exposures_s, times_s), 1, max(1, len(exposures_s) - 1))
    near = np.stack([after - 1, np.minimum(after, len(exposures_s) - 1)])
    off_s = np.abs(exposures_s[near] - times_s)
    return np.where(off_s[0] <= off_s[1], near[0], near[1]), off_s.min(axis=0)


def _spread_columns(path: Path, dim: int) -> list[str]:
    """Columns of a table that state the accuracy of its marks: sd_mm, or the columns of a full covariance."""
    named = next(read_rows(path, f"columns {', '.join(['time_s', 'sd_mm', *AXES[:dim], 'node'])}"))
    return cov_columns(dim) if any(column.startswith("cov_") for column in named) else ["sd_mm"]


def _mark_rows(table: Table, scene: Scene, spread: list[str]) -> list[MarkRow]:
    nodes, positions = table.texts["node"], _positions(table, scene)
    if spread == ["sd_mm"]:
        sds = (1e-3 * table.numbers["sd_mm"]).tolist()
        return [MarkRow(*row) for row in zip(nodes, positions, sds, strict=True)]
    entries = np.stack([table.numbers[column] for column in spread], axis=1)
    covs = cov_of(entries, scene.network.dim)
    if not (good := are_definite(covs)).all():
        row = int(np.argmin(good))
        expected = f"a positive definite covariance ({', '.join(cov_names(scene.network.dim))})"
        raise InputError.at(table.place(row, "cov_mm2"), expected, ", ".join(f"{x:g}" for x in entries[row]))
    return [MarkRow.of_cov(*row) for row in zip(nodes, positions, covs, strict=True)]


def _read_truth(path: Path, scene: Scene, exposures_s: Floats) -> Truth:
    table = _read_places(path, scene, ["time_s"], ["node"])
    if not table.n_rows:
        raise InputError.at(path, "a row for each time and node", "none")
    nodes, times_s, positions = _indices(table, scene.network.names), table.numbers["time_s"], _positions(table, scene)
    table.check_order("time_s", strictly=True, groups=nodes)
    check_within(table, "time_s", exposures_s)
    rows = {scene.network.names[i]: np.flatnonzero(nodes == i) for i in np.unique(nodes)}
    return Truth(
        times_s={name: times_s[own] for name, own in rows.items()},
        positions={name: positions[own] for name, own in rows.items()},
    )


def _read_fixes(path: Path, scene: Scene, exposures_s: Floats) -> tuple[Fix, ...]:
    table = _read_places(path, scene, ["time_s", "sd_mm"], [])
    table.check_order("time_s", strictly=False)
    check_within(table, "time_s", exposures_s)
    times_s, sds = table.numbers["time_s"].tolist(), (1e-3 * table.numbers["sd_mm"]).tolist()
    return tuple(Fix(*row) for row in zip(times_s, _positions(table, scene), sds, strict=True))


def _read_places(path: Path, scene: Scene, numbers: list[str], texts: list[str]) -> Table:
    rejected = {"camera": ONE_CAMERA}
    if scene.network.dim == 2:
        rejected["z_mm"] = "expected no such column for a flat scene, found it"
    return check_limits(read_table(path, [*numbers, *AXES[: scene.network.dim]], texts, rejected=rejected))


def _indices(table: Table, names: Sequence[str]) -> NDArray[np.int64]:
    indices = {name: i for i, name in enumerate(names)}
    nodes = np.array([indices.get(name, -1) for name in table.texts["node"]], dtype=np.int64)
    if (nodes < 0).any():
        row = int(np.argmax(nodes < 0))
        raise InputError(f"{table.place(row, 'node')}: {no_node(table.texts['node'][row], names)}")
    return nodes


def _positions(table: Table, scene: Scene) -> Floats:
    return 1e-3 * np.stack([table.numbers[axis] for axis in AXES[: scene.network.dim]], axis=1)


def write_frames_csv(path: Path, exposures_s: Floats) -> None:
    """Write frames.csv. Raises InputError, or ValueError if a time is not at least 1 ns after the one before."""
    _check_times(exposures_s)
    write_table(path, ["frame", "exposure_s"], ([str(k), f"{t:.9f}"] for k, t in enumerate(exposures_s)))


def write_truth_csv(path: Path, times_s: Floats, positions_by_node: Mapping[str, Floats]) -> None:
    """Write truth.csv: positions by node [m], (n, dim), at these times [s], (n,). Raises InputError or ValueError."""
    _check_times(times_s)
    nodes = list(positions_by_node)
    positions = np.stack([positions_by_node[node] for node in nodes], axis=1)
    if len(positions) != len(times_s) or not np.isfinite(positions).all():
        raise ValueError(f"truth: expected finite positions at {len(times_s)} times, found {positions.shape} of them")
    write_table(
        path,
        ["time_s", "node", *AXES[: positions.shape[2]]],
        ([f"{t:.9f}", node, *_mm(positions[k, i])] for k, t in enumerate(times_s) for i, node in enumerate(nodes)),
    )


def write_marks_csv(path: Path, times_s: Floats, marks: Sequence[Sequence[MarkRow]], *, dim: int) -> None:
    """Write marks.csv: the marks at each of the times [s], (n,). Raises InputError, or ValueError for invalid marks."""
    _check_times(times_s)
    rows = [(t, row) for t, found in zip(times_s, marks, strict=True) for row in found]
    for _, row in rows:
        if len(row.position_m) != dim or not np.isfinite([*row.position_m, row.sd_m]).all() or row.sd_m <= 0:
            raise ValueError(f"marks: expected {dim} finite coordinates and a deviation above 0, found {row}")
    covs = any(row.full_cov is not None for _, row in rows)
    header = ["time_s", "node", *AXES[:dim], *(cov_columns(dim) if covs else ["sd_mm"])]
    spreads = (cov_entries_mm2(row.cov) if covs else [1e3 * row.sd_m] for _, row in rows)
    write_table(
        path,
        header,
        (
            [f"{t:.9f}", r.node, *_mm(r.position_m), *(f"{x:.9g}" for x in spread)]
            for (t, r), spread in zip(rows, spreads, strict=True)
        ),
    )


def _mm(position_m: Floats) -> list[str]:
    return [f"{1e3 * x:.4f}" for x in position_m]


def _check_times(times_s: Floats) -> None:
    times = np.asarray(times_s, dtype=float)
    if times.ndim != 1 or not np.isfinite(times).all() or not (np.diff(np.round(times, 9)) > 0).all():
        raise ValueError(f"times: expected finite ones that increase by 1 ns or more, found {times}")
