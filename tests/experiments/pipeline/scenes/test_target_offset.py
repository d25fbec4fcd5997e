"""A target at an offset from its node: every way in which estimates leave reports that point."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import vision
from dynamics import HIDDEN, OUTER, four_mass_phantom
from estimators.baselines.registry import METHODS
from experiments.formats.needle_file import read_needle
from experiments.formats.recording import read_recording
from experiments.formats.scene.scene import Mark, Scene, Target, read_scene
from experiments.pipeline.advise import advise
from experiments.pipeline.compare import compare
from experiments.pipeline.line import FILTER, OPEN_LOOP, Line
from experiments.pipeline.live.session import Session
from experiments.pipeline.plan import planned
from experiments.pipeline.track import Track, each_frame, figures, track
from experiments.simulation.film import draw
from experiments.simulation.simulate import scene_of
from tests.experiments.pipeline.tables import near, write_recording
from tests.experiments.webcam import coarse_webcam
from vision import Frame

OFFSET_M = (0.012, -0.007)
RADIUS_M = 0.005
PLAN = "version = 1\n[entry]\nfrom_mm = [-130.0, 268.0]\nto_mm = [130.0, 268.0]\nnormal = [0.0, 1.0]\nn = 20\n"
NEEDLE = "version = 1\nentry_mm = [0.0, 215.0]\ndirection = [0.0, -1.0]\nspeed_mm_s = 200.0\n"
NEEDLE += "[forces]\ncutting_N = 0.0\nfriction_N_m = 0.0\n"


@cache
def compared_of(folder: Path) -> Track:
    return compare(read_recording(folder), (OPEN_LOOP, FILTER, *METHODS))


def recording(folder: Path, offset_m: tuple[float, ...], n: int = 6) -> Path:
    """So many frames, 30 a second, of the phantom at rest by noisy marks, the hidden one seen for scoring only."""
    marks = tuple(Mark(node, 0.0 if node == HIDDEN else 120.0, 0.03, node != HIDDEN) for node in (*OUTER, HIDDEN))
    scene, rng = Scene(four_mass_phantom(), marks, Target(HIDDEN, RADIUS_M, offset_m), ()), np.random.default_rng(0)
    write_recording(folder, scene, [(k / 30, near(scene, (*OUTER, HIDDEN), 1e-3, rng)) for k in range(n)], 1.0)
    (folder / "plan.toml").write_text(PLAN)
    (folder / "needle.toml").write_text(NEEDLE)
    return folder


def checked(folder: Path) -> np.ndarray:
    done = read_recording(folder)
    line = Line(done.scene, check=True)
    return np.array([step.estimates[FILTER].mean for _, step in each_frame(line, done)])


def compared(folder: Path, method: str) -> np.ndarray:
    return np.array([e.mean for e in compared_of(folder).estimates(method)])


def aimed(folder: Path) -> np.ndarray:
    plan = read_needle(folder / "needle.toml", RADIUS_M, 2)
    return np.array([one.aim for one in advise(read_recording(folder), plan).guidance if one.aim is not None])


def planned_from(source: Path, folder: Path) -> np.ndarray:
    return planned(source, folder / "plan.toml").lesion.mean[None]


def lived(folder: Path) -> np.ndarray:
    """Means in the table of a live session before a camera, at rest."""
    scene = replace(scene_of(coarse_webcam()), target=read_scene(folder / "scene.toml").target)
    session = Session(scene, folder / "live.csv", lambda _text: None)
    image = draw(scene, scene.network.positions, vision.Lighting(), np.random.default_rng(0), strays=[])
    for k in range(6):
        session.take(Frame(k, 100.0 + k / 30.0, image))
    session.close()
    return 1e-3 * pd.read_csv(folder / "live.csv")[["x_mm", "y_mm"]].to_numpy()


DOORS: dict[str, tuple[Callable[[Path], np.ndarray], float]] = {
    "track --check": (checked, 1e-12),
    **{name: (lambda folder, name=name: compared(folder, name), 1e-12) for name in (OPEN_LOOP, FILTER, *METHODS)},
    "plan of a recording": (lambda folder: planned_from(folder, folder), 1e-12),
    "plan of a scene": (lambda folder: planned_from(folder / "scene.toml", folder), 1e-12),
    "live": (lived, 1e-7),
    # arrival is at another time, for the point lies at another depth: the target moves a little meanwhile
    "advise": (aimed, 1e-3),
}
"""Where estimates leave, and within what they agree [m]: rounding, that of a table, or motion."""


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> dict[int, tuple[Path, Path]]:
    """By how many frames: without an offset, and with it."""
    folder = tmp_path_factory.mktemp("offset")
    return {n: (recording(folder / f"node{n}", (), n), recording(folder / f"point{n}", OFFSET_M, n)) for n in (6, 70)}


@pytest.mark.parametrize("door", DOORS)
def test_every_output_reports_the_point(recordings: dict[int, tuple[Path, Path]], door: str) -> None:
    """With the offset less without it is the offset, for as many estimates."""
    report, within = DOORS[door]
    n = 70 if door == "advise" else 6  # which nothing advises on in the first two seconds
    node, point = map(report, recordings[n])
    assert len(node) == len(point) > 0
    np.testing.assert_allclose(point - node, np.tile(OFFSET_M, (len(node), 1)), rtol=0, atol=within)


def test_it_is_scored_against_the_truth_of_the_point(tmp_path: Path) -> None:
    """The hidden mark shows the node: the offset is added to it, and errors are those without one."""
    node, point = (track(read_recording(recording(tmp_path / name, o))) for name, o in (("n", ()), ("p", OFFSET_M)))
    np.testing.assert_allclose(point.truth - node.truth, np.tile(OFFSET_M, (6, 1)), atol=1e-12)
    for method in (FILTER, OPEN_LOOP):
        assert figures(point, method)["mae_mm"] == pytest.approx(figures(node, method)["mae_mm"], rel=1e-9)
