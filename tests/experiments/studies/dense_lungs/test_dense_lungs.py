"""Dense lungs whose displacement is known: their tables and faults, the methods, the study's files."""

import itertools
import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from dynamics.mesh import far_apart
from experiments.errors import InputError
from experiments.studies.dense_lungs import __main__ as study
from experiments.studies.dense_lungs import methods
from experiments.studies.dense_lungs.__main__ import COUNTS, WORDS, main, markdown, nested, table_of
from experiments.studies.dense_lungs.methods import (
    METHODS,
    SCATTER_M,
    Body,
    Found,
    Task,
    by_field,
    by_filter,
    read_lungs,
    read_person,
)

HEAD = "landmark,x0_mm,y0_mm,z0_mm,x1_mm,y1_mm,z1_mm"


def landmarks(seed: int, n: int = 150) -> np.ndarray:
    """Two ellipsoids of landmarks 150 mm apart along x [mm], (2 n, 3)."""
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(2 * n, 3))
    radii = rng.uniform(0.0, 1.0, (2 * n, 1)) ** (1.0 / 3.0)
    points = directions / np.linalg.norm(directions, axis=1, keepdims=True) * radii * [50.0, 60.0, 90.0]
    points[n:, 0] += 200.0
    return np.round(points + np.full(3, 100.0), 3)


def exhaled(points: np.ndarray) -> np.ndarray:
    """Where they move [mm], (n, 3): upwards, more towards the bottom, less towards the back; the waist narrows."""
    x, y, z = points.T
    depth = z / 190.0
    return np.column_stack([x, y + 2.0 * np.sin(np.pi * depth), z - 10.0 * depth**2 * (1.0 - y / 400.0)])


def write_case(path: Path, before: np.ndarray, after: np.ndarray) -> None:
    """A table of landmarks [mm], (n, 3) each, as the study reads it."""
    rows = [HEAD]
    for k, places in enumerate(np.hstack([before, after])):
        rows.append(",".join([str(k), *(f"{value:.3f}" for value in places)]))
    path.write_text("\n".join(rows) + "\n")


def written(folder, points=None):
    before = landmarks(1) if points is None else points
    write_case(folder / "case1.csv", before, exhaled(before))
    return folder / "case1.csv"


def test_two_lungs_of_each_person_in_metres(tmp_path):
    for k in (1, 2):
        write_case(tmp_path / f"person{k}.csv", landmarks(k), exhaled(landmarks(k)))
    lungs = read_lungs(tmp_path)
    assert [lung.name for lung in lungs] == ["person1 right", "person1 left", "person2 right", "person2 left"]
    assert lungs[3].inhaled == pytest.approx(1e-3 * landmarks(2)[150:])
    assert lungs[3].exhaled == pytest.approx(1e-3 * exhaled(landmarks(2)[150:]), abs=1e-6)


def test_depth_is_the_distance_to_the_hull_by_the_longest_axis(tmp_path):
    """Boxes of 10 x 20 x 40 mm with a point in each, 2 and 4 mm from the nearest wall: a twentieth, a tenth of 40."""
    corners = np.array([[x, y, z] for x in (0, 10) for y in (0, 20) for z in (0, 40)], dtype=float)
    inside = np.array([[2.0, 10.0, 20.0], [4.0, 10.0, 20.0]])
    box = np.vstack([corners, inside])
    lung = read_person(written(tmp_path, np.vstack([box, box + np.array([100.0, 0.0, 0.0])])))[1]
    assert lung.depth == pytest.approx([0.0] * 8 + [0.05, 0.1], abs=1e-9)
    assert list(lung.hidden) == [9]


def test_marks_are_near_the_hull_and_hidden_landmarks_deep(tmp_path):
    lung = read_person(written(tmp_path))[0]
    assert list(lung.hidden) == list(np.flatnonzero(lung.depth > 0.075))
    marks, front = lung.marks(20, "all"), lung.marks(20, "front")
    assert len(set(marks)) == len(set(front)) == 20
    assert lung.depth[[*marks, *front]].max() <= 0.03
    assert lung.inhaled[front, 1].min() > np.median(lung.inhaled[:, 1]) > lung.inhaled[marks, 1].min()


def test_each_mark_is_the_farthest_from_those_before_it():
    line = np.array([[0.0], [1.0], [2.0], [5.0], [9.0]])
    assert list(far_apart(line, 3)) == [0, 4, 3]
    assert list(far_apart(line, 4, np.array([2, 4]))) == [2, 4, 3, 0]
    assert len(far_apart(line, 9)) == 5


def test_a_folder_without_tables(tmp_path):
    with pytest.raises(InputError, match=r"expected tables of landmarks, case1\.csv and others, found none"):
        read_lungs(tmp_path)
    with pytest.raises(InputError, match="found no folder"):
        read_lungs(tmp_path / "none")


def test_a_landmark_that_is_there_twice_is_named_with_its_place(tmp_path):
    path = written(tmp_path)
    path.write_text(path.read_text().replace("\n6,", "\n2,"))
    with pytest.raises(InputError, match="row 8: landmark: expected each landmark once, found 2"):
        read_person(path)


def test_what_spans_no_volume_or_has_no_inside_is_rejected(tmp_path):
    points = landmarks(1)
    with pytest.raises(InputError, match="right lung: expected landmarks that span a volume"):
        read_person(written(tmp_path, points * [1.0, 0.0, 1.0]))
    few = [0, 1, 2, 3, 150, 151, 152, 153]
    with pytest.raises(
        InputError, match=r"right lung: expected landmarks deeper than 7\.5 % of the extent, found none"
    ):
        read_person(written(tmp_path, points[few]))
    with pytest.raises(InputError, match="expected rows of two lungs, found 1"):
        read_person(written(tmp_path, points[:1]))


def task(folder, moved=exhaled, n=20, n_landmarks=150):
    before = landmarks(1, n_landmarks)
    write_case(folder / "case1.csv", before, moved(before))
    lung = read_person(folder / "case1.csv")[0]
    return Task(lung, lung.marks(n, "all"))


def errors(given, found):
    return 1e3 * np.linalg.norm(found.means - given.lung.exhaled[given.lung.hidden], axis=1)


def affine(points):
    return points @ np.diag([1.0, 0.99, 0.95]) + [2.0, 0.0, -5.0]


@pytest.mark.parametrize("method", ["thin_plate", "linear", "field"])
def test_interpolations_follow_an_affine_motion(tmp_path, method):
    """Splines exactly but for the rounding of the file; the field to a fraction of the scatter that it assumes."""
    given = task(tmp_path, affine)
    assert errors(given, METHODS[method](given)).max() < (0.1 if method == "field" else 2e-3)


def test_hidden_landmarks_lie_between_their_nodes(tmp_path):
    given = task(tmp_path)
    body = Body.of(given)
    assert body.network.positions[:20] == pytest.approx(given.before)
    assert body.rows() @ body.network.positions == pytest.approx(given.wanted)
    assert body.weights.min() >= -1e-9
    point = body.point(3)
    nodes = [body.network.positions[body.network.index(name)] for name in point.nodes]
    assert point.weights @ np.array(nodes) == pytest.approx(given.wanted[3])


def test_the_field_is_the_conditional_normal_distribution(tmp_path, monkeypatch):
    """At the only level of 1 mm, by the joint covariance of marks and hidden landmarks; the trend by its functions."""
    monkeypatch.setattr(methods, "LEVELS_M", np.array([1e-3]))
    given = task(tmp_path)
    points = np.vstack([given.before, given.wanted])
    r = np.sqrt(3.0) * np.linalg.norm(points[:, None] - points, axis=2) / 0.06
    functions = np.column_stack([np.ones(len(points)), (points - given.before.mean(axis=0)) / 0.1])
    joint = functions @ functions.T + 1e-6 * (1.0 + r) * np.exp(-r)
    n = len(given.before)
    gain = np.linalg.solve(joint[:n, :n] + SCATTER_M**2 * np.eye(n), joint[:n, n:]).T
    found = by_field(given)
    assert found.means == pytest.approx(given.wanted + gain @ (given.after - given.before), abs=1e-9)
    variances = (joint[n:, n:] - gain @ joint[:n, n:]).diagonal()
    assert found.covs[:, 1, 1] == pytest.approx(variances, rel=1e-6)


def test_the_filter_follows_a_displacement_that_it_does_not_know(tmp_path):
    """Hidden landmarks move by more than 2 mm in the mean; the estimate is within half the scatter of an axis."""
    given = task(tmp_path, n_landmarks=100)
    found = by_filter(given)
    truth = given.lung.exhaled[given.lung.hidden]
    assert 1e3 * np.linalg.norm(given.wanted - truth, axis=1).mean() > 2.0
    assert errors(given, found).mean() < 0.3
    assert found.covs is not None
    off = found.means - truth
    nees = np.einsum("ij,ij->i", off, np.linalg.solve(found.covs, off[..., None])[..., 0])
    assert (nees <= 7.81).mean() >= 0.9


def test_a_row_has_means_over_all_lungs_and_nothing_of_a_method_that_failed():
    found = [("right", 1.0, 1.0), ("right", 2.0, 1.0), ("right", 3.0, 1.0), ("left", 4.0, 9.0)]
    runs = pd.DataFrame(
        [
            {"where": where, "marks": marks, "method": method, "lung": lung, "error_mm": error, "nees": nees}
            for where, marks, method in itertools.product(("all", "front"), COUNTS, WORDS)
            for lung, error, nees in found
        ]
    )
    runs.loc[~runs["method"].isin(["filter", "field"]), "nees"] = np.nan
    failed = runs["method"].isin(["open_loop", "field"]) & (runs["lung"] == "left")
    runs.loc[failed, ["error_mm", "nees"]] = np.nan
    table = table_of(runs)
    rows = nested(table)
    assert [(row["where"], row["marks"]) for row in rows] == [
        (w, n) for w in ("all", "front") for n in (10, 20, 40, 80)
    ]
    found = rows[5]["methods"]
    assert found["filter"] == {"mae_mm": pytest.approx(2.5), "coverage95": 0.75, "n": 4}
    assert found["thin_plate"] == {"mae_mm": pytest.approx(2.5), "coverage95": None, "n": 4}
    assert found["open_loop"] == found["field"] == {"mae_mm": None, "coverage95": None, "n": 4}
    assert markdown(table).splitlines()[2] == "| 10, all | 2.50 | 2.50 | 2.50 |  |  | 2.50 | 75.0% |  |"


@pytest.fixture
def tables(tmp_path, monkeypatch):
    """A folder of one person; methods that leave every landmark where it was, the first with 2 mm an axis."""

    def still(task):
        return Found(task.wanted)

    def unsure(task):
        return Found(task.wanted, np.tile(4e-6 * np.eye(3), (len(task.wanted), 1, 1)))

    monkeypatch.setattr(study, "METHODS", {name: unsure if name == "filter" else still for name in METHODS})
    folder = tmp_path / "tables"
    folder.mkdir()
    write_case(folder / "case1.csv", landmarks(1), exhaled(landmarks(1)))
    return folder


def test_the_study_writes_its_files(tables, tmp_path, capsys):
    assert main([str(tables), "--out", str(tmp_path / "out"), "--processes", "1"]) == 0
    out = tmp_path / "out"
    assert sorted(path.name for path in out.iterdir()) == ["rows.csv", "summary.json", "table.md"]
    assert capsys.readouterr().out == (out / "table.md").read_text()
    content = json.loads((out / "summary.json").read_text())
    assert content["lungs"] == ["case1 right", "case1 left"]
    found = content["rows"][0]["methods"]
    assert found["filter"]["mae_mm"] == pytest.approx(found["none"]["mae_mm"]) != 0.0
    assert found["filter"]["coverage95"] == 1.0
    assert found["thin_plate"]["coverage95"] is None
    rows = pd.read_csv(out / "rows.csv")
    assert len(rows) == 8 * len(WORDS)
    assert rows["mae_mm"][0] == pytest.approx(found["filter"]["mae_mm"])


def test_a_method_that_fails_is_named(tables, tmp_path, capsys, monkeypatch):
    def failing(task):
        raise ValueError("no such tissue")

    monkeypatch.setitem(study.METHODS, "field", failing)
    assert main([str(tables), "--out", str(tmp_path / "out"), "--processes", "1"]) == 1
    assert "case1 left, 80 marks, front: field: ValueError: no such tissue\n" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["none"], "none: expected tables of landmarks, case1.csv and others, found no folder"),
        (["tables", "--stiffness-factor", "0"], "--stiffness-factor: expected a finite number above 0, found 0"),
    ],
)
def test_faults_are_one_line_and_nothing_is_written(tables, tmp_path, capsys, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    assert main([*arguments, "--out", "out"]) == 2
    assert capsys.readouterr().err == f"{message}\n"
    assert not (tmp_path / "out").exists()


def test_results_do_not_go_into_the_folder_of_the_tables(tables, capsys):
    assert main([str(tables), "--out", str(tables / "out")]) == 2
    assert "a folder apart from" in capsys.readouterr().err
