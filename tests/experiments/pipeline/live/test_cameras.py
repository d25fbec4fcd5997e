"""A body in space is followed live by its cameras, recorded and replayed; cameras are recorded together."""

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import vision
from experiments.errors import InputError
from experiments.formats.films.several import exposures_of
from experiments.formats.recording import Recording, read_recording
from experiments.pipeline.frame_sources import by_camera, open_live
from experiments.pipeline.live.control import Control
from experiments.pipeline.live.following import as_written, follow
from experiments.pipeline.live.replaying import replay
from experiments.pipeline.live.session import Session
from experiments.pipeline.recorder import Recorder, join
from tests.experiments.command import softaim
from tests.experiments.in_space import breast
from tests.experiments.pipeline.live.test_session import Clocked
from tests.experiments.pipeline.sight.test_space import recorded


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """Two cameras, one exposing 10 ms after the other."""
    return read_recording(recorded(tmp_path_factory.mktemp("cameras"), breast(), duration_s=0.15, stagger_s=0.01))


def test_a_live_run_follows_the_target_and_its_recording_replays_bit_for_bit(filmed: Recording, tmp_path: Path) -> None:
    exposures = [vision.Exposure(100.0 + one.exposure_s, one.images) for one in exposures_of(filmed.films)]
    source, scene = Clocked([(one.exposure_s + 0.02, one) for one in exposures]), as_written(filmed.scene)
    session = Session(scene, tmp_path / "estimates.csv", lambda _text: None, clock=lambda: source.now)
    control = Control(session, tmp_path, source="a test")
    control.record(True)
    follow(session, source, np.inf, clock=lambda: source.now)
    (folder,) = control.finish()
    session.close()
    assert session.counters.frames == len(filmed.exposures_s)
    last = session.line.filter.predict_at(100.0 + filmed.exposures_s[-1])
    truth = filmed.truth.at(filmed.exposures_s[-1:], scene.target.node)[1][0]
    assert np.linalg.norm(last.mean - truth) < 0.001

    written = read_recording(folder)
    for film, own in zip(written.films, filmed.films, strict=True):
        np.testing.assert_allclose(film.exposures_s, 100.0 + own.exposures_s, atol=1e-9)
    (tmp_path / "again").mkdir()
    done = replay(folder, tmp_path / "again")
    assert (done.frames, done.lacking, done.different, done.begun) == (len(filmed.exposures_s), 0, {}, True)


def test_a_recording_of_cameras_is_played_and_filmed_live_by_its_name(
    filmed: Recording, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each picture comes alone, in an estimate of its own; a busy machine may take few of them."""
    out = tmp_path / "run"
    assert softaim("live", "--source", filmed.folder, "--out", out, "--film", "--no-page", "--json") == 0
    assert len((out / "estimates.csv").read_text("utf-8").splitlines()) > 1
    done = json.loads(capsys.readouterr().out)
    (film,) = done["film"]
    n_filmed = sum(vision.count_frames(path) for path in out.glob("film.*.avi"))
    assert n_filmed == film["frames"] == done["frames"] - film["dropped"]


def films(recording: Recording) -> Iterator[str]:
    return (f"{film.camera}={film.source}" for film in recording.films)


def test_cameras_are_recorded_together_and_tracked(filmed: Recording, tmp_path: Path) -> None:
    out, scene = tmp_path / "rec", filmed.folder / "scene.toml"
    assert softaim("record", *films(filmed), "--scene", str(scene), "--out", str(out)) == 0
    written = read_recording(out)
    assert [film.camera for film in written.films] == ["left", "right"]
    for film, own in zip(written.films, filmed.films, strict=True):
        # by the films' own rate; all pictures to the last bit
        assert len(film.exposures_s) == len(own.exposures_s)
        with film.open_frames() as mine, own.open_frames() as theirs:
            assert all(np.array_equal(a.image, b.image) for a, b in zip(mine, theirs, strict=True))
    assert {path.name for path in out.iterdir()} >= {"scene.toml", "video.left.mkv", "frames.right.csv"}
    assert not [path for path in out.iterdir() if path.is_dir()]


def test_force_replaces_a_recording_of_cameras(filmed: Recording, tmp_path: Path) -> None:
    out = tmp_path / "rec"
    Recorder(out / "segments.left", (64, 48))
    Recorder(out / "another", (64, 48))  # a recording of its own
    assert softaim("record", *films(filmed), "--out", str(out), "--seconds", "0.1", "--force") == 0
    assert sorted(path.name for path in out.glob("video*")) == ["video.left.mkv", "video.right.mkv"]
    times_s = [float(line.split(",")[1]) for line in (out / "frames.left.csv").read_text("ascii").split()[1:]]
    assert len(times_s) == 3
    assert [path.name for path in out.iterdir() if path.is_dir()] == ["another"]


@pytest.mark.parametrize("interrupted", [False, True], ids=["killed", "killed again while joining"])
def test_what_a_killed_recorder_left_of_each_camera_is_joined(tmp_path: Path, interrupted: bool) -> None:
    for name, n_frames in (("left", 3), ("right", 2)):
        recorder = Recorder(tmp_path / f"segments.{name}", (64, 48))
        for k in range(n_frames):
            recorder.take(vision.Frame(k, 0.1 * k, np.full((48, 64, 3), k, np.uint8)))
        recorder.finish_piece()
    if interrupted:
        join(tmp_path / "segments.left")
        (tmp_path / "segments.left" / "video.mkv").rename(tmp_path / "video.left.mkv")
    assert softaim("record", "--recover", str(tmp_path)) == 0
    rows = {name: (tmp_path / f"frames.{name}.csv").read_text("ascii").split()[1:] for name in ("left", "right")}
    assert rows == {
        "left": ["0,0.000000000", "1,0.100000000", "2,0.200000000"],
        "right": ["0,0.000000000", "1,0.100000000"],
    }
    assert sorted(path.name for path in tmp_path.glob("video*")) == ["video.left.mkv", "video.right.mkv"]


def test_sources_are_named_by_camera() -> None:
    assert by_camera(["left=0", "right cam=rtsp://there/a?b=c"]) == {"left": "0", "right cam": "rtsp://there/a?b=c"}
    assert by_camera(["rtsp://there/a?b=c"]) == {"": "rtsp://there/a?b=c"}
    for wrong in (["left=0", "1"], ["left=0", "left=1"], ["0", "1"]):
        with pytest.raises(InputError, match=r"^source: expected NAME=SOURCE"):
            by_camera(wrong)


def test_a_camera_that_the_scene_lacks_is_one_line(filmed: Recording) -> None:
    scene = filmed.folder / "scene.toml"
    with pytest.raises(InputError, match=r"^source of camera top: expected a camera of .* \(left, right\), found top$"):
        open_live(["top=0"], scene)
    with pytest.raises(InputError, match=r"camera: expected one, found 2 in space: give NAME=SOURCE of each"):
        open_live(["0"], scene)
