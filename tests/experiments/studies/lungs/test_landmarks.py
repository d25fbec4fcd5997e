"""Tables of landmarks: what is read from them, and what is rejected with its place."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from experiments.errors import InputError
from experiments.studies.lungs.landmarks import read_lungs, read_person
from tests.experiments.studies.lungs.breathing import landmarks, write_case


def test_two_lungs_of_each_person_in_metres(tmp_path):
    for k in (1, 2):
        write_case(tmp_path / f"case{k}.csv", landmarks(k))
    lungs = read_lungs(tmp_path)
    assert [lung.name for lung in lungs] == ["case1 right", "case1 left", "case2 right", "case2 left"]
    places = landmarks(1)
    assert lungs[0].positions == pytest.approx(1e-3 * places[:, :20])
    assert lungs[1].positions == pytest.approx(1e-3 * places[:, 20:])
    assert lungs[0].times_s == pytest.approx([0.0, 0.4, 0.8, 1.2])


def test_hull_and_inner_landmarks_part_a_lung_and_the_seen_are_far_from_each_other(tmp_path):
    write_case(tmp_path / "case1.csv", landmarks(1))
    lung = read_person(tmp_path / "case1.csv")[0]
    assert sorted([*lung.hull, *lung.inner]) == list(range(20))
    start = lung.positions[0]
    volume = ConvexHull(start).volume
    assert ConvexHull(start[lung.hull]).volume == pytest.approx(volume)
    six = lung.seen(6)
    assert six[0] == lung.hull[0]
    assert len(set(six)) == 6
    away = np.linalg.norm(start[lung.hull] - start[six[0]], axis=1)
    assert six[1] == lung.hull[away.argmax()]
    assert list(lung.seen(None)) == list(lung.seen(99)) == list(lung.hull)


def test_rows_may_stand_in_any_order(tmp_path):
    path = tmp_path / "case1.csv"
    write_case(path, landmarks(1))
    head, *rows = path.read_text().splitlines()
    path.write_text("\n".join([head, *reversed(rows)]) + "\n")
    assert read_person(path)[0].positions == pytest.approx(1e-3 * landmarks(1)[:, :20])


def test_a_folder_without_landmarks(tmp_path):
    with pytest.raises(InputError, match=r"expected case1\.csv and others, found none"):
        read_lungs(tmp_path)
    with pytest.raises(InputError, match="found no folder"):
        read_lungs(tmp_path / "none")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("3,1,", "3,2,", "landmark 3, phase 1: expected one row, found none"),
        ("landmark,", "mark,", "row 1: expected one column landmark, found none"),
        ("5,0,", "5.5,0,", "row 7: landmark: expected a whole number, 0 or more, found 5.5"),
        ("5,0,", "5,-1,", "row 7: phase: expected a whole number, 0 or more, found -1"),
    ],
)
def test_faults_are_named_with_their_place(tmp_path, old, new, message):
    path = tmp_path / "case1.csv"
    write_case(path, landmarks(1))
    lines = path.read_text().splitlines()
    row = next(k for k, line in enumerate(lines) if line.startswith(old))
    lines[row] = new + lines[row].removeprefix(old)
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError, match=message):
        read_person(path)


def test_what_spans_no_volume_or_has_no_inside_is_rejected(tmp_path):
    path = tmp_path / "case1.csv"
    write_case(path, landmarks(1) * [1.0, 0.0, 1.0])
    with pytest.raises(InputError, match="right lung: expected landmarks that span a volume"):
        read_person(path)
    write_case(path, landmarks(1)[:, [0, 1, 2, 3, 20, 21, 22, 23]])
    with pytest.raises(InputError, match="right lung: expected landmarks inside its hull"):
        read_person(path)
    write_case(path, landmarks(1)[:1])
    with pytest.raises(InputError, match="phase: expected two phases or more, found one"):
        read_person(path)
