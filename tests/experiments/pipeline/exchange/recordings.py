"""A recording of pictures of random blocks, with results, small."""

import shutil
from pathlib import Path

import cv2
import numpy as np

from experiments.formats.recording import read_recording
from experiments.pipeline.exchange.exported import Exported, exported
from tests.experiments.commands.good_files import SIZE_PX, write_good_files
from vision import Lens, PlaneCamera, Pose, posed_camera
from vision.arrays import Image


def write_filmed(folder: Path) -> list[Image]:
    """Write `filmed`, a recording of three pictures of random blocks at 0, 0.1 and 0.2 s, beside all good files."""
    write_good_files(folder)
    filmed = folder / "filmed"
    (filmed / "frames").mkdir(parents=True)
    for name in ("scene.toml", "frames.csv"):
        shutil.copy(folder / "film" / name, filmed / name)
    shutil.copy(folder / "marks" / "fixes.csv", filmed / "fixes.csv")
    rng = np.random.default_rng(5)
    blocks = rng.integers(0, 256, (3, SIZE_PX[1] // 16, SIZE_PX[0] // 16, 3), dtype=np.uint8)
    images = list(np.kron(blocks, np.ones((1, 16, 16, 1), dtype=np.uint8)))
    for k, image in enumerate(images):
        cv2.imwrite(str(filmed / "frames" / f"{k:06d}.png"), image)
    return images


def tilted(degrees: float, bend: tuple[float, float] = (0.0, 0.0)) -> tuple[PlaneCamera, Pose]:
    """A camera of 60 px focal length 1 m before the plane, turned about x; bend: radial distortion; with its pose."""
    a = np.radians(degrees)
    # the camera looks down -z of the world: its x is the world's, its y and z point the other way
    rotation = np.array([[1, 0, 0], [0, -np.cos(a), np.sin(a)], [0, -np.sin(a), -np.cos(a)]])
    lens = Lens(np.array([[60.0, 0, 31.5], [0, 60.0, 23.5], [0, 0, 1]]), np.array([*bend, 0.0, 0.0, 0.0]))
    pose = Pose(rotation, np.array([0.0, 0.0, 1.0]))
    return posed_camera("front", SIZE_PX, lens, pose), pose


def export_of(folder: Path, name: str, results: str | None = None, start: str | None = None) -> Exported:
    """One of the recordings, with the results in a folder beside it."""
    return exported(read_recording(folder / name), None if results is None else folder / results, start)
