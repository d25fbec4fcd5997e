"""What benchmarks do is what they say: the same work, ratios of one run, the cost by the size of a mesh."""

import numpy as np
from rich.console import Console

from dynamics import OUTER, four_mass_phantom
from experiments.commands.console import bench_table
from experiments.studies import bench_recording
from experiments.studies.scaling import picture, row, table


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


def test_a_row_has_what_users_read(capsys):
    found = row(4, 3)
    assert {"nodes": 100, "elements": 288, "marks": 40}.items() <= found.items()
    assert all(found[key] > 0.0 for key in ("ms_per_estimate", "prepare_s", "cached_s", "memory_mb"))
    Console(width=200).print(bench_table({"scaling": [found], "detect": {"ratio": 2.0}}))
    shown = capsys.readouterr().out
    assert "ms_per_estimate, 100 nodes" in shown
    assert "ratio" in shown
    assert table([found]).splitlines()[-1].startswith("| 100 | ")
    [ax] = picture([found, {**found, "nodes": 200, "ms_per_estimate": 9.0}]).axes
    np.testing.assert_array_equal(ax.lines[0].get_xydata(), [[100.0, found["ms_per_estimate"]], [200.0, 9.0]])
