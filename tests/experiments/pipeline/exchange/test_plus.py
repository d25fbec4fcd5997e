"""A sequence of PLUS, read by the rules of MetaImage: a header of lines, then pixels."""

import io
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from experiments.formats.recording import read_recording
from experiments.pipeline.exchange import plus
from experiments.pipeline.exchange.plus import export_plus, picture_off_mm, picture_to_plane
from tests.experiments.commands.good_files import SIZE_PX
from tests.experiments.pipeline.exchange.recordings import export_of, tilted, write_filmed
from vision import SourceError

MAX_LINE_LENGTH = 1000
"""Of IGSIO's reader; it would take the rest of a longer line for another field."""


def sequence(
    folder: Path, name: str, results: str | None = None, start: str | None = None
) -> tuple[dict[str, str], np.ndarray, int]:
    """Fields of the header, pixels (n_frames, height, width, n_channels), and what was returned."""
    stream = io.BytesIO()
    placed = export_plus(export_of(folder, name, results, start), stream)
    data = stream.getvalue()
    end = data.index(b"ElementDataFile = LOCAL\n") + len(b"ElementDataFile = LOCAL\n")
    lines = data[:end].decode("ascii").splitlines()
    assert lines[0] == "ObjectType = Image"
    assert max(map(len, lines)) < MAX_LINE_LENGTH
    fields = dict(line.split(" = ", maxsplit=1) for line in lines)
    assert len(fields) == len(lines)
    width, height, n_frames = (int(word) for word in fields["DimSize"].split())
    assert fields["ElementType"] == "MET_UCHAR"
    pixels = np.frombuffer(data[end:], dtype=np.uint8)
    return fields, pixels.reshape(n_frames, height, width, int(fields["ElementNumberOfChannels"])), placed


def matrix(fields: dict[str, str], frame: int, name: str) -> np.ndarray:
    return np.array(fields[f"Seq_Frame{frame:04d}_{name}Transform"].split(), dtype=float).reshape(4, 4)


def test_pixels_and_times_are_those_of_the_frames(tmp_path: Path) -> None:
    images = write_filmed(tmp_path)
    fields, pixels, _ = sequence(tmp_path, "filmed")
    assert fields["NDims"] == "3"
    assert fields["Kinds"] == "domain domain list"
    assert fields["UltrasoundImageOrientation"] == "MF"
    assert fields["UltrasoundImageType"] == "RGB_COLOR"
    np.testing.assert_array_equal(pixels[..., ::-1], images)  # RGB there, BGR here
    assert [fields[f"Seq_Frame{k:04d}_Timestamp"] for k in range(3)] == ["0.000000000", "0.100000000", "0.200000000"]
    assert [fields[f"Seq_Frame{k:04d}_ImageStatus"] for k in range(3)] == ["OK"] * 3
    assert not any("Target" in name for name in fields)


def test_the_target_is_in_frames_that_are_trusted(files: Path) -> None:
    fields, _, placed = sequence(files, "filmed", "results", "2026-01-31T09:00:00Z")
    assert placed == 1
    statuses = [fields[f"Seq_Frame{k:04d}_TargetToReferenceTransformStatus"] for k in range(3)]
    assert statuses == ["INVALID", "OK", "INVALID"]
    expected = np.eye(4)
    expected[:2, 3] = 1.0, 189.0
    np.testing.assert_allclose(matrix(fields, 1, "TargetToReference"), expected, rtol=1e-9)
    np.testing.assert_array_equal(matrix(fields, 2, "TargetToReference"), np.eye(4))
    assert fields["Seq_Frame0002_TargetStatus"] == "LOST"
    assert fields["Seq_Frame0001_TargetCovariance"] == "1 0.25 0.25 2"
    assert "Seq_Frame0002_TargetCovariance" not in fields
    assert [fields[f"Seq_Frame{k:04d}_Advice"] for k in range(3)] == ["NO_GUIDANCE", "GO", "NO_GUIDANCE"]
    assert fields["Seq_Frame0001_Timestamp"] == "1769850000.100000000"


def test_pictures_lie_where_the_camera_sees_the_plane(files: Path) -> None:
    """Square to the plane: 15 mm a pixel, the middle of 64x48 px over the origin, v down."""
    fields, _, _ = sequence(files, "filmed")
    expected = [[15.0, 0.0, 0.0, -15.0 * 31.5], [0.0, -15.0, 0.0, 15.0 * 23.5], [0.0, 0.0, -15.0, 0.0], [0, 0, 0, 1]]
    np.testing.assert_allclose(matrix(fields, 2, "ImageToReference"), expected, atol=1e-6)


def test_a_tilted_pictures_error_is_reported(files: Path) -> None:
    """A camera 1 m before the plane, turned by 20 degrees about x, by the pinhole model."""
    scene = read_recording(files / "filmed").scene
    camera, pose = tilted(20.0)
    aslant = replace(scene, cameras=(camera,))
    straight = picture_to_plane(aslant)
    offs = []
    for mark in aslant.marks:
        place = np.array([*scene.network.positions[scene.network.index(mark.node)], 0.0])
        x, y, z = pose.rotation @ place + [0.0, 0.0, 1.0]
        shown = straight @ [60.0 * x / z + 31.5, 60.0 * y / z + 23.5, 0.0, 1.0]
        offs.append(np.hypot(*(shown[:2] - 1e3 * place[:2])))
    assert max(offs) > 1.0
    assert picture_off_mm(aslant) == pytest.approx(max(offs), rel=1e-6)
    assert picture_off_mm(scene) < 1e-6


def test_without_pictures_each_frame_is_one_pixel(files: Path) -> None:
    fields, pixels, placed = sequence(files, "marks", "results")
    assert pixels.shape == (3, 1, 1, 1)
    assert placed == 1
    assert fields["UltrasoundImageType"] == "BRIGHTNESS"
    assert fields["Seq_Frame0001_ImageStatus"] == "INVALID"
    assert fields["Seq_Frame0001_TargetToReferenceTransformStatus"] == "OK"
    assert "Seq_Frame0001_ImageToReferenceTransform" not in fields


def test_it_is_said_where_plus_cannot_read_so_many(files, monkeypatch, caplog):
    n_bytes = 3 * 3 * SIZE_PX[0] * SIZE_PX[1]
    monkeypatch.setattr(plus, "WHOLE_READ_BYTES", n_bytes + 1)
    sequence(files, "filmed")
    assert "PLUS" not in caplog.text
    monkeypatch.setattr(plus, "WHOLE_READ_BYTES", n_bytes)
    sequence(files, "filmed")
    assert "PLUS does not read sequences of 4 GiB or more, like these 3 pictures" in caplog.text


def test_a_picture_of_another_size_is_refused(tmp_path: Path) -> None:
    images = write_filmed(tmp_path)
    cv2.imwrite(str(tmp_path / "filmed" / "frames" / "000002.png"), images[2][:, :60])
    with pytest.raises(SourceError, match=r"filmed/frames/000002.png: expected 64x48, found 60x48"):
        sequence(tmp_path, "filmed")
