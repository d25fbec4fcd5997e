"""The files of a picture: of one size, the same each time, beside each other."""

import cv2
import numpy as np
import pytest
from matplotlib.figure import Figure

from experiments.plots.series import spans_of
from experiments.plots.style import COLUMN_MM, PAGE_MM, STYLE, grid_figure, styled, write_picture


@styled
def drawn() -> Figure:
    """A line of ten points, with words."""
    figure, axes = grid_figure(COLUMN_MM, 50.0)
    axes[0, 0].plot(np.arange(10.0), label="a line")
    axes[0, 0].set(xlabel="time [s]", ylabel="y [mm]")
    return figure


def test_a_column_of_print_at_300_dots_an_inch(tmp_path):
    """85 mm are 1004 dots, 170 mm 2008, 50 mm 591."""
    assert write_picture(drawn(), tmp_path / "a.png") == [tmp_path / "a.png"]
    assert cv2.imread(str(tmp_path / "a.png")).shape[:2] == pytest.approx((591, 1004), abs=1)
    assert PAGE_MM == 2 * COLUMN_MM == 170.0
    assert [path.name for path in tmp_path.iterdir()] == ["a.png"]


@pytest.mark.parametrize(("form", "starts"), [("pdf", b"%PDF"), ("svg", b"<?xml")])
def test_a_vector_file_stands_beside_and_has_no_date(tmp_path, form, starts):
    """Two pictures made one after the other are the same bytes."""
    for name in ("a", "b"):
        written = write_picture(drawn(), tmp_path / f"{name}.png", form)
        assert [path.name for path in written] == [f"{name}.png", f"{name}.{form}"]
    content = (tmp_path / f"a.{form}").read_bytes()
    assert content.startswith(starts)
    assert b"CreationDate" not in content
    assert b"dc:date" not in content
    assert content == (tmp_path / f"b.{form}").read_bytes()
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_the_style_holds_within_the_house_and_not_beyond():
    before = Figure().subplots().xaxis.label.get_fontsize()
    ax = drawn().axes[0]
    assert ax.xaxis.label.get_fontsize() == STYLE["axes.labelsize"] == 7.0
    assert not ax.spines["top"].get_visible()
    assert Figure().subplots().xaxis.label.get_fontsize() == before != 7.0


def test_spans_reach_half_way_to_the_frames_beside():
    times = np.array([0.0, 1.0, 2.0, 4.0])
    assert spans_of(times, [True, False, True, True]) == [(0.0, 0.5), (1.5, 2.5)]
    assert spans_of(times, [False] * 4) == []
    assert spans_of(times[:1], [True]) == []
