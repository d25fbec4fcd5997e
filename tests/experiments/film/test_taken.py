"""What keys take in over a film: counted against discs of known area, painted where they are."""

import json
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest

from experiments.film.overlay import hue_colour
from experiments.formats.scene.scene import Mark, Scene, Target, write_scene
from tests.experiments.command import softaim
from tests.networks import build_network
from vision import Disc, Lighting, VideoWriter, draw_frame, fronto_parallel_camera

NETWORK = build_network(np.array([[0.0, 0.0], [0.1, 0.0]]), [(0, 1)], [0], ["A", "M"])
CAMERA = fronto_parallel_camera("front", (320, 240), (1.0, 1.0), (0.1095, -0.0295))
"""Of 1 mm a pixel; it shows the mark at (150, 90) px."""
AREA = np.pi * 12.0**2


def scene(path: Path, hue_deg: float) -> None:
    write_scene(Scene(NETWORK, (Mark("M", hue_deg, 0.024),), Target("M", 0.005), (CAMERA,)), path)


@pytest.fixture
def film(tmp_path: Path) -> Path:
    """Four frames: a green disc of 12 px in the first two, none in the third, half the picture in the last."""
    rng = np.random.default_rng(1)
    path = tmp_path / "green.avi"
    disc = Disc(np.array([150.0, 90.0]), (12.0, 12.0), 130.0)
    wall = Disc(np.array([160.0, 120.0]), (150.0, 100.0), 130.0)
    with VideoWriter(path, (320, 240), 25.0) as writer:
        for discs in ([disc], [disc], [], [wall]):
            writer.write(draw_frame((320, 240), discs, Lighting(), rng))
    scene(tmp_path / "scene.toml", 130.0)
    return path


def test_shares_are_those_of_the_discs_drawn(film, tmp_path, capsys) -> None:
    out = tmp_path / "out"
    assert softaim("hue", film, "--scene", tmp_path / "scene.toml", "--out", out, "--film", "--json") == 0
    reported = json.loads(capsys.readouterr().out)
    rows = pd.read_csv(out / "hue.csv")
    assert rows["marks"].tolist() == ["M"] * 4
    assert rows["pixels"][:2].tolist() == pytest.approx([AREA] * 2, rel=0.1)
    assert rows["pixels"][2] == 0
    assert rows["share"][3] == pytest.approx(np.pi * 150.0 * 100.0 / (320 * 240), rel=0.03)
    assert rows["time_s"].diff()[1:].tolist() == pytest.approx([0.04] * 3)
    (kind,) = reported["kinds"]
    assert (kind["frames_too_few"], kind["frames_flooded"]) == (0.25, 0.25)
    assert kind["by_marks"] == pytest.approx(1.0, abs=0.1)
    (verdict,) = reported["verdicts"]
    assert verdict.startswith(
        "mark M: hue 130 ± 18 selects more of the picture than marks can cover in 25 % of frames: narrow"
    )


def test_taken_pixels_are_painted_where_they_are_and_the_rest_is_grey(film, tmp_path) -> None:
    out = tmp_path / "out"
    assert softaim("hue", film, "--scene", tmp_path / "scene.toml", "--out", out, "--film") == 0
    capture = cv2.VideoCapture(str(out / "film.avi"))
    assert capture.get(cv2.CAP_PROP_FPS) == pytest.approx(25.0)
    frames = [capture.read()[1] for _ in range(4)]
    assert not capture.read()[0]
    assert np.abs(frames[0][90, 150].astype(int) - hue_colour(130.0)).max() < 25
    assert np.ptp(frames[0][200, 20].astype(int)) < 12
    sheet = cv2.imread(str(out / "hue.png"))
    assert sheet is not None
    assert sheet.shape[1] == 640  # the least and the most, side by side


def test_a_film_in_which_a_mark_is_missing_is_reported(film, tmp_path, capsys) -> None:
    scene(tmp_path / "blue.toml", 240.0)
    assert softaim("hue", film, "--scene", tmp_path / "blue.toml") == 0
    said = " ".join(capsys.readouterr().out.split())
    least = 0.2 * AREA
    assert f"selects less than one mark must show, {least:.0f} px, in 100 % of frames" in said
    assert not (tmp_path / "out").exists()
