"""`compare` runs the methods of the registry as themselves, a new one too, and no other."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER
from estimators import METHODS, ExtendedKalmanFilter, Status, TargetEstimate, UnknownMethodError
from experiments.errors import InputError
from experiments.formats.recording import read_recording
from experiments.formats.scenario import read_scenario
from experiments.pipeline.compare import chosen, compare, methods_of, tracking_problem, write_comparison
from experiments.simulation.simulate import scene_of
from tests.experiments.pipeline.tables import near, write_recording

N_FRAMES = 8


@dataclass
class Toy:
    """A method that puts the target where no other would, 1 km off, in the first frames."""

    most: int

    def run(self, frames, advance):
        """One estimate a frame."""
        for k, (time_s, marks) in enumerate(frames[: self.most], start=1):
            advance(k / len(frames))
            yield [TargetEstimate(time_s, np.array([1000.0, len(marks)]), None, Status.TRACKING, len(marks))]


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Marks of the phantom at rest, 1 mm off an axis, 30 frames/s; also one of the target, for scoring only."""
    scene, rng = replace(scene_of(read_scenario("quiet")), cameras=()), np.random.default_rng(2)
    frames = [(k / 30.0, near(scene, (*OUTER, HIDDEN), 1e-3, rng)) for k in range(N_FRAMES)]
    return read_recording(write_recording(tmp_path_factory.mktemp("rec"), scene, frames, 1.0))


def test_a_newly_registered_method_runs_as_itself(recording, monkeypatch, tmp_path):
    """Its estimates are its own, from the measured marks only; it has a table and a place in the picture."""
    monkeypatch.setitem(METHODS, "toy", lambda _problem: Toy(N_FRAMES))
    done = compare(recording, chosen("toy"))
    assert methods_of(done) == ["open-loop", "filter", "toy"]
    np.testing.assert_array_equal([e.mean for e in done.estimates("toy")], [[1000.0, 3.0]] * N_FRAMES)
    assert all(step.method_s["toy"] >= 0.0 for step in done.steps)
    write_comparison(done, tmp_path)
    assert {path.name for path in tmp_path.glob("estimates.*")} == {f"estimates.{m}.csv" for m in methods_of(done)}
    assert "toy" in chosen(None)


def test_a_registered_method_gets_the_scene_and_the_marks(recording):
    """The extended filter's estimates are those of its class on the track's marks, to the bit."""
    done = compare(recording, ("open-loop", "filter", "ekf"))
    method = ExtendedKalmanFilter(*tracking_problem(recording.scene).physics)
    for step in done.steps:
        method.predict(step.estimates["filter"].time_s)
        expected = method.update([mark for mark in step.marks if mark.node != HIDDEN])
        np.testing.assert_array_equal(step.estimates["ekf"].mean, expected.mean)
        np.testing.assert_array_equal(step.estimates["ekf"].cov, expected.cov)


def test_names_that_are_not_registered_raise(recording):
    """From the command line as InputError; from Python before the recording is run."""
    with pytest.raises(InputError, match=r'expected some of open-loop, filter, ekf, .*smoother, found "oracle"'):
        chosen("ekf, oracle")
    ran = []
    with pytest.raises(UnknownMethodError, match='found "oracle"'):
        compare(recording, ("oracle",), stage=lambda name: ran.append(name) or (lambda _share: None))
    assert ran == []


def test_a_method_that_leaves_out_frames_is_not_taken(recording, monkeypatch):
    monkeypatch.setitem(METHODS, "toy", lambda _problem: Toy(1))
    with pytest.raises(ValueError, match="toy: expected an estimate of each of 8 frames, found 1"):
        compare(recording, chosen("toy"))
