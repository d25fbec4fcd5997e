"""`softaim hue`: the keys of a mark's table from one place in a picture."""

import tomllib
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from experiments.commands.app import app
from experiments.commands.cameras import learned_hue
from experiments.errors import InputError
from vision import Disc, Lighting, draw_frame


@pytest.fixture
def pictures(tmp_path: Path) -> Path:
    rng = np.random.default_rng(1)
    for k in range(2):
        image = draw_frame((320, 240), [Disc(np.array([100.0 + 50 * k, 90.0]), (12.0, 12.0), 130.0)], Lighting(), rng)
        cv2.imwrite(str(tmp_path / f"{k}.png"), image)
    return tmp_path


def test_the_keys_are_those_of_the_mark(pictures: Path) -> None:
    keys = tomllib.loads("\n".join(map(str, learned_hue(str(pictures), "150,90", 1).shown)))
    assert keys["hue_deg"] == pytest.approx(130.0, abs=2.0)
    assert set(keys) == {"hue_deg", "half_width_deg", "min_saturation", "min_value"}
    reported = CliRunner().invoke(app, ["hue", str(pictures), "--at", "101,92"])
    assert reported.exit_code == 0
    assert reported.stdout.startswith("hue_deg = 1")


@pytest.mark.parametrize(
    ("at", "frame", "message"),
    [
        ("100,90", 7, "expected a frame 7, found fewer"),
        ("900,90", 0, "frame 0: place: expected one inside 320 x 240 px, found 900, 90"),
        ("250,200", 0, "frame 0: place 250, 200: expected"),
    ],
)
def test_what_cannot_be_learned_is_reported(pictures: Path, at: str, frame: int, message: str) -> None:
    with pytest.raises(InputError) as fault:
        learned_hue(str(pictures), at, frame)
    assert message in str(fault.value)
