"""Pictures for a calibration: of one size, and of a film its sharpest frames; `test_opening.py` has their order."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from vision import SourceError, VideoWriter, grey_pictures, sharp_frames


def written(path: Path, level: int, size: tuple[int, int] = (32, 24)) -> Path:
    path.parent.mkdir(exist_ok=True)
    cv2.imwrite(str(path), np.full((size[1], size[0], 3), level, dtype=np.uint8))
    return path


def test_bad_pictures_are_named(tmp_path: Path) -> None:
    good = written(tmp_path / "a.png", 10)
    broken = tmp_path / "b.png"
    broken.write_bytes(b"\x89PNG broken")
    with pytest.raises(SourceError, match=r"b\.png: expected a picture, found a file that cannot be read as one"):
        list(grey_pictures([good, broken]))
    with pytest.raises(SourceError, match=r"z\.png: expected a picture, found no such file"):
        list(grey_pictures([good, tmp_path / "z.png"]))
    other = written(tmp_path / "c.png", 10, (48, 24))
    with pytest.raises(SourceError, match=r"c\.png: expected 32x24 as a\.png has, found 48x24"):
        list(grey_pictures([good, other]))
    (tmp_path / "empty").mkdir()
    with pytest.raises(SourceError, match=r"empty: expected a folder of pictures, found none in it"):
        list(grey_pictures([tmp_path / "empty"]))
    again = written(tmp_path / "more" / "a.png", 10)
    with pytest.raises(SourceError, match=r"a\.png: expected a unique name, found that of"):
        list(grey_pictures([good, again]))


def test_a_film_gives_the_sharpest_frame_of_each_part(tmp_path: Path) -> None:
    # 12 frames in 4 parts; frame 1 of each part has the most contrast
    with VideoWriter(tmp_path / "film.avi", (64, 48), 25.0, codec="FFV1") as film:
        for k in range(12):
            frame = np.full((48, 64, 3), 10 * (k // 3) + 50, dtype=np.uint8)
            frame[::4, ::4] += 90 if k % 3 == 1 else 30
            film.write(frame)
    found = list(sharp_frames(tmp_path / "film.avi", 4))
    assert [name for name, _ in found] == [f"frame {k:06d}" for k in (1, 4, 7, 10)]
    assert [int(image[1, 1]) for _, image in found] == [50, 60, 70, 80]
    assert len(list(sharp_frames(tmp_path / "film.avi", 40))) == 12
    beside = written(tmp_path / "plane.png", 10, (64, 48))
    names = [name for name, _ in grey_pictures([beside, tmp_path / "film.avi"])]
    assert names[10:] == ["frame 000010", "frame 000011", "plane.png"]
    with pytest.raises(SourceError, match=r"film\.avi: expected one film, found a second one"):
        list(grey_pictures([tmp_path / "film.avi", tmp_path / "film.avi"]))
