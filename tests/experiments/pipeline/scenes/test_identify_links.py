"""`softaim identify` and `tune` of a real pendulum: rigid links, in motion from the start; what is not written."""

import json
from contextlib import redirect_stdout
from dataclasses import replace
from io import StringIO

import numpy as np
import pytest

from estimators import Budget, FilterSettings, ResidualTest
from experiments.formats.scene.marks import Mark
from experiments.formats.scene.scene import Scene, read_scene
from experiments.formats.scene.target import Target
from experiments.pipeline import identify
from tests.estimators.identification.pendulum import LENGTHS, SD, hanging_links, swung
from tests.experiments.command import softaim
from tests.experiments.conftest import ONE_START
from tests.experiments.pipeline.tables import write_recording

N_FRAMES = 30


def pendulum(factors):
    """Links of 2,000 N/m with rest lengths by these factors, the upper one of a group of its own."""
    marks = (Mark("end", 0.0, 5e-3), Mark("joint", 120.0, 5e-3, measured=False))
    return Scene(hanging_links(factors), marks, Target("joint", 3e-3), (), spring_groups=("upper arm", ""))


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """0.3 s at 100 frames/s, both masses seen to SD; lengths in the scene 8 and 7 % wrong."""
    times, places = swung(N_FRAMES)
    noisy = places + np.random.default_rng(4).normal(0.0, SD, places.shape)
    frames = [(t, zip(("joint", "end"), now, strict=True)) for t, now in zip(times, noisy, strict=True)]
    return write_recording(tmp_path_factory.mktemp("pendulum") / "rec", pendulum((1.08, 0.93)), frames, 1e3 * SD)


@pytest.fixture(scope="module")
def run(recording, tmp_path_factory):
    """The scene that identify makes of it with one start, the result behind it, and its report to programs."""
    out, results, printed = tmp_path_factory.mktemp("out") / "scene.toml", [], StringIO()
    honest = identify.identify_constants

    def kept(*args, **keys):
        results.append(honest(*args, **keys))
        return results[-1]

    with pytest.MonkeyPatch.context() as patch, redirect_stdout(printed):
        patch.setattr(identify, "identify_constants", kept)
        patch.setattr("estimators.identification.constants.IdentificationSettings", lambda: ONE_START)
        assert softaim("identify", recording, "--out", out, "--json") == 0
    return out, results[0], json.loads(printed.getvalue())


def test_the_lengths_of_links_that_swing_are_found(run):
    """From 8 and 7 % wrong to 1 %; the groups stay in the scene."""
    scene = read_scene(run[0])
    np.testing.assert_allclose(scene.network.rest_lengths, LENGTHS, rtol=0.01)
    assert scene.spring_groups == ("upper arm", "")


def test_how_well_it_fits_is_reported(run):
    report = run[2]
    assert report["starts"] == {"followed": 1, "agreeing": 1}
    assert report["residuals"]["explained"] is True
    assert N_FRAMES / 2 < report["residuals"]["innovations"] <= 2 * N_FRAMES  # of the joint, once the filter has begun
    assert report["frames"] == N_FRAMES
    assert report["in_time"] is True
    assert report["target_error_mm"] < report["target_error_before_mm"]
    assert report["constants"][0]["name"] == "stiffness upper arm"
    assert all(row["standard_error"] > 1e-5 for row in report["constants"])


def test_residuals_that_are_not_explained_are_said_in_one_line(run):
    """One line names the size of the residuals and what it costs."""
    large = replace(run[1], residuals=ResidualTest(4.0, 1.6, 240, 90.0, explained=False))
    (line,) = [line for line in identify.fit_lines(large, 5.0) if "not explained" in line]
    assert "their mean square is 4.00 times the predicted one; 240 count as 90 independent ones" in line
    assert "independent ones; standard errors were multiplied by up to 1.6" in line


LESS_LIKELY = {"log_likelihood": -5.0, "log_likelihood_before": 10.0}
FARTHER = {"target_error_m": 3e-3, "target_error_before_m": 2e-3}


@pytest.mark.parametrize(
    ("worse", "message"),
    [
        (LESS_LIKELY, "expected constants that fit better than the scene's"),
        (FARTHER, "found an error of 3.00 mm instead of 2.00 mm"),
    ],
)
def test_a_scene_that_fits_worse_is_not_written(recording, run, monkeypatch, capsys, tmp_path, worse, message):
    monkeypatch.setattr(identify, "identify_constants", lambda *_args, **_keys: replace(run[1], **worse))
    out = tmp_path / "scene.toml"
    assert softaim("identify", recording, "--out", out) == 2
    error = capsys.readouterr().err
    assert message in error
    assert len(error.splitlines()) == 1
    assert not out.exists()


@pytest.mark.parametrize("command", ["identify", "tune"])
def test_too_few_minutes_are_one_clear_error(recording, monkeypatch, capsys, tmp_path, command):
    """A clock that every look at it moves by a second."""
    seconds = iter(range(100_000))
    monkeypatch.setattr(identify, "Budget", lambda limit: Budget(limit, lambda: float(next(seconds))))
    out = tmp_path / "scene.toml"
    assert softaim(command, recording, "--minutes", "0.2", "--out", out) == 2
    error = [line for line in capsys.readouterr().err.splitlines() if "rests up to" not in line]
    assert len(error) == 1
    assert error[0].startswith("softaim: --minutes: expected more time, found 12 s")
    assert not out.exists()


def test_tune_ends_with_the_best_that_its_time_allows(recording, run, monkeypatch, capsys, tmp_path):
    """A clock by which the whole recording, five times, takes more: fewer frames, and a line about it."""
    seconds = iter(range(1_000_000))
    monkeypatch.setattr(identify, "Budget", lambda limit: Budget(limit, lambda: float(next(seconds))))
    out = tmp_path / "scene.toml"
    assert softaim("tune", recording, "--scene", run[0], "--minutes", "2", "--out", out) == 0
    assert "Best result within 2 minutes, from " in capsys.readouterr().out
    assert read_scene(out).settings != FilterSettings()
