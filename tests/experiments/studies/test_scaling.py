"""What an estimate costs by the size of a mesh."""

import numpy as np
from rich.console import Console

from experiments.commands.console import bench_table
from experiments.studies.scaling import picture, row, table


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
