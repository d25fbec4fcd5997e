"""Tables of dense landmarks: what is read from them, which are marks, and what is rejected with its place."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from dynamics.mesh import far_apart
from experiments.errors import InputError
from experiments.studies.dense_lungs.data import read_lungs, read_person
from tests.experiments.studies.dense_lungs.displaced import exhaled, landmarks, write_case


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
    planes = ConvexHull(lung.inhaled).equations
    depth = -(lung.inhaled @ planes[:, :3].T + planes[:, 3]).max(axis=1)
    extent = np.ptp(lung.inhaled, axis=0).max()
    assert list(lung.hidden) == list(np.flatnonzero(depth > 0.075 * extent))
    marks, front = lung.marks(20, "all"), lung.marks(20, "front")
    assert len(set(marks)) == len(set(front)) == 20
    assert depth[[*marks, *front]].max() <= 0.03 * extent
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


@pytest.mark.parametrize(
    ("row", "column", "entry", "message"),
    [
        (0, 0, "mark", "row 1: expected one column landmark, found none"),
        (3, 2, "", "row 4: y0_mm: expected a finite number, found none"),
        (3, 5, "nan", "row 4: y1_mm: expected a finite number, found"),
        (7, 0, "2", "row 8: landmark: expected each landmark once, found 2"),
    ],
)
def test_faults_are_named_with_their_place(tmp_path, row, column, entry, message):
    path = written(tmp_path)
    lines = [line.split(",") for line in path.read_text().splitlines()]
    lines[row][column] = entry
    path.write_text("\n".join(map(",".join, lines)) + "\n")
    with pytest.raises(InputError, match=message):
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
