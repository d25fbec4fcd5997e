"""`softaim smooth`: the estimates of the smoother of the library, in the files of `softaim track`."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from estimators import TissueFilter, fixed_interval
from experiments.formats.recording import read_recording
from experiments.formats.scenario import read_scenario
from experiments.pipeline.compare import SMOOTHER, compare
from experiments.pipeline.track import measurement
from experiments.simulation.simulate import simulate
from tests.experiments.command import softaim


@pytest.fixture(scope="module")
def smoothed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("smooth")
    short = read_scenario("poked").model_copy(update={"duration_s": 1.0, "frame_interval_s": 0.05})
    simulate(short, folder / "rec", filmed=False)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("experiments.plots.style.saved", lambda *_: b"a picture")
        assert softaim("smooth", folder / "rec", "--out", folder / "out") == 0
    assert (folder / "out" / "compare.png").read_bytes() == b"a picture"
    return folder


def test_estimates_are_those_of_the_smoother(smoothed: Path) -> None:
    recording = read_recording(smoothed / "rec")
    scene = recording.scene
    tissue = TissueFilter(scene.network, scene.target.point, scene.measured_nodes, scene.settings)
    seen = [
        (float(t), [measurement(mark) for mark in marks if mark.node in scene.measured_nodes])
        for t, marks in zip(recording.exposures_s, recording.marks, strict=True)
    ]
    expected = fixed_interval(tissue, seen)
    rows = pd.read_csv(smoothed / "out" / "estimates.csv")
    np.testing.assert_allclose(rows[["x_mm", "y_mm"]], [1e3 * one.mean for one in expected], rtol=0, atol=1e-6)
    covs = [1e6 * one.cov[[0, 0, 1], [0, 1, 1]] for one in expected if one.cov is not None]
    np.testing.assert_allclose(rows[["xx", "xy", "yy"]], covs, rtol=1e-6)


def test_the_filter_stands_beside_it_and_is_less_certain(smoothed: Path) -> None:
    """Most at the start, where the filter has few marks and the smoother those of the whole second."""
    ours, filters = (pd.read_csv(smoothed / "out" / name) for name in ("estimates.csv", "estimates.filter.csv"))
    assert list(ours.columns) == list(filters.columns)
    assert (ours["xx"] + ours["yy"])[:4].mean() < 0.6 * (filters["xx"] + filters["yy"])[:4].mean()
    summary = json.loads((smoothed / "out" / "summary.json").read_text(encoding="utf-8"))
    assert list(summary) == ["open-loop", "filter", "smoother"]
    assert summary["smoother"]["mae_mm"] == pytest.approx(ours["err_mm"].mean(), rel=1e-6)


def test_progress_is_reported_all_along(smoothed: Path) -> None:
    """Of reading, tracking and smoothing, forth and back: shares rise from frame to frame to one."""
    shares: dict[str, list[float]] = {}

    def stage(name: str) -> Callable[[float], None]:
        return shares.setdefault(name, []).append

    compare(read_recording(smoothed / "rec", advance=stage("read")), [SMOOTHER], stage)
    assert shares["read"] == [1.0]
    assert len(shares["track"]) == 20
    assert len(shares["smoother"]) == 40
    assert all(reported == sorted(reported) and reported[-1] == 1.0 for reported in shares.values())
