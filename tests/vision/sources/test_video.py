from pathlib import Path

import numpy as np
import pytest

from tests.vision.sources.scripted import filmed
from vision import Disc, Lighting, SourceError, VideoFileFrames, VideoWriter, compress, count_frames, draw_frame


def frames(n: int) -> list[np.ndarray]:
    rng, right = np.random.default_rng(0), np.array([1.0, 0.0])
    return [draw_frame((64, 48), [Disc((20.0, 24.0) + k * right, (8.0, 8.0), 0.0)], Lighting(), rng) for k in range(n)]


@pytest.mark.parametrize("name", ["film.avi", "film.mkv"])
def test_ffv1_loses_nothing(tmp_path: Path, name: str) -> None:
    written = frames(4)
    with VideoFileFrames(filmed(tmp_path / name, written, codec="FFV1")) as film:
        for frame, image in zip(film, written, strict=True):
            np.testing.assert_array_equal(frame.image, image)
            assert frame.exposure_s == pytest.approx(frame.index / 25.0)


def test_quality_decides_size_and_loss(tmp_path: Path) -> None:
    written = frames(20)
    sizes, losses = [], []
    for quality in (95, 30):
        path = filmed(tmp_path / f"{quality}.avi", written, quality=quality)
        assert count_frames(path) == 20
        sizes.append(path.stat().st_size)
        first = next(iter(VideoFileFrames(path))).image
        losses.append(np.sqrt(((first.astype(float) - written[0]) ** 2).mean()))
    assert sizes[1] < 0.8 * sizes[0]
    assert losses[1] > losses[0]
    # compress() loses about as much as the film does.
    for quality, loss in zip((95, 30), losses, strict=True):
        compressed = np.sqrt(((compress(written[0], quality).astype(float) - written[0]) ** 2).mean())
        assert compressed == pytest.approx(loss, rel=0.4)


def test_an_error_leaves_nothing_and_keeps_what_was_there(tmp_path: Path) -> None:
    path = tmp_path / "film.avi"
    path.write_bytes(b"an older film")

    def interrupted() -> None:
        with VideoWriter(path, (64, 48), 25.0) as video:
            video.write(frames(1)[0])
            raise RuntimeError("power cut")

    with pytest.raises(RuntimeError, match="power cut"):
        interrupted()
    assert [p.name for p in tmp_path.iterdir()] == ["film.avi"]
    assert path.read_bytes() == b"an older film"


def test_bad_frames_and_places_are_refused(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="expected a path where a MJPG video can be written, found none"):
        VideoWriter(tmp_path / "none" / "film.avi", (64, 48), 25.0)
    with (
        pytest.raises(ValueError, match=r"expected uint8 frames \(48, 64, 3\), found uint8 \(64, 48, 3\)"),
        VideoWriter(tmp_path / "film.avi", (64, 48), 25.0) as video,
    ):
        video.write(np.zeros((64, 48, 3), np.uint8))
    with pytest.raises(ValueError, match="quality: expected 1 to 100, found 0"):
        VideoWriter(tmp_path / "film.avi", (64, 48), 25.0, quality=0)
    assert list(tmp_path.iterdir()) == []
