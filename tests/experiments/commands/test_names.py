"""Files and folders of any name: what is asked for is done, or one line says why not and nothing is left."""

import os
import shutil
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.experiments.command import softaim
from tests.experiments.commands.good_files import tree

BAD = os.fsdecode(b"k\xfcche")
SHOWN = r"k\xfcche"
SAID = "expected a name in UTF-8, found"

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="other systems refuse such names themselves")

NAMES = [
    " a quo\"te apo'strophe new\nline tab\t käfer 心臓 🫀 percent %s back\\slash [red] *? $x_1$ $ a;b&c|d",
    *("-dash", "--out", ".hidden", "%03d", "film:1", "~", "#1", "0.5", "concat:x"),
]


@pytest.fixture(autouse=True)
def _shots(here: Path) -> None:
    """A folder of one picture."""
    (here / "shots").mkdir()
    hsv = np.zeros((48, 64, 3), dtype=np.uint8)
    hsv[:12, :12] = (60, 255, 255)
    cv2.imwrite("shots/1.png", cv2.cvtColor(hsv, cv2.COLOR_HSV2BGR))


@pytest.mark.parametrize("name", NAMES, ids=ascii)
def test_any_name_in_utf_8_is_taken(here: Path, capfd: pytest.CaptureFixture[str], name: str) -> None:
    """A film, a scene, pictures, a table and the folders that are written, each of this name."""
    (here / "film").rename(here / name)
    (here / "scene.toml").rename(here / f"{name}.toml")
    (here / "shots").rename(here / f"{name}-shots")
    (here / f"{name}-shots" / "1.png").rename(here / f"{name}-shots" / f"1 {name}.png")
    shutil.copy(here / name / "video.avi", here / f"{name}.avi")
    shutil.copy(here / "sleap.csv", here / f"{name}.csv")
    scene = f"--scene={name}.toml"
    assert softaim("record", f"--out={name}-out", scene, "--", f"{name}.avi") == 0
    assert softaim("record", f"--out={name}-again", "--", f"{name}") == 0
    assert softaim("export", "--to=plus", f"--out={name}.igs.mha", "--", f"{name}-out") == 0
    assert softaim("hue", "--at=3,3", "--", f"{name}-shots") == 0
    assert softaim("hue", scene, f"--out={name}-hue", "--film", "--", f"{name}-shots") == 0
    assert softaim("import", scene, "--fps=30", f"--out={name}-marks", "--", f"{name}.csv") == 0
    assert (here / f"{name}-out" / "video.mkv").stat().st_size > 0
    assert (here / f"{name}-hue" / "film.avi").stat().st_size > 0
    assert (here / f"{name}-marks" / "marks.csv").is_file()
    assert "Traceback" not in capfd.readouterr().err


GIVEN = [
    "calibrate shots {}/1.png --board 9x6 --square-mm 25 --out c.toml",
    "calibrate --camera left={} --camera right=shots --board 9x6 --square-mm 25 --out rig",
    "track marks --out {}",
    "check {}",
    "live --source {}.avi --no-page",
    "record rtsp://{}/1 --out out",
]
"""Arguments and options of one value and of several; what checks them is the same for all commands."""


@pytest.mark.parametrize("call", GIVEN)
def test_a_name_that_is_not_utf_8_is_one_line(here: Path, capfd: pytest.CaptureFixture[str], call: str) -> None:
    before = tree(here)
    assert softaim(*(word.replace("{}", BAD) for word in call.split())) == 2
    shown = capfd.readouterr()
    assert SAID in shown.err
    assert SHOWN in shown.err
    assert shown.err.count("\n") == 1
    assert shown.err.isascii()
    assert shown.out == ""
    assert tree(here) == before


@pytest.mark.parametrize(
    "call",
    [
        "calibrate shots --board 9x6 --square-mm 25 --out c.toml",
        "hue shots --at 3,3 --frame 1",
        "hue shots --scene scene.toml --out out",
        "record shots --fps 10 --out out",
        "live --source shots --fps 10 --scene scene.toml --no-page --out out",
    ],
)
def test_a_picture_in_a_folder_whose_name_is_not_utf_8_is_one_line(here, capfd, call):
    shutil.copy(here / "shots" / "1.png", here / "shots" / f"{BAD}.png")
    assert softaim(*call.split()) == 2
    last = capfd.readouterr().err.splitlines()[-1]
    assert last.startswith("softaim: ")
    assert f"{SHOWN}.png: {SAID} other bytes" in last


def test_what_is_not_read_may_have_any_name(here: Path) -> None:
    """A stray file beside a recording, though its digest is of all files."""
    (here / "film" / BAD).write_bytes(b"stray")
    assert softaim("export", "film", "--to", "plus", "--out", "film.igs.mha") == 0


def test_the_current_folder_is_named_in_utf_8(here, capfd, monkeypatch):
    (here / BAD).mkdir()
    shutil.copy(here / "scene.toml", here / BAD)
    monkeypatch.chdir(here / BAD)
    assert softaim("check", "scene.toml") == 2
    assert capfd.readouterr().err == f"softaim: the current folder: {SAID} {here}/{SHOWN}\n"
    assert softaim("--version") == 0


def test_a_link_to_such_a_folder_works_or_is_one_line(here: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (here / BAD).mkdir()
    (here / "link").symlink_to(here / BAD)
    shutil.copy(here / "film" / "video.avi", here / BAD)
    assert softaim("record", "link/video.avi", "--out", "out") == 0
    capfd.readouterr()
    call = ("hue", "shots", "--scene", "scene.toml", "--out", "link/out", "--film")
    assert softaim(*call) == 2
    shown = capfd.readouterr().err.splitlines()
    assert SAID in shown[-1]
    assert "Traceback" not in "".join(shown)
