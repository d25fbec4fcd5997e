"""What a person names, and what comes of it."""

import time
from pathlib import Path

import cv2
import numpy as np
import pytest

import vision
from tests.vision.sources.scripted import filmed, numbered, numbers
from vision import EventKind, LiveFrames, SourceError, open_source, shown_source


@pytest.fixture
def film(tmp_path: Path) -> str:
    return str(filmed(tmp_path / "film.mkv", map(numbered, range(6)), 50.0, codec="FFV1"))


@pytest.fixture
def folder(tmp_path: Path) -> str:
    """Pictures of any names, one of them hidden, among other files."""
    folder = tmp_path / "pictures"
    folder.mkdir()
    for k, name in enumerate(["a 1.png", "a 2.jpg", "b.JPEG", "c.png"]):
        cv2.imwrite(str(folder / name), numbered(k))
    (folder / ".hidden.png").write_bytes(b"")
    (folder / "notes.txt").write_text("no picture")
    return str(folder)


def test_every_frame_of_a_film_comes_when_it_is_not_live(film: str) -> None:
    with open_source(film, live=False) as source:
        frames = list(source)
        assert numbers(frames) == list(range(6))
        assert source.origin_s == 0.0
        assert [frame.index for frame in frames] == list(range(6))
        assert [frame.exposure_s for frame in frames] == pytest.approx([0.02 * k for k in range(6)])
        assert source.ended
        assert source.next(0.0) is None
        assert [(event.kind, event.time_s) for event in source.take_events()] == [(EventKind.ENDED, pytest.approx(0.1))]
        assert source.take_events() == ()


def test_a_film_is_live_at_its_own_pace_though_it_stands_still(tmp_path: Path) -> None:
    film = filmed(tmp_path / "still.avi", [numbered(3)] * 6, 100.0)
    began = time.monotonic()
    with open_source(str(film), live=True) as source:
        frames = list(source)
        assert len(frames) + source.frames_dropped == 6
        assert [event.kind for event in source.take_events()] == [EventKind.ENDED]
        assert [frame.exposure_s - source.origin_s for frame in frames] == pytest.approx(
            [0.01 * f.index for f in frames], abs=1e-9
        )
    assert frames[-1].exposure_s - began >= 0.05
    np.testing.assert_allclose(np.diff([f.exposure_s for f in frames]), 0.01 * np.diff([f.index for f in frames]))


def test_a_folder_of_pictures_comes_by_name_so_many_a_second(folder: str) -> None:
    with open_source(folder, live=False, fps=10.0) as source:
        frames = list(source)
    assert numbers(frames) == [0, 1, 2, 3]
    assert [frame.exposure_s for frame in frames] == pytest.approx([0.0, 0.1, 0.2, 0.3])


ORDERS = [
    [f"frame{k}.jpg" for k in (1, 2, 3, 9, 10, 11, 20, 24)],
    [f"frame{k:04d}.png" for k in (1, 2, 10, 11, 100, 1000)],
    ["a 2.png", "a 10.png", "b 1.png"],
    ["run1 frame9.png", "run1 frame10.png", "run2 frame1.png", "run10 frame1.png"],
    ["2026-01-31T9.png", "2026-01-31T10.png", "2026-02-01T1.png"],
    ["1.jpg", "02.png", "3.JPEG", "010.png", "11.jpg"],
    ["f01.png", "f1.png"],
    ["take\n2.png", "take\n10.png"],
]
"""Names of pictures in the order in which they were taken."""


@pytest.mark.parametrize("names", ORDERS, ids=lambda names: names[0].replace("\n", " "))
def test_pictures_come_in_the_order_of_the_numbers_in_their_names(tmp_path: Path, names: list[str]) -> None:
    """As frames and for a calibration; files that begin with a dot are none, such as those a Mac leaves beside."""
    (tmp_path / "notes.txt").write_text("no picture")
    for k, name in enumerate(names):
        cv2.imwrite(str(tmp_path / name), numbered(k))
        (tmp_path / f"._{name}").write_bytes(b"no picture")
    with open_source(str(tmp_path), live=False, fps=10.0) as source:
        assert numbers(list(source)) == list(range(len(names)))
    assert [name for name, _ in vision.grey_pictures([tmp_path])] == names
    several = [path for path in tmp_path.iterdir() if path.name[0] != "." and path.suffix != ".txt"]
    assert [name for name, _ in vision.grey_pictures(several)] == names


def test_numbered_pictures_beside_hidden_files_are_a_recording(tmp_path: Path) -> None:
    for k in range(3):
        cv2.imwrite(str(tmp_path / f"{k:06d}.png"), numbered(k))
        (tmp_path / f"._{k:06d}.png").write_bytes(b"no picture")
    assert vision.count_numbered(tmp_path) == 3
    assert numbers(list(vision.FolderFrames(tmp_path, [0.0, 0.1, 0.2]))) == [0, 1, 2]


def test_a_film_is_as_fast_as_is_said(film: str) -> None:
    """Slow motion, 240 pictures a second, that is stored as 50 a second."""
    with open_source(film, live=False, fps=240.0) as source:
        assert [frame.exposure_s for frame in source] == pytest.approx([k / 240.0 for k in range(6)], abs=1e-12)
    with open_source(film, live=True, fps=240.0) as source:
        times = [(frame.index, frame.exposure_s - source.origin_s) for frame in source]
    assert [time_s for _, time_s in times] == pytest.approx([k / 240.0 for k, _ in times], abs=1e-9)


def test_a_film_that_has_not_begun_is_at_its_time_zero(film: str) -> None:
    """States are shown before the first frame, too, and their times are the film's own, not those of a clock."""
    with open_source(film, live=True) as source:
        before_s, origin_s, after_s = time.monotonic(), source.origin_s, time.monotonic()
    assert before_s <= origin_s <= after_s


@pytest.mark.parametrize("spec", ["0", "/dev/null", "rtsp://camera/1"])
def test_a_camera_and_a_stream_are_as_fast_as_they_are(spec: str) -> None:
    with pytest.raises(SourceError, match=f"{spec}: expected no fps beside a camera or stream, found 30"):
        open_source(spec, live=True, fps=30.0)


def test_pictures_of_another_size_are_reported(folder: str) -> None:
    cv2.imwrite(str(Path(folder) / "b.JPEG"), numbered(2)[:24])
    with open_source(folder, live=False, fps=10.0) as source:
        assert len(list(source)) == 4
        events = source.take_events()
    assert [(e.kind, e.text) for e in events[:2]] == [
        (EventKind.RESIZED, "from 64 x 48 to 64 x 24 px"),
        (EventKind.RESIZED, "from 64 x 24 to 64 x 48 px"),
    ]


def test_a_film_of_varying_rate_gives_its_own_times(tmp_path: Path) -> None:
    """JPEGs put into Matroska at the ticks 0, 1, 2, 5, 6, 12 of 20 ms."""
    ticks, path = [0, 1, 2, 5, 6, 12], tmp_path / "film.mkv"
    raw = [cv2.VIDEOWRITER_PROP_RAW_VIDEO, 1]
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"MJPG"), 50.0, (64, 48), raw)
    for k, tick in enumerate(ticks):
        writer.set(cv2.VIDEOWRITER_PROP_PTS, tick)
        writer.write(cv2.imencode(".jpg", numbered(k))[1])
    writer.release()
    with open_source(str(path), live=False) as source:
        assert [frame.exposure_s for frame in source] == pytest.approx([0.02 * tick for tick in ticks])


class FakeCapture:
    """Three pictures, then none; it records how it was opened."""

    opened: tuple[object, ...] = ()
    length = -1.0

    def __init__(self, *how: object) -> None:
        type(self).opened, self.given = how, 0

    def isOpened(self) -> bool:  # noqa: N802 - OpenCV's name
        return True

    def grab(self) -> bool:
        time.sleep(0.002)
        self.given += 1
        return self.given <= 3

    def retrieve(self) -> tuple[bool, np.ndarray]:
        return True, numbered(self.given)

    def get(self, prop: int) -> float:
        return self.length if prop == cv2.CAP_PROP_FRAME_COUNT else 0.0

    def release(self) -> None:
        pass


@pytest.mark.parametrize(
    ("spec", "how"),
    [
        ("0", (0,)),
        ("/dev/null", ("/dev/null", cv2.CAP_V4L2)),
        ("rtsp://camera/1", ("rtsp://camera/1", cv2.CAP_FFMPEG)),
        ("http://camera/film.mjpg", ("http://camera/film.mjpg", cv2.CAP_FFMPEG)),
        ("udp://0.0.0.0:5000", ("udp://0.0.0.0:5000", cv2.CAP_FFMPEG)),
    ],
)
def test_devices_and_streams_are_watched_and_opened_by_the_right_interface(monkeypatch, spec, how):
    monkeypatch.setattr(cv2, "VideoCapture", FakeCapture)
    with open_source(spec, live=False) as source:
        assert isinstance(source, LiveFrames)
        frames = [source.next(120.0) for _ in range(3)]
        assert numbers([frame for frame in frames if frame is not None]) == [1, 2, 3]
        assert FakeCapture.opened[: len(how)] == how
        assert source.next(0.01) is None
        assert not source.ended  # a failed read is a fault


def test_a_film_on_a_server_has_an_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cv2, "VideoCapture", type("Film", (FakeCapture,), {"length": 3.0}))
    with open_source("http://server/film.mp4", live=False) as source:
        assert numbers(list(source)) == [1, 2, 3]


@pytest.mark.parametrize(
    ("spec", "reported"),
    [
        ("100", "100: expected a camera index from 0 to 99, found more"),
        ("no such film", "no such film: expected a camera index, a device, a film, a folder or a stream, found none"),
        ("gopher://me:secret@host/1", "gopher://host/1: expected rtsp, .* before ://, found another"),
        ("{film}/..", "expected fps, frames a second, beside a folder of pictures, found none"),
    ],
)
def test_what_is_not_there_is_one_line(tmp_path: Path, spec: str, reported: str) -> None:
    with pytest.raises(SourceError, match=reported) as fault:
        open_source(str(tmp_path) if "film}" in spec else spec, live=True)
    assert "\n" not in str(fault.value)


def test_pictures_that_are_none_are_reported(folder: str, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(SourceError, match=r"empty: expected pictures, .*, found none"):
        open_source(str(tmp_path / "empty"), live=False, fps=1.0)
    (Path(folder) / "b.JPEG").write_bytes(b"no picture")
    with pytest.raises(SourceError, match=r"b.JPEG: expected a picture, found a file that cannot be read as one"):
        list(open_source(folder, live=False, fps=1.0))
    with pytest.raises(ValueError, match="fps: expected more than 0, found -1"):
        open_source(folder, live=False, fps=-1.0)


def test_a_password_is_not_repeated() -> None:
    assert shown_source("rtsp://me:secret@camera:554/1") == "rtsp://camera:554/1"
    assert shown_source("film@home.avi") == "film@home.avi"
