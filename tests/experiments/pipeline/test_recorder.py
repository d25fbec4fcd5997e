"""Recordings that grow: whole up to the last second when their writer is killed."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from experiments.errors import InputError
from experiments.formats.recording import read_frames, read_recording
from experiments.formats.scenario import read_scenario
from experiments.formats.scene.scene import Scene, write_scene
from experiments.pipeline.recorder import Recorder, join, record, remove_recording
from experiments.simulation.simulate import scene_of
from tests.experiments.command import softaim
from vision import EveryFrame, Frame, VideoWriter

SIZE = (64, 48)
INTERVAL = 1 / 30


def picture(k: int) -> np.ndarray:
    return np.random.default_rng(k).integers(0, 256, (48, 64, 3), dtype=np.uint8)


def small_scene() -> Scene:
    scene = scene_of(read_scenario("webcam"))
    return replace(scene, cameras=(replace(scene.cameras[0], size_px=SIZE),))


class Frames(list[Frame]):
    """Frames that the test made."""

    def __init__(self, *frames: Frame) -> None:
        super().__init__(frames)

    def close(self) -> None:
        pass


def noise(n: int, interval_s: float = INTERVAL) -> list[Frame]:
    return [Frame(k, 5.0 + interval_s * k, picture(k)) for k in range(n)]


def left_by_a_kill(folder: Path, n: int = 75) -> Path:
    """What is there of n frames before the last piece is finished, with a scene."""
    recorder = Recorder(folder, SIZE, clock=lambda: 0.0)
    for frame in noise(n):
        recorder.take(frame)
    write_scene(small_scene(), folder / "scene.toml")
    return folder


def check_frames(folder: Path, n: int) -> None:
    recording = read_recording(folder)
    assert len(recording.exposures_s) == n
    with recording.open_frames() as frames:
        seen = list(frames)
    assert len(seen) == n
    for frame in seen:
        np.testing.assert_array_equal(frame.image, picture(frame.index))


@pytest.mark.usefixtures("without_pictures")
def test_what_a_kill_leaves_is_tracked_and_recovered(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Of 75 frames two pieces of a second."""
    folder = left_by_a_kill(tmp_path / "rec")
    check_frames(folder, 60)
    assert softaim("track", folder, "--out", tmp_path / "track") == 0
    assert len((tmp_path / "track" / "estimates.csv").read_text().splitlines()) == 61
    assert softaim("record", "--recover", folder) == 0
    assert f"60 frames in {folder}" in capfd.readouterr().out
    names = {path.name for path in folder.iterdir()}
    assert names == {"frames.csv", "provenance.json", "scene.toml", "softaim.log", "video.mkv"}
    check_frames(folder, 60)


def test_a_row_cut_short_and_a_piece_without_rows_are_left_out(tmp_path: Path) -> None:
    folder = left_by_a_kill(tmp_path / "rec")
    table = (folder / "frames.csv").read_bytes()
    assert table.count(b"\n") == 61
    (folder / "frames.csv").write_bytes(table[: table.index(b"\n40,") + 5])
    check_frames(folder, 40)
    assert join(folder) == 40
    check_frames(folder, 40)


def test_rows_without_frames_are_reported(tmp_path: Path) -> None:
    folder = left_by_a_kill(tmp_path / "rec")
    (folder / "segments" / "000001.mkv").unlink()
    with pytest.raises(InputError, match=r"expected a row for each of the 30 frames of segments/, found 60 rows"):
        read_recording(folder)


def test_a_join_killed_before_its_end_or_after_can_be_done_again(tmp_path: Path) -> None:
    folder = left_by_a_kill(tmp_path / "rec")
    (folder / ".video.1.partial.mkv").write_bytes(b"half a film")
    check_frames(folder, 60)
    with VideoWriter(folder / "video.mkv", SIZE, 30.0, codec="FFV1") as film:
        for k in range(60):
            film.write(picture(k))
    (folder / "segments" / "000000.mkv").unlink()
    check_frames(folder, 60)
    assert join(folder) == 60
    assert sorted(path.name for path in folder.iterdir()) == ["frames.csv", "scene.toml", "video.mkv"]
    with pytest.raises(InputError, match=r"rec: expected segments/ of a killed recording, found none"):
        join(folder)


def test_a_recording_ends_with_its_source_or_its_seconds(tmp_path: Path) -> None:
    assert record(EveryFrame(Frames(*noise(50))), tmp_path / "all", clock=lambda: 0.0) == 50
    assert record(EveryFrame(Frames(*noise(50))), tmp_path / "some", seconds=1.0) == 30
    assert read_frames(tmp_path / "all" / "frames.csv") == pytest.approx([5.0 + INTERVAL * k for k in range(50)])
    assert len(list((tmp_path / "all" / "segments").iterdir())) == 2


def test_a_piece_is_finished_though_no_frame_comes(tmp_path: Path) -> None:
    """Three frames, then none while the test's clock goes on by 0.1 s a wait."""
    now, rows = [0.0], {}

    class Silent(EveryFrame):
        ended = False

        def next(self, timeout_s: float = 0.0) -> Frame | None:
            frame = next(self._coming, None)
            if frame is None:
                now[0] += timeout_s
                rows[round(now[0], 1)] = len((tmp_path / "rec" / "frames.csv").read_text().splitlines()) - 1
            return frame

    assert record(Silent(Frames(*noise(3))), tmp_path / "rec", seconds=1.95, clock=lambda: now[0]) == 3
    assert rows[1.0] == 0
    assert rows[1.2] == 3
    assert max(rows) == 2.0


def test_a_piece_is_finished_by_the_clock_where_writing_is_slow(tmp_path: Path) -> None:
    now = [0.0]
    recorder = Recorder(tmp_path / "rec", SIZE, clock=lambda: now[0])
    rows = []
    for frame in noise(9):
        recorder.take(frame)
        rows.append(recorder.n_rows)
        now[0] += 0.25
    assert rows == [0, 0, 0, 0, 4, 4, 4, 4, 8]


def test_another_size_or_a_time_that_goes_back_ends_it_and_what_came_is_kept(tmp_path: Path) -> None:
    wide = Frame(40, 7.0, np.zeros((48, 80, 3), np.uint8))
    with pytest.raises(InputError, match=r"size: expected frames of 64 x 48 px, found 80 x 48"):
        record(EveryFrame(Frames(*noise(40), wide)), tmp_path / "size")
    assert join(tmp_path / "size") == 40
    with pytest.raises(InputError, match=r"time: expected a frame after 5.033333333 s, found 5.0"):
        record(EveryFrame(Frames(*noise(2), noise(1)[0])), tmp_path / "time")
    assert join(tmp_path / "time") == 2


def test_a_film_is_recorded_and_can_be_tracked(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with VideoWriter(tmp_path / "film.avi", SIZE, 30.0, codec="FFV1") as film:
        for k in range(40):
            film.write(picture(k))
    write_scene(small_scene(), tmp_path / "scene.toml")
    words = ("record", tmp_path / "film.avi", "--out", tmp_path / "rec", "--scene", tmp_path / "scene.toml")
    assert softaim(*words) == 0
    assert f"40 frames in {tmp_path / 'rec'}; next: softaim track" in capfd.readouterr().out
    names = {path.name for path in (tmp_path / "rec").iterdir()}
    assert names == {"frames.csv", "provenance.json", "scene.toml", "softaim.log", "video.mkv"}
    check_frames(tmp_path / "rec", 40)
    # what is read is not written over
    film = tmp_path / "rec" / "video.mkv"
    assert softaim("record", film, "--out", tmp_path / "rec", "--force") == 2
    assert f"rec: expected a folder apart from {film}, which is read" in capfd.readouterr().err
    check_frames(tmp_path / "rec", 40)


def test_the_recording_of_several_cameras_is_removed_whole_and_nothing_else(tmp_path: Path) -> None:
    gone = ["video.avi", "video.left.avi", "frames.csv", "frames.left.csv", "marks.csv", "truth.csv"]
    for name in (*gone, "scene.toml", "frames.md", "video.left.txt"):
        (tmp_path / name).write_text("")
    for name in ("frames", "frames.left"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "1.png").write_text("")
    remove_recording(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["frames.md", "scene.toml", "video.left.txt"]
