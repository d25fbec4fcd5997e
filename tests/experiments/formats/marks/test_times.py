"""Times of tables in every unit: seconds are read, others refused with the unit that they seem to be."""

from pathlib import Path

import numpy as np
import pytest

from experiments.commands.options import FASTEST_FPS, SLOWEST_FPS
from experiments.formats.marks.times import LONGEST_S, SHORTEST_S
from experiments.formats.recording import read_recording
from experiments.formats.scenario import read_scenario
from experiments.formats.scene.scene import write_scene
from experiments.simulation.simulate import scene_of
from tests.experiments.rows import complaint

SCENE = scene_of(read_scenario("webcam"))
FRAMES = np.arange(12) / 30.0
EPOCH_S = 1_764_000_000.0
DAY_S = 86_400.0


def recording(folder: Path, times: list[str], *, with_frames: bool) -> Path:
    """A recording whose marks lie as drawn, to 1 mm, at these times as a file has them."""
    write_scene(SCENE, folder / "scene.toml")
    rng = np.random.default_rng(3)
    rows = ["time_s,node,x_mm,y_mm,sd_mm"]
    for time in times:
        for node in SCENE.measured_nodes:
            x, y = 1e3 * SCENE.network.positions[SCENE.network.index(node)] + rng.normal(size=2)
            rows.append(f"{time},{node},{x:.4f},{y:.4f},1")
    (folder / "marks.csv").write_text("\n".join(rows) + "\n")
    if with_frames:
        frames = ["frame,exposure_s", *(f"{k},{time}" for k, time in enumerate(times))]
        (folder / "frames.csv").write_text("\n".join(frames) + "\n")
    return folder


def texts(times: np.ndarray, digits: int = 6) -> list[str]:
    return [f"{time:.{digits}f}" for time in times]


GOOD = {
    "seconds": texts(FRAMES),
    "of an epoch": texts(EPOCH_S + FRAMES),
    "before zero": texts(FRAMES - 3.0),
    "a frame each 1.09 s": texts(32.7 * FRAMES),
    "240 frames/s": texts(FRAMES / 8.0),
    "a gap of ten days": texts(FRAMES + 10.0 * DAY_S * (np.arange(12) > 6)),
    "one frame": ["5"],
}


@pytest.mark.parametrize("with_frames", [True, False])
@pytest.mark.parametrize("name", GOOD)
def test_seconds_are_read(tmp_path, name, with_frames) -> None:
    found = read_recording(recording(tmp_path, GOOD[name], with_frames=with_frames))
    np.testing.assert_allclose(found.exposures_s, np.array(GOOD[name], dtype=float), rtol=0, atol=1e-9)


UNITS = {
    "nanoseconds": (texts(1e9 * FRAMES, 0), "3.33333e+07"),
    "nanoseconds of an epoch": (texts(1e9 * (EPOCH_S + FRAMES), 0), "3.33"),
    "microseconds": (texts(1e6 * FRAMES, 0), "33333"),
    "microseconds, at 240 frames/s": (texts(1e6 * FRAMES / 8.0, 0), "416"),
    "milliseconds": (texts(1e3 * FRAMES, 3), "33.333"),
    "milliseconds of an epoch": (texts(1e3 * (EPOCH_S + FRAMES), 1), "33."),
    "milliseconds, with a gap": (texts(1e3 * (FRAMES + DAY_S * (np.arange(12) > 6)), 3), "33.333"),
    "minutes": (texts(FRAMES / 60.0), "0.00055"),
    "hours": (texts(FRAMES / 3600.0, 9), "9.25"),
    "days": (texts(FRAMES / DAY_S, 12), "3.858"),
}


@pytest.mark.parametrize("with_frames", [True, False])
@pytest.mark.parametrize("name", UNITS)
def test_another_unit_is_refused_and_named(tmp_path, name, with_frames) -> None:
    times, found = UNITS[name]
    folder = recording(tmp_path, times, with_frames=with_frames)
    said = complaint(read_recording, folder)
    file, row, column = ("frames.csv", 3, "exposure_s") if with_frames else ("marks.csv", 5, "time_s")
    assert said.startswith(f"{folder / file}: row {row}: {column}: expected seconds, frames 0.001 to 5 s apart, found")
    assert f"found {found}" in said
    assert said.endswith(f"it seems to be {name.split(' ')[0].rstrip(',')}")


@pytest.mark.parametrize(("name", "header"), [("truth", "time_s,node,x_mm,y_mm"), ("fixes", "time_s,x_mm,y_mm,sd_mm")])
@pytest.mark.parametrize(("stated", "unit"), [("200", "milliseconds"), ("150000", "microseconds"), ("-1000", "")])
def test_truth_and_fixes_of_another_time_than_the_frames_are_refused(tmp_path, name, header, stated, unit) -> None:
    folder = recording(tmp_path, texts(FRAMES), with_frames=True)
    row = f"{stated},M2,0,188" if name == "truth" else f"{stated},0,188,1"
    (folder / f"{name}.csv").write_text(f"{header}\n{row}\n")
    said = complaint(read_recording, folder)
    assert f"{name}.csv: row 2: time_s: expected seconds, as those of the frames, 0 to 0.366667, found none" in said
    assert said.endswith(f"it seems to be {unit}" if unit else "none after -1000")


def test_options_permit_the_frame_rates_of_recordings():
    assert pytest.approx((1.0 / LONGEST_S, 1.0 / SHORTEST_S)) == (SLOWEST_FPS, FASTEST_FPS)
