"""What the tests of commands share."""

import shutil
import time
from functools import partial
from pathlib import Path

import pytest

from estimators import IdentificationSettings
from estimators.identification.budget import Budget
from experiments.engine import spare
from experiments.pipeline import identify
from experiments.pipeline.live import session
from tests.experiments.commands.good_files import write_good_files

ONE_START = IdentificationSettings(n_starts=1)


@pytest.fixture(scope="session")
def good(tmp_path_factory) -> Path:
    """Good files of every kind, to be read only."""
    folder = tmp_path_factory.mktemp("good")
    write_good_files(folder)
    return folder


@pytest.fixture
def here(good, tmp_path, monkeypatch) -> Path:
    """Good files where the command is called, to be spoilt."""
    folder = tmp_path / "here"
    shutil.copytree(good, folder)
    monkeypatch.chdir(folder)
    return folder


@pytest.fixture
def without_pictures(monkeypatch):
    """Files of pictures have none in them, and those of a track are not there: for tests of numbers."""
    monkeypatch.setattr("experiments.plots.track.write_track_plots", lambda *_, **__: [])
    for module in ("style", "calibration"):
        monkeypatch.setattr(f"experiments.plots.{module}.saved", lambda *_: b"")


@pytest.fixture
def mesh_cache(monkeypatch, tmp_path_factory):
    """Reduced meshes are kept for this session's tests alone."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.getbasetemp() / "cache"))


@pytest.fixture(scope="session", autouse=True)
def _no_disk_is_waited_for():
    """What is written need not survive a power cut."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("os.fsync", lambda _file: None)
        yield


@pytest.fixture(scope="session", autouse=True)
def _rehearsed_once():
    """A process rehearses each kind of scene once, of each dimension, size and camera: then all is compiled."""
    rehearse, rehearsed = session.warm_up, set()

    def once(scene):
        sizes = tuple(camera.size_px for camera in scene.cameras)
        kind = scene.network.positions.shape, scene.network.springs.shape, len(scene.marks), scene.measured_nodes, sizes
        if kind not in rehearsed:
            rehearse(scene)
            rehearsed.add(kind)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(session, "warm_up", once)
        yield


@pytest.fixture(scope="session", autouse=True)
def _minutes_of_the_processor():
    """What identification and tuning may take is counted by what the process works: others may work, too."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(identify, "Budget", partial(Budget, clock=time.process_time))
        yield


@pytest.fixture(scope="session", autouse=True)
def _in_this_process():
    """Identification and tuning work in this process alone, where a test does not ask for others: each loads numba."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(spare, "spare_cores", partial(spare.spare_cores, 1))
        yield


@pytest.fixture
def one_start(monkeypatch):
    """The search for constants has one start: for tests of what uses them."""
    monkeypatch.setattr("estimators.identification.constants.IdentificationSettings", lambda: ONE_START)


@pytest.fixture(autouse=True)
def _coarse_pictures(request, monkeypatch):
    """Pictures have a ninth of the pixels, where their size is not what is tested: a page of 300 dpi takes a second."""
    if request.path.name != "test_style.py":
        monkeypatch.setattr("experiments.plots.style.DPI", 100)


@pytest.fixture(autouse=True)
def _said_with_the_first_frame(monkeypatch):
    """Where a run is served is said with its first frame, however long a busy machine takes for that."""
    monkeypatch.setattr("experiments.servers.publisher.TELLS_S", 3600.0)
