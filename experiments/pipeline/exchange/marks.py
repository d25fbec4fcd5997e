"""Marks from the table of a pose tracker: what `softaim import` does."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from experiments.arrays import Floats
from experiments.errors import InputError, placed, shown
from experiments.formats.exchange.pose_table import PoseTable, read_poses
from experiments.formats.marks.rows import FARTHEST_MM, FINEST_MM, MarkRow
from experiments.formats.recording import read_frames, write_frames_csv, write_marks_csv
from experiments.formats.scene.scene import Scene, read_scene, write_scene
from vision import PlaneCamera, fronto_parallel_camera


def plane_scale(mm_per_px: float, origin_px: tuple[float, float]) -> PlaneCamera:
    """A camera perpendicular to the plane, which only converts pixels to positions; origin_px: pixel of the origin."""
    first_m = (-1e-3 * mm_per_px * origin_px[0], 1e-3 * mm_per_px * origin_px[1])
    return fronto_parallel_camera("scale", (1, 1), (mm_per_px, mm_per_px), first_m)


@dataclass(frozen=True, slots=True, eq=False)
class Imported:
    """Marks of a table, by frame.

    exposures_s: times of all frames [s], (n_frames,); marks: marks of each frame
    unlikely, outside: numbers of positions omitted because of a low likelihood, or because they lie outside the picture
    manual: number of marks without a likelihood, which were set manually
    """

    scene: Scene
    exposures_s: Floats
    marks: tuple[tuple[MarkRow, ...], ...]
    unlikely: int
    outside: int
    manual: int

    def counts(self) -> dict[str, int]:
        """Number of frames with a mark of each node."""
        seen = Counter(mark.node for found in self.marks for mark in found)
        return {name: seen[name] for name in self.scene.mark_names}


def import_table(
    table: Path,
    scene_path: Path,
    times: float | Path,
    *,
    least: float = 0.6,
    sd_px: float = 1.0,
    renamed: Sequence[str] = (),
    scale: PlaneCamera | None = None,
    individual: str | None = None,
) -> Imported:
    """Read the marks of a table; raises InputError.

    times: frame rate [frames/s], or path of a frames.csv; individual: name of an animal, if the table has several
    least: least likelihood of a position that is used [1]; source: `pcutoff` of DeepLabCut. A position without a
    likelihood was set manually and is always used.
    sd_px: standard deviation on each axis [px]; choice: state the tracker's own error if it is known
    renamed: `PART=NODE` if the node of a part has another name than the part; `PART=` to omit a part
    scale: a camera perpendicular to the plane, used instead of the scene's camera
    """
    scene = read_scene(scene_path)
    if scene.network.dim != 2:
        raise InputError.at(scene_path, "a flat scene: one picture has no depth", "a network in space")
    if scale is None and len(scene.cameras) != 1:
        expected = "one, or --mm-per-px and --origin-px"
        raise InputError.at(f"{scene_path}: camera", expected, scene.n_cameras)
    poses = read_poses(table, individual)
    nodes = _nodes(poses, scene, renamed)
    exposures_s = _exposures_s(poses, times)
    taken = np.isfinite(poses.places_px).all(axis=2) & np.array([node is not None for node in nodes])
    likely = taken & ~(poses.likelihood < least)
    camera = scene.cameras[0] if scale is None else scale
    last_px = np.array(camera.size_px) - 0.5
    inside = ((poses.places_px >= -0.5) & (poses.places_px <= last_px)).all(axis=2) | (scale is not None)
    seen = likely & inside
    if not seen.any():
        raise InputError.at(table, f"marks with a likelihood of {least:g} or more in the picture", "none")
    marks: list[list[MarkRow]] = [[] for _ in exposures_s]
    places_m, sds_m = _on_plane(poses, camera, seen, sd_px)
    for (row, part), place_m, sd_m in zip(np.argwhere(seen), places_m, sds_m, strict=True):
        marks[poses.frames[row]].append(MarkRow(str(nodes[part]), place_m, float(sd_m)))
    unlikely, outside = int((taken & ~likely).sum()), int((likely & ~seen).sum())
    manual = int(np.isnan(poses.likelihood[seen]).sum())
    return Imported(scene, exposures_s, tuple(tuple(found) for found in marks), unlikely, outside, manual)


def write_imported(done: Imported, folder: Path) -> None:
    """Write the imported marks as a recording to an existing folder."""
    write_scene(done.scene, folder / "scene.toml")
    write_frames_csv(folder / "frames.csv", done.exposures_s)
    write_marks_csv(folder / "marks.csv", done.exposures_s, done.marks, dim=2)


def _nodes(poses: PoseTable, scene: Scene, renamed: Sequence[str]) -> list[str | None]:
    """The node of each body part, None for an omitted one."""
    names: dict[str, str] = {}
    for text in renamed:
        part, given, node = text.partition("=")
        if not given or part not in poses.parts or part in names:
            parts = ", ".join(poses.parts)
            raise InputError.at("--rename", f"PART=NODE, once for each part of {parts}", shown(text))
        names[part] = node
    marked = scene.mark_names
    nodes = [names.get(part, part) for part in poses.parts]
    if unknown := {part: node for part, node in zip(poses.parts, nodes, strict=True) if node and node not in marked}:
        part = next(iter(unknown))
        expected = f"a node with a mark ({', '.join(marked)}); --rename {part}=NODE, or {part}= to leave it out"
        raise InputError.at(f"{poses.path}: {', '.join(unknown)}", expected, ", ".join(map(shown, unknown.values())))
    for part, node in zip(poses.parts, nodes, strict=True):
        if node and nodes.count(node) > 1:
            raise InputError.at(f"{poses.path}: {part}", "a node that no other part has", shown(node))
    return [node or None for node in nodes]


def _exposures_s(poses: PoseTable, times: float | Path) -> Floats:
    last = int(poses.frames[-1])
    if isinstance(times, Path):
        exposures_s = read_frames(times)
        if last >= len(exposures_s):
            raise InputError.at(times, f"a row for frame {last} of {poses.path}", f"{len(exposures_s)} rows")
        return exposures_s
    return np.arange(last + 1, dtype=np.float64) / times


def _on_plane(poses: PoseTable, camera: PlaneCamera, seen: NDArray[np.bool_], sd_px: float) -> tuple[Floats, Floats]:
    """Positions on the plane [m], (n, 2), of all parts with `seen` true, and their standard deviations [m], (n,).

    sd_px: standard deviation on each axis in the picture [px]. Error ellipses are replaced by circles of equal area.
    """
    places_px = poses.places_px[seen]
    var_px2 = sd_px**2 + camera.calibration_sd_px**2
    with placed(poses.path, ValueError):
        places_m = camera.to_plane(places_px)
        covs = camera.cov_to_plane(places_px, np.tile(var_px2 * np.eye(2), (len(places_px), 1, 1)))
    sds_m = np.linalg.det(covs) ** 0.25
    if not (np.abs(1e3 * places_m) <= FARTHEST_MM).all():
        raise InputError.at(poses.path, "places from -1e6 to 1e6 mm", "one beyond")
    if not ((1e3 * sds_m >= FINEST_MM) & (1e3 * sds_m <= FARTHEST_MM)).all():
        raise InputError.at(poses.path, "standard deviations from 1e-6 to 1e6 mm", "one beyond")
    return places_m, sds_m
