import os
import re
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

import vision
from tests.vision.sources.scripted import filmed, numbered, numbers
from vision import FolderFrames, SourceError, VideoFileFrames

N = 5


@pytest.fixture
def film(tmp_path: Path) -> Path:
    return filmed(tmp_path / "film.avi", map(numbered, range(N)), codec="FFV1")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    folder = tmp_path / "frames"
    folder.mkdir()
    for k in range(N):
        cv2.imwrite(str(folder / f"{k:06d}.png"), numbered(k))
    return folder


def test_every_frame_comes_once_in_order_with_its_exposure(film: Path, folder: Path) -> None:
    exposures = [0.0, 0.1, 0.15, 0.4, 0.9]
    for frames in (VideoFileFrames(film, exposures), FolderFrames(folder, exposures)):
        with frames:
            seen = list(frames)
        assert [f.index for f in seen] == list(range(N))
        assert [f.exposure_s for f in seen] == exposures
        assert numbers(seen) == list(range(N))


@pytest.mark.parametrize(
    ("n_exposures", "found"), [(4, "expected 4 frames, found more"), (6, "expected 6 frames, found 5")]
)
def test_frames_and_exposures_must_agree(film: Path, n_exposures: int, found: str) -> None:
    frames = iter(VideoFileFrames(film, [float(k) for k in range(n_exposures)]))
    # All that have an exposure come; then the error.
    assert [next(frames).index for _ in range(min(n_exposures, N))] == list(range(min(n_exposures, N)))
    with pytest.raises(SourceError, match=f"film.avi: {found}"):
        next(frames)


def test_a_film_cut_short_is_reported(tmp_path: Path) -> None:
    path = filmed(tmp_path / "film.avi", np.random.default_rng(0).integers(0, 255, (N, 48, 64, 3), dtype=np.uint8))
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(SourceError, match=r"film.avi: expected 5 frames, found [1-3]$"):
        list(VideoFileFrames(path, [0.0] * N))


def test_a_folder_with_gaps_or_other_counts_is_reported(folder: Path) -> None:
    with pytest.raises(SourceError, match="frames: expected 3 frames, found 5"):
        FolderFrames(folder, [0.0] * 3)
    (folder / "000002.png").rename(folder / "000007.png")
    with pytest.raises(SourceError, match=r"000002.png: expected frame 2, found no such file"):
        list(FolderFrames(folder, [0.0] * N))
    (folder / "000002.png").write_bytes(b"no picture")
    (folder / "000007.png").unlink()
    with pytest.raises(SourceError, match=r"000002.png: expected a picture, found a file that cannot be read as one"):
        list(FolderFrames(folder, [0.0] * N))
    cv2.imwrite(str(folder / "000002.png"), numbered(2)[::2, ::2])
    height, width = numbered(2).shape[:2]
    with pytest.raises(SourceError, match=f"000002.png: expected {width}x{height}, found {width // 2}x{height // 2}"):
        list(FolderFrames(folder, [0.0] * N))
    with pytest.raises(SourceError, match="expected a folder of frames, found none"):
        FolderFrames(folder / "none", [])


def test_a_bad_film_gives_one_line_and_no_noise(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """OpenCV's own code writes on the file descriptor of standard error."""
    with pytest.raises(SourceError, match=r"none.avi: expected a video file, found no such file"):
        VideoFileFrames(tmp_path / "none.avi")
    for name, content in {"text.avi": b"no film at all " * 50, "text.mp4": b"\0\0\0\x18ftypmp42" * 20}.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(SourceError, match=f"{name}: expected a video that OpenCV can decode, found none"):
            VideoFileFrames(tmp_path / name)
    assert capfd.readouterr() == ("", "")


@pytest.mark.skipif(sys.platform != "linux", reason="other systems refuse such names themselves")
@pytest.mark.parametrize(
    "use",
    [
        vision.grey_picture,
        vision.VideoFileFrames,
        vision.count_frames,
        lambda path: vision.VideoWriter(path, (64, 48), 10.0),
        lambda path: vision.open_source(path, live=False),
        lambda path: vision.open_source(f"http://{path}", live=False),
        lambda path: list(vision.PictureFolderFrames(path.parent, 10.0)),
    ],
)
def test_a_name_that_is_not_utf_8_never_reaches_opencv(tmp_path: Path, use: Callable[[Path], object]) -> None:
    """It would end the process."""
    path = tmp_path / os.fsdecode(b"k\xfcche.png")
    path.write_bytes(b"no picture")
    with pytest.raises(SourceError, match=r"k\\xfcche.*png: expected a name in UTF-8, found other bytes") as fault:
        use(path)
    assert str(fault.value).isascii()


def test_every_name_that_opencv_gets_is_checked() -> None:
    root = Path(__file__).parents[3]
    for package in ("vision", "experiments"):
        for file in (root / package).rglob("*.py"):
            found = re.findall(r"cv2\.(?:imread|imwrite|VideoCapture|VideoWriter)\(str\(.*", file.read_text("utf-8"))
            assert not found, file
