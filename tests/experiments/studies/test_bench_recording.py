"""What the benchmark of recordings does is what it says: the same work, and figures that are ratios of one run."""

import numpy as np

from dynamics import OUTER, four_mass_phantom
from experiments.studies import bench_recording


def test_figures_are_those_of_the_work_named(monkeypatch):
    """No speed is asserted: ten frames, each figure more than nothing, each ratio that of its two times."""
    monkeypatch.setattr(bench_recording, "N_ADVISED", 2)
    monkeypatch.setattr(bench_recording, "N_BY_FILTER", 1)
    frames = bench_recording.resting_frames(four_mass_phantom(), OUTER, 1e-3, 10)
    assert len(frames) == 10
    np.testing.assert_allclose(np.diff([time_s for time_s, _ in frames]), 1.0 / 30.0)
    found = bench_recording.advised(frames) | bench_recording.smoothed(frames)
    assert set(found) == {"advise_ms", "advise_by_filter_ms", "advise_ratio", "smooth_ms", "smooth_ratio"}
    assert all(value > 0.0 for value in found.values())
    np.testing.assert_allclose(found["advise_ratio"], found["advise_by_filter_ms"] / found["advise_ms"])
