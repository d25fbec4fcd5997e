"""`softaim plan`: tables, a picture, and what is said of a plan that cannot be read."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest
from matplotlib.patches import Circle, Polygon

from dynamics import HIDDEN, OUTER, four_mass_phantom
from estimators import TissueFilter
from experiments.errors import InputError
from experiments.formats.plan_file import read_task
from experiments.formats.recording import MarkRow, read_recording, write_marks_csv
from experiments.formats.scene.scene import Mark, Scene, Target, read_scene, write_scene
from experiments.pipeline.integrity import IntegrityMonitor
from experiments.pipeline.plan import next_best, planned
from experiments.pipeline.track import measurement
from experiments.plots.plan import plan_figure
from experiments.plots.space import two_views
from tests.experiments.command import softaim
from tests.experiments.formats.scene.test_mesh import folder as mesh_folder
from tests.experiments.in_space import breast
from tests.experiments.plots.printed import check_printed
from tests.experiments.rows import complaint

PLAN = """
version = 1
[needle]
gauge = 16
cutting_N = 0.6
friction_N_m = 8.0
[entry]
from_mm = [-130.0, 268.0]
to_mm = [130.0, 268.0]
normal = [0.0, 1.0]
max_angle_deg = 55.0
max_length_mm = 140.0
n = 20
[[obstacle]]
name = "rib 5"
kind = "rib"
from_mm = [-75.0, 240.0]
to_mm = [-35.0, 246.0]
radius_mm = 6.0
margin_mm = 3.0
[[obstacle]]
name = "vessel"
kind = "vessel"
centre_mm = [3.0, 222.0]
radius_mm = 4.0
margin_mm = 4.0
"""


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    marks = tuple(Mark(node, hue, 0.03) for node, hue in zip(OUTER, (0.0, 120.0, 240.0), strict=True))
    write_scene(Scene(four_mass_phantom(), marks, Target(HIDDEN, 0.008), ()), tmp_path / "scene.toml")
    return tmp_path / "scene.toml"


@pytest.fixture
def plan_file(tmp_path: Path) -> Path:
    (tmp_path / "plan.toml").write_text(PLAN)
    return tmp_path / "plan.toml"


def write_marks(folder: Path, by_m: Sequence[float], sd_m: float) -> None:
    """The table of the phantom's marks, 30 frames a second, aside by this in each."""
    phantom = four_mass_phantom()
    rows = [[MarkRow(n, phantom.positions[phantom.index(n)] + [by, 0.0], sd_m) for n in OUTER] for by in by_m]
    write_marks_csv(folder / "marks.csv", np.arange(len(by_m)) / 30.0, rows, dim=2)


def test_a_scene_is_planned_from_rest(scene, plan_file, tmp_path, capsys):
    """All paths in the table, ranked, in mm; the best of plan.json is its first row; the picture can be read."""
    out = tmp_path / "out"
    assert softaim("plan", scene, "--plan", plan_file, "--out", out, "--vector", "svg") == 0
    assert sorted(file.name for file in out.iterdir()) == [
        *("plan.csv", "plan.json", "plan.png", "plan.svg", "provenance.json", "softaim.log")
    ]
    rows = pd.read_csv(out / "plan.csv", keep_default_na=False)
    reported = json.loads((out / "plan.json").read_text())
    assert len(rows) == reported["paths"] == 100
    allowed = rows[rows["rejected"] == ""]
    assert 0 < len(allowed) == reported["allowed"] < 100
    assert (allowed.index == np.arange(len(allowed))).all()
    best = reported["best"]
    assert best["hit_probability"] == pytest.approx(rows["hit_probability"][0], abs=1e-4)
    assert best["hit_probability"] > 0.9
    assert best["entry_mm"] == pytest.approx([rows["entry_x_mm"][0], 268.0], abs=1e-2)
    reach = np.linalg.norm(np.array(best["tip_mm"]) - best["entry_mm"])
    assert best["depth_mm"] == pytest.approx(reach, abs=0.01)
    assert reported["target"]["estimate"] == "at rest"
    assert reported["target"]["cov_mm2"] == [[4.0, 0.0], [0.0, 4.0]]
    assert set(reported["rejected_by"]) == {"rib 5", "vessel", "too long", "too steep"}
    picture = cv2.imread(str(out / "plan.png"))
    assert picture.shape[1] > 400
    best_blue = (np.abs(picture.astype(int) - [0xB2, 0x72, 0x00]).max(axis=2) < 12).sum()
    assert best_blue > 50
    assert "Paths to M2" in capsys.readouterr().out


BREAST_PLAN = """\
version = 1
target_sd_mm = 1.0

[entry]
from_mm = [-30.0, -30.0, 50.0]
to_mm = [30.0, 30.0, 50.0]
normal = [0.0, 0.0, 1.0]
n = 40

[[obstacle]]
name = "vessel"
centre_mm = [-5.0, 0.0, 40.0]
radius_mm = 4.0
"""


def test_a_plan_in_space_is_seen_from_two_sides(tmp_path):
    """The best path, the lesion at arrival and the vessel stand where they are, in both views."""
    write_scene(breast(10), tmp_path / "scene.toml")
    (tmp_path / "plan.toml").write_text(BREAST_PLAN)
    done = planned(tmp_path / "scene.toml", tmp_path / "plan.toml")
    figure = plan_figure(done)
    check_printed(figure)
    best = next_best(done.plan)[0]
    for ax, view in zip(figure.axes[:2], two_views(done.scene), strict=True):
        (path,) = [line for line in ax.lines if line.get_label() == "best path"]
        ends = np.stack([done.plan.entries[best], done.plan.tips[best]])
        np.testing.assert_allclose(path.get_xydata(), view.seen_mm(ends))
        circles = {patch.get_label(): patch for patch in ax.patches if isinstance(patch, Circle)}
        lesion = circles["lesion and its 95 % region"]
        np.testing.assert_allclose(lesion.center, view.seen_mm(done.plan.means[best]))
        (vessel,) = [patch for patch in ax.patches if isinstance(patch, Polygon)]
        middle = view.seen_mm(np.array([-0.005, 0.0, 0.04]))
        np.testing.assert_allclose(np.linalg.norm(vessel.get_xy() - middle, axis=1), 4.0)
        (edges,) = [one for one in ax.collections if one.get_label() == "entry allowed"]
        assert len(edges.get_segments()) == 4


@pytest.mark.usefixtures("mesh_cache")
@pytest.mark.parametrize(("gap_mm", "stated"), [(0.5, None), (22.0, "up to 22.0 mm outside the body")])
def test_entries_in_the_air_are_reported(tmp_path, caplog, gap_mm, stated):
    """A flat box of entries above the top of the box of tetrahedra, which is at 30 mm."""
    scene = mesh_folder(tmp_path)
    at = f"{30.0 + gap_mm}]"
    ends = f"from_mm = [10.0, 5.0, {at}\nto_mm = [30.0, 25.0, {at}\nnormal = [0.0, 0.0, 1.0]\n"
    (tmp_path / "plan.toml").write_text(f"version = 1\n[entry]\n{ends}n = 4\n")
    planned(scene, tmp_path / "plan.toml")
    said = [line for line in caplog.messages if "outside the body" in line]
    assert len(said) == (stated is not None)
    assert all(stated in line and "air counts as depth" in line for line in said)


@pytest.mark.usefixtures("without_pictures")
def test_a_recording_is_planned_from_what_the_filter_says_last(scene, plan_file, tmp_path):
    """Marks that moved: mean and covariance of `TissueFilter.predict_at`, 0.2 s after the last, and default errors."""
    folder = tmp_path / "rec"
    folder.mkdir()
    scene.rename(folder / "scene.toml")
    plan_file.write_text(PLAN.replace("version = 1", "version = 1\narrival_s = 0.2"))
    write_marks(folder, [0.006 * min(1.0, k / 10) + 1e-7 * k for k in range(20)], 1e-3)
    assert softaim("plan", folder, "--plan", plan_file, "--out", tmp_path / "out") == 0
    reported = json.loads((tmp_path / "out" / "plan.json").read_text())
    tissue = TissueFilter(four_mass_phantom(), HIDDEN, OUTER)
    read = read_recording(folder)
    for t, marks in zip(read.exposures_s, read.marks, strict=True):
        tissue.predict(float(t))
        tissue.update([measurement(mark) for mark in marks])
    said = tissue.predict_at(float(read.exposures_s[-1]) + 0.2)
    assert reported["target"]["mean_mm"] == pytest.approx(1e3 * said.mean, abs=1e-3)
    unstated = IntegrityMonitor(read.scene, tissue).unstated
    assert np.trace(unstated) > 1e-6
    np.testing.assert_allclose(reported["target"]["cov_mm2"], 1e6 * (said.cov + unstated), rtol=1e-3)
    assert reported["target"]["time_s"] == pytest.approx(19 / 30 + 0.2)
    assert softaim("plan", folder, "--plan", plan_file, "--out", folder / "out") == 2


def test_another_scene_replaces_that_of_the_recording(scene, plan_file, tmp_path):
    """The marks at rest, planned with another radius of the target."""
    write_marks(tmp_path, 1e-7 * np.arange(12), 1e-3)
    other = read_scene(scene)
    write_scene(replace(other, target=Target(HIDDEN, 0.003)), tmp_path / "other.toml")
    lesions = [planned(tmp_path, plan_file, path).lesion for path in (None, tmp_path / "other.toml")]
    assert [lesion.radius_m for lesion in lesions] == [0.008, 0.003]


def test_a_fix_of_the_recording_is_taken_in(scene, plan_file, tmp_path):
    """The same marks with and without a sighting of the target 1 ms before the end, 0.5 mm an axis, 2 mm aside.

    With the bias of 1 mm that fixes may share the target moves by 1 mm at least, and is better known.
    """
    write_marks(tmp_path, 1e-7 * np.arange(12), 4e-3)
    phantom = four_mass_phantom()
    without = planned(tmp_path, plan_file).lesion
    x, y = 1e3 * phantom.positions[phantom.index(HIDDEN)]
    (tmp_path / "fixes.csv").write_text(f"time_s,x_mm,y_mm,sd_mm\n0.365,{x + 2.0},{y},0.5\n")
    reported = planned(tmp_path, plan_file).lesion
    assert reported.mean[0] - without.mean[0] > 1e-3
    assert np.trace(reported.cov) < np.trace(without.cov)


def test_nothing_is_planned_by_an_estimate_that_has_just_begun(scene, plan_file, tmp_path):
    write_marks(tmp_path, [0.0, 1e-7], 1e-3)
    with pytest.raises(InputError, match=r"that is TRACKING or COASTING, .* found INITIALISING"):
        planned(tmp_path, plan_file)


def test_a_plan_file_is_read_in_metres(plan_file):
    task = read_task(plan_file, 2)
    rib, vessel = task.obstacles
    assert (rib.radius_m, rib.margin_m, vessel.radius_m, vessel.margin_m) == (0.006, 0.003, 0.004, 0.004)
    np.testing.assert_allclose([rib.start, rib.end], [[-0.075, 0.240], [-0.035, 0.246]])
    np.testing.assert_allclose([vessel.start, vessel.end], [[0.003, 0.222]] * 2)
    assert task.kinds == ("rib", "vessel")
    assert task.needle.radius_m == pytest.approx(0.8e-3)
    assert (task.needle.reach_m, task.needle.tip_sd_m, task.target_sd_m) == (0.06, 0.001, 0.002)
    assert task.skin.max_angle_rad == pytest.approx(np.radians(55.0))


@pytest.mark.usefixtures("without_pictures")
def test_where_nothing_is_allowed_it_says_why_and_the_picture_can_be_printed(scene, plan_file, tmp_path, capsys):
    wall = '[[obstacle]]\nname = "wall"\nfrom_mm = [-300.0, 225.0]\nto_mm = [300.0, 225.0]\nradius_mm = 2.0\n'
    plan_file.write_text(PLAN + wall)
    assert softaim("plan", scene, "--plan", plan_file, "--out", tmp_path / "out") == 0
    reported = json.loads((tmp_path / "out" / "plan.json").read_text())
    assert reported["best"] is None
    assert reported["rejected_by"]["wall"] == 100
    assert "No path is allowed" in capsys.readouterr().out
    check_printed(plan_figure(planned(scene, plan_file)))


def test_the_next_best_are_other_ways(scene, plan_file):
    """Entries 10 mm apart or more, in the order of the ranking, none of them forbidden."""
    found = planned(scene, plan_file).plan
    chosen = next_best(found)
    ranks = [list(found.order).index(k) for k in chosen]
    assert len(chosen) > 1
    assert ranks == sorted(ranks)
    assert not any(found.reasons[k] for k in chosen)
    for i, k in enumerate(chosen):
        for other in chosen[:i]:
            assert np.linalg.norm(found.entries[k] - found.entries[other]) >= 0.01


@pytest.mark.parametrize(
    ("old", "new", "reported"),
    [
        ("gauge = 16", "gauge = 15", "needle: gauge: expected one of 14, 16, 18, 20, 22, found 15"),
        ("normal = [0.0, 1.0]", "normal = [0.0, 0.0]", "entry: normal: expected a direction out of the tissue"),
        ("to_mm = [130.0, 268.0]", "to_mm = [0.0, 1.0, 2.0]", "entry.to_mm: expected 2 numbers, as the scene has"),
        ("n = 20", "n = 0", "entry.n: expected 1 or more, found 0"),
        ("n = 20", "n_aims = 4", "entry: n_aims: expected an odd number, found 4"),
        ("centre_mm = [3.0, 222.0]", "to_mm = [3.0, 222.0]", "obstacle[1]: expected centre_mm, or from_mm and to_mm"),
        ('"vessel"\nkind', '"rib 5"\nkind', "obstacle[1].name: expected a unique name, found that of obstacle[0]"),
        ('kind = "rib"', 'kind = "bone"', "obstacle[0].kind: expected 'rib', 'vessel' or 'other'"),
    ],
)
def test_a_fault_is_reported_in_one_line(plan_file, old, new, reported):
    assert old in PLAN
    plan_file.write_text(PLAN.replace(old, new, 1))
    assert f"plan.toml: {reported}" in complaint(read_task, plan_file, 2)
