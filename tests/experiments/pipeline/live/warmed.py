"""A program for `test_warm_up`: prints each kernel that a run calls in a way it was not called in before it began.

    python -m tests.experiments.pipeline.live.warmed phantom space

phantom: pictures, and a needle; space: marks of a body in space; each in a process of its own. Such a call is compiled
while a frame waits, unless an earlier run left it on the disk.
"""

import multiprocessing
import sys
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
from numba.core.registry import CPUDispatcher

import vision
from estimators import CovarianceError, MarkMeasurement
from experiments.formats.needle_file import read_needle
from experiments.formats.scene.scene import Mark, Scene, read_scene
from experiments.pipeline.line import Line
from experiments.pipeline.live.session import Session
from experiments.pipeline.live.warm_up import warm_up
from experiments.simulation.film import draw
from experiments.simulation.simulate import scene_of
from tests.experiments.webcam import coarse_webcam
from vision import Frame

INTERVAL = 1 / 30
NEEDLE = (
    "version = 1\nentry_mm = [0.0, 215.0]\ndirection = [0.0, -1.0]\nspeed_mm_s = 200.0\n[lesion]\nradius_mm = 2.5\n"
)
PACKAGES = ("dynamics", "estimators", "vision", "experiments")


def called() -> set[str]:
    """All kernels with the types that they were called with from Python."""
    modules = [module for name, module in list(sys.modules.items()) if name.split(".")[0] in PACKAGES and module]
    kernels = {one for module in modules for one in vars(module).values() if isinstance(one, CPUDispatcher)}
    return {f"{one.py_func.__module__}.{one.py_func.__name__} {types}" for one in kernels for types in one.signatures}


def pictures(scene: Scene) -> Iterator[np.ndarray | None]:
    """The phantom at rest, pushed about, half hidden, behind a red cloth, gone, elsewhere, dark, bright, grainy."""
    rng, network, camera = np.random.default_rng(0), scene.network, scene.cameras[0]

    def picture(places_m: np.ndarray) -> np.ndarray:
        return draw(scene, places_m, vision.Lighting(), rng, strays=[])

    rest = picture(network.positions)
    for k in range(12):
        yield picture(network.positions + 8e-3 * np.sin(k / 2.0) * ~network.fixed[:, None])
    for k in range(6):
        half = rest.copy()
        half[:, : 160 - 10 * k] = 128
        yield half
    cloth = rest.copy()
    for center in camera.project(network.positions).astype(int):
        cloth[max(center[1] - 15, 0) : center[1] + 15, max(center[0], 0) : center[0] + 15] = (10, 10, 120)
    yield from [cloth] * 6
    yield from [np.full_like(rest, 128)] * 6
    yield from [None] * 40
    yield from [rest] * 8
    for shift_px in ((0, 30), (25, -20)):
        yield from [np.roll(rest, shift_px, axis=(0, 1))] * 10
    yield from [(0.35 * rest).astype(np.uint8)] * 4
    yield from [np.clip(2.5 * rest.astype(float), 0, 255).astype(np.uint8)] * 4
    yield from [np.clip(rest + rng.normal(0.0, 25.0, rest.shape), 0, 255).astype(np.uint8)] * 4


def run_phantom() -> set[str]:
    """What pictures of the phantom call beyond what the session had called when it was made."""
    scene, now = scene_of(coarse_webcam()), [100.0]
    with tempfile.TemporaryDirectory() as folder:
        needle = Path(folder) / "needle.toml"
        needle.write_text(NEEDLE)
        plan = read_needle(needle, 5e-3, 2)
        session = Session(scene, Path(folder) / "e.csv", lambda _: None, needle=plan, clock=lambda: now[0])
        before = called()
        for k, image in enumerate(pictures(scene)):
            now[0] += INTERVAL
            if image is None:
                session.coast(now[0])
            else:
                session.take(Frame(k, now[0], image))
        session.close()
        assert {"TRACKING", "LOST"} <= set(session.statuses), session.statuses
        assert session.line.filter.repairs, "expected a restart"
    return called() - before


def run_space() -> set[str]:
    """What marks of a body call beyond the rehearsal: seen, some missing, pushed, exchanged, none, elsewhere, a fix."""
    given = read_scene(Path("tests/experiments/hanging.toml"))
    scene = replace(given, marks=tuple(Mark(node, 0.0, 0.01) for node in ("a", "hidden")))
    warm_up(scene)
    line, before = Line(scene, baseline=False), called()
    cov, rng = 2.5e-7 * np.eye(3), np.random.default_rng(0)
    for k in range(46):
        aside = 5e-3 * np.sin(k / 3.0) + (0.01 if 26 <= k < 40 else 0.0)
        places = scene.network.positions[scene.network.free] + aside + 1e-4 * rng.normal(size=(2, 3))
        names = ("a", "hidden") if 8 <= k < 13 else ("hidden", "a")
        seen = [MarkMeasurement(node, place, cov) for node, place in zip(names, places, strict=True)]
        with suppress(CovarianceError):
            line.take(k * INTERVAL, [] if 16 <= k < 21 else seen[(k // 4) % 2 :])
            if k % 15 == 5:
                line.identity.fix(line.filter.predict_at(k * INTERVAL).mean, 1e-6 * np.eye(3))
    return called() - before


def report(name: str) -> None:
    """Print what a run calls, a line each, and that it is over."""
    for kernel in sorted(run_phantom() if name == "phantom" else run_space()):
        print(f"{name}: {kernel}", flush=True)
    print(f"{name}: over", flush=True)


if __name__ == "__main__":
    # What was imported is shared where a process can be forked; no kernel was called yet
    context = multiprocessing.get_context("spawn" if sys.platform == "win32" else "fork")
    for name in sys.argv[1:]:
        process = context.Process(target=report, args=(name,))
        process.start()
        process.join()
