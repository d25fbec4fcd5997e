"""Films in pieces: what is whole is read, bit for bit, and joined without loss."""

from pathlib import Path

import numpy as np
import pytest

from vision import Codec, SegmentFrames, SegmentWriter, SourceError, VideoFileFrames, join_segments
from vision.sources.segments import count_segment_frames

SIZE = (64, 48)


def picture(k: int) -> np.ndarray:
    return np.random.default_rng(k).integers(0, 256, (48, 64, 3), dtype=np.uint8)


def written(folder: Path, codec: Codec, pieces: tuple[int, ...] = (3, 1, 4)) -> int:
    """Pieces of so many frames, and one that was not finished; the frames in whole pieces."""
    folder.mkdir()
    writer, k = SegmentWriter(folder, SIZE, codec), 0
    for n in pieces:
        for _ in range(n):
            writer.write(picture(k))
            k += 1
        writer.finish()
    writer.write(picture(k))
    return k


@pytest.mark.parametrize("codec", ["FFV1", "MJPG"])
def test_pieces_are_read_in_order_and_joined_without_loss(tmp_path: Path, codec: Codec) -> None:
    n = written(tmp_path / "pieces", codec)
    assert count_segment_frames(tmp_path / "pieces") == n
    times = [0.5 * k for k in range(n)]
    with SegmentFrames(tmp_path / "pieces", times) as frames:
        pieces = list(frames)
    assert [frame.exposure_s for frame in pieces] == times
    if codec == "FFV1":
        for frame in pieces:
            np.testing.assert_array_equal(frame.image, picture(frame.index))
    film = tmp_path / ("film.mkv" if codec == "FFV1" else "film.avi")
    shares: list[float] = []
    join_segments(tmp_path / "pieces", film, n - 1, 20.0, shares.append)
    assert shares[-1] == 1.0
    with VideoFileFrames(film) as joined:
        for piece, frame in zip(pieces[:-1], joined, strict=True):
            np.testing.assert_array_equal(frame.image, piece.image)
            assert frame.exposure_s == pytest.approx(frame.index / 20.0)


def test_frames_without_a_time_are_left_out_and_times_without_a_frame_reported(tmp_path: Path) -> None:
    n = written(tmp_path / "pieces", "FFV1")
    assert len(list(SegmentFrames(tmp_path / "pieces", [0.0] * (n - 2)))) == n - 2
    with pytest.raises(SourceError, match=f"pieces: expected {n + 1} frames, found {n}"):
        list(SegmentFrames(tmp_path / "pieces", [0.0] * (n + 1)))


@pytest.mark.parametrize("codec", ["FFV1", "MJPG"])
def test_a_join_that_fails_leaves_nothing(tmp_path: Path, codec: Codec) -> None:
    n = written(tmp_path / "pieces", codec)
    film = tmp_path / ("film.mkv" if codec == "FFV1" else "film.avi")
    with pytest.raises(SourceError, match=f"expected {n + 1} frames"):
        join_segments(tmp_path / "pieces", film, n + 1, 20.0)
    assert [path.name for path in tmp_path.iterdir()] == ["pieces"]


def test_missing_pieces_are_reported(tmp_path: Path) -> None:
    written(tmp_path / "pieces", "FFV1")
    (tmp_path / "pieces" / "000001.mkv").unlink()
    with pytest.raises(SourceError, match=r"pieces: expected piece 000001.mkv, found 000002.mkv"):
        SegmentFrames(tmp_path / "pieces", [])
    (tmp_path / "none").mkdir()
    with pytest.raises(SourceError, match=r"none: expected pieces of a film, .* found none"):
        SegmentFrames(tmp_path / "none", [])
