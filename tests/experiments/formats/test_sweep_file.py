"""Sweep files: what a grid comes to, and one clear error for each fault."""

import pytest

from experiments.formats.scenario import read_scenario
from experiments.formats.sweep_file import read_sweep
from tests.experiments.rows import complaint, rows

HEAD = 'version = 1\nscenario = "poked"\n'
GRID = """
seeds = 3
first_seed = 7
[grid]
scenario.duration_s = [2, 4.0]
scenario.pokes.acceleration_m_s2 = [5.0]
scenario.pokes.pause_s = [0.5]
marks.sd_mm = [0.5]
filter.poke_m_s2 = [1.0, 3.0]
model.stiffness = [1.25]
"""


def swept(folder, text):
    path = folder / "study.toml"
    path.write_text(text, encoding="utf-8")
    return read_sweep(path)


def test_a_grid_is_every_combination_in_order(tmp_path):
    sweep = swept(tmp_path, HEAD + GRID)
    assert [(s.scenario.duration_s, s.filter.poke_m_s2) for s in sweep.setups] == [(2, 1), (2, 3), (4, 1), (4, 3)]
    assert sweep.keys[:2] == ("scenario.duration_s", "scenario.pokes.acceleration_m_s2")
    assert list(sweep.seeds) == [7, 8, 9]
    first, shipped = sweep.setups[0], read_scenario("poked")
    assert first.scenario.pokes.acceleration_m_s2 == 5.0
    assert first.scenario.pokes.pause_s == 0.5
    assert first.scenario.pokes.nodes == shipped.pokes.nodes
    assert (first.marks.sd_mm, first.marks.lost) == (0.5, 0.0)
    assert first.model.stiffness == 1.25


def test_without_a_grid_there_is_one_combination_with_the_usual_values(tmp_path):
    sweep = swept(tmp_path, HEAD)
    assert len(sweep.setups) == 1
    assert sweep.setups[0].scenario == read_scenario("poked")
    assert sweep.setups[0].marks.sd_mm == 4.14
    assert (sweep.methods, len(sweep.seeds), sweep.scene) == (("filter",), 20, None)


def test_files_are_beside_the_sweep(tmp_path):
    text = 'version = 1\ntitle = "x"\nphantom = "four-mass"\nseed = 1\nduration_s = 3.0\nframe_interval_s = 0.1\n'
    text += "[camera]\nsize_px = [640, 480]\nmm_per_px = [4.0, 4.0]\n"
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    sweep = swept(tmp_path, 'version = 1\nscenario = "mine.toml"\nscene = "body.toml"\n')
    assert sweep.setups[0].scenario.duration_s == 3.0
    assert sweep.scene == tmp_path / "body.toml"


FAULTS = r"""
sedes = 3 | sedes: expected one of version, scenario, scene, methods, seeds, first_seed, grid, found
seeds = 0 | seeds: expected 1 or more, found 0
grid = 3 | grid: expected
[grid]\nmarks.sd_mm = [] | grid.marks.sd_mm: expected a list of one or more values, found []
[grid]\nmarks.sd = [1.0] | grid.marks.sd: expected one of sd_mm, lost, outliers, found an unknown
[grid]\nnoise = [1.0] | grid.noise: expected one of scenario, filter, marks, model, found an
[grid]\nscenario.seed = [1] | grid.scenario.seed: expected one of duration_s,
[grid]\nscenario.pokes.pause_s = ["x"] | grid.scenario.pokes.pause_s: expected a number, found "x"
[grid]\nscenario.release.force_n = [[1.0, 0.0]] | grid.scenario.release.node: expected this key
[grid]\nmodel.stiffness = [0] | grid.model.stiffness: expected more than 0, found 0
seeds = 2000000 | grid: expected at most 1000000 runs, found 2000000
"""
OTHERS = [
    ("scenario = 3", "version: expected 1, found none"),
    ("version = 1\nscenario = 3", "scenario: expected text in quotes, found 3"),
    (HEAD.replace("poked", "nobody"), "scenario: expected one of"),
    ("version = [", "line 1: expected TOML"),
]


@pytest.mark.parametrize(("text", "fault"), [*((HEAD + text, fault) for text, fault in rows(FAULTS)), *OTHERS])
def test_each_fault_is_one_line_with_its_key(tmp_path, text, fault):
    assert complaint(swept, tmp_path, text).startswith(f"{tmp_path / 'study.toml'}: {fault}")
