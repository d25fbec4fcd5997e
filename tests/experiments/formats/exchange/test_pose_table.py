"""Tables of DeepLabCut and SLEAP, as the two write them."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from experiments.errors import InputError
from experiments.formats.exchange.pose_table import PoseTable, read_poses
from tests.experiments.rows import complaint, rows

PARTS = ("nose", "left.ear")
PLACES = np.array([[[1.5, 2.5], [30.0, 40.0]], [[2.0, 3.0], [np.nan, np.nan]], [[2.5, 3.5], [31.0, 41.0]]])
LIKELIHOOD = np.array([[0.99, 0.5], [1.0, np.nan], [1e-5, 0.75]])


def check(found: PoseTable, frames: list[int]) -> None:
    assert found.parts == PARTS
    assert found.frames.tolist() == frames
    np.testing.assert_array_equal(found.places_px, PLACES)
    np.testing.assert_array_equal(found.likelihood, LIKELIHOOD)


def test_deeplabcut(tmp_path: Path) -> None:
    """Written by pandas from columns of three levels, as DeepLabCut does it."""
    names = ["scorer", "bodyparts", "coords"]
    columns = pd.MultiIndex.from_product([["DLC_resnet50"], PARTS, ["x", "y", "likelihood"]], names=names)
    values = np.concatenate([PLACES, LIKELIHOOD[:, :, None]], axis=2).reshape(3, -1)
    pd.DataFrame(values, columns=columns).to_csv(tmp_path / "poses.csv")
    check(read_poses(tmp_path / "poses.csv"), [0, 1, 2])


def sleap(path: Path, frames: list[int], order: list[int]) -> Path:
    """Written by pandas with a row an instance, in any order of frames."""
    table: dict[str, object] = {"track": None, "frame_idx": frames, "instance.score": 0.9}
    for k, part in enumerate(PARTS):
        table |= {f"{part}.x": PLACES[:, k, 0], f"{part}.y": PLACES[:, k, 1], f"{part}.score": LIKELIHOOD[:, k]}
    pd.DataFrame(table).iloc[order].to_csv(path, index=False)
    return path


@pytest.mark.parametrize("order", [[0, 1, 2], [2, 0, 1]])
def test_sleap_in_any_order_of_rows(tmp_path: Path, order: list[int]) -> None:
    check(read_poses(sleap(tmp_path / "poses.csv", [3, 4, 7], order)), [3, 4, 7])


def test_two_animals_are_refused(tmp_path: Path) -> None:
    path = sleap(tmp_path / "poses.csv", [3, 4, 4], [0, 1, 2])
    assert "row 4: frame_idx: expected each frame once: a table of one animal, found 4" in complaint(read_poses, path)


def several(path: Path, animals: dict[str, float]) -> Path:
    """A table of several animals, as DeepLabCut writes it; each is off by its own number of pixels."""
    names = ["scorer", "individuals", "bodyparts", "coords"]
    parts = {
        animal: pd.DataFrame(
            np.concatenate([PLACES + off, LIKELIHOOD[:, :, None]], axis=2).reshape(3, -1),
            columns=pd.MultiIndex.from_product([["DLC"], [animal], PARTS, ["x", "y", "likelihood"]], names=names),
        )
        for animal, off in animals.items()
    }
    pd.concat(parts.values(), axis=1).to_csv(path)
    return path


@pytest.mark.parametrize(
    ("animals", "individual"),
    [({"mouse": 0.0}, None), ({"rat": 9.0, "mouse": 0.0, "cat": 5.0}, "mouse"), ({"mouse": 0.0, "rat": 9.0}, "mouse")],
)
def test_one_of_several_animals(tmp_path: Path, animals: dict[str, float], individual: str | None) -> None:
    check(read_poses(several(tmp_path / "poses.csv", animals), individual), [0, 1, 2])


@pytest.mark.parametrize("individual", [None, "dog"])
def test_an_animal_that_is_not_named_is_asked_for(tmp_path: Path, individual: str | None) -> None:
    path = several(tmp_path / "poses.csv", {"rat": 9.0, "mouse": 0.0})
    found = f'"{individual}"' if individual else "none"
    assert f'--individual: expected one of "rat", "mouse", found {found}' in complaint(read_poses, path, individual)
    assert '--individual: expected no name for a table of one animal, found "rat"' in complaint(
        read_poses, sleap(path, [3, 4, 7], [0, 1, 2]), "rat"
    )


def test_one_of_several_tracks(tmp_path: Path) -> None:
    """Tracks of SLEAP are individuals; of one animal in pieces no name is needed."""
    path = sleap(tmp_path / "poses.csv", [3, 4, 7], [0, 1, 2])
    table = pd.read_csv(path).assign(track="left")
    other = table.assign(track="right", **{"nose.x": 99.0})
    pd.concat([other, table]).to_csv(path, index=False)
    check(read_poses(path, "left"), [3, 4, 7])
    assert '--individual: expected one of "right", "left", found none' in complaint(read_poses, path)
    table.assign(track=["left", "left", "right"]).to_csv(path, index=False)
    check(read_poses(path), [3, 4, 7])


def test_an_analysis_file_in_hdf5_is_asked_for_as_csv(tmp_path: Path) -> None:
    (tmp_path / "poses.h5").write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(100))
    with pytest.raises(InputError, match=r"poses\.h5: expected .* from an export to CSV, found an HDF5 file"):
        read_poses(tmp_path / "poses.h5")


FAULTS = r"""
scorer,a,a,a\nindividuals,m,m,m\nbodyparts,n,n,n\n | row 4: expected the row coords of DeepLabCut, found none
scorer,a,a,a\nbodyparts,n,n,n\n | row 3: expected the row coords of DeepLabCut, found none
scorer,a,a,a\nbodyparts,n,n,n\ncoords,x,y,likelihood\n | expected a row for each frame, and body parts
scorer\nbodyparts\ncoords\n0\n | expected a row for each frame, and body parts, found none
scorer,a,a\nbodyparts,n,n\ncoords,x,y\n0,1,2\n | row 3: expected x, y, likelihood of each body part
scorer,,,a,a\nbodyparts,,,n,n\ncoords,,,x,y\nl,v,i.png,1,2\n | expected x, y, likelihood of .* found a table of labels
track,frame_idx,instance.score\n,0,1\n | expected a row for each frame, and body parts, found none
track,frame_idx,n.x,n.y\n,0,1,2\n | row 1: expected a column n.score, found none
track,frame_idx,n.x,n.x,n.y,n.score\n,0,1,1,2,1\n | columns of different names, found "n.x" twice
track,frame_idx,n.x,n.y,n.score\n,0.5,1,2,1\n | row 2: frame_idx: expected a frame's number, .* found 0.5
scorer,a,a,a\nbodyparts,n,n,n\ncoords,x,y,score\n0,1,2,3\n | row 3: expected n likelihood in column 4, found "n score"
scorer,a,a,a\nbodyparts,n,n,n\ncoords,x,y,likelihood\ni.png,1,2,3\n | row 4: coords: expected a number, found "i.png"
track,frame_idx,n.x,n.y,n.p\n,0,1,2,1\n | row 1: expected columns NODE.x, NODE.y, NODE.score of SLEAP, found "n.p"
track,frame_idx,n.x,n.y,n.score\n,0,left,2,1\n | row 2: n.x: expected a number, found "left"
time_s,node\n1,M1\n | row 1: expected a table of DeepLabCut .*, found "time_s,node"
,,\n,,\n | expected a table of DeepLabCut .*, found an empty file
"""


@pytest.mark.parametrize(("text", "said"), rows(FAULTS))
def test_other_tables_are_refused(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "poses.csv").write_text(text)
    with pytest.raises(InputError, match=said):
        read_poses(tmp_path / "poses.csv")
