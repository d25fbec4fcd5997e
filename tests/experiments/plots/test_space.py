"""Views of a body in space: faces towards the viewer, far ones first; names apart; scale and axes of the body."""

import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from experiments.formats.scene.outside import outside_of
from experiments.formats.scene.scene import read_scene
from experiments.plots.space import (
    DIM,
    N_FACES,
    SKIN,
    draw_body,
    draw_springs,
    draw_surface,
    draw_target,
    facing,
    frame,
    keys,
    name_places,
    scale_bar,
    two_views,
    view_from,
)
from tests.experiments.formats.scene.test_mesh import folder
from tests.experiments.in_space import dome
from tests.experiments.plots.tracks import block

pytestmark = pytest.mark.usefixtures("mesh_cache")

CUBE = np.array([(i, j, k) for i in (0, 1) for j in (0, 1) for k in (0, 1)], dtype=float)


def empty_axes():
    return Figure().subplots()


def test_views_are_orthonormal_and_right_handed() -> None:
    for turn in (35.0, -145.0):
        view = view_from(turn)
        axes = np.vstack([view.across, view.toward])
        np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(axes) == pytest.approx(1.0)
        assert view.across[1] @ [0.0, 1.0, 0.0] > 0.9  # y is up


def test_a_legend_names_what_is_drawn_of_a_body(tmp_path) -> None:
    mesh = read_scene(folder(tmp_path))
    shown = set(keys(mesh, outside_of(mesh, N_FACES), two_views(mesh)))
    assert {"surface at rest", "marks"} <= shown
    assert not {"springs as drawn", "anchors", "marks for scoring only"} & shown
    shown = set(keys(block(), outside_of(block(), N_FACES), two_views(block())))
    assert {"convex hull", "springs as drawn", "anchors"} <= shown


def test_faces_towards_the_viewer_are_drawn_the_nearest_last_and_brighter_towards_the_lamp() -> None:
    """Of the faces of a block; a face is as bright as the lamp, left and up of the viewer, and its corners make it."""
    outside, ax, view = outside_of(block(), N_FACES), empty_axes(), view_from(35.0)
    draw_surface(ax, view, outside)
    (drawn,) = [one for one in ax.collections if isinstance(one, PolyCollection)]
    near = np.flatnonzero(outside.normals @ view.toward > 0.0)
    assert len(drawn.get_paths()) == len(near) < len(outside.faces)
    middles = outside.corners[outside.faces[near]].mean(axis=1)
    ordered = middles[np.argsort(middles @ view.toward)]
    found = np.array([path.vertices[:3].mean(axis=0) for path in drawn.get_paths()])
    np.testing.assert_allclose(found, view.seen_mm(ordered), atol=1e-6)
    shades = drawn.get_facecolor()[:, 0] / SKIN[0]
    assert DIM <= shades.min() < shades.max() <= 1.0
    assert found[shades.argmax(), 1] - found[shades.argmax(), 0] > found[shades.argmin(), 1] - found[shades.argmin(), 0]


def test_near_springs_are_drawn_last_and_darker() -> None:
    ax, view = empty_axes(), view_from(35.0)
    places = np.array([[0.0, 0.0, 0.0], [0.01, 0.0, 0.0]])
    four = np.vstack([places + 0.1 * view.toward, places])
    draw_springs(ax, view, four, np.array([[0, 1], [2, 3]]))
    (lines,) = ax.collections
    np.testing.assert_allclose(lines.get_segments(), view.seen_mm(four[[[2, 3], [0, 1]]]), atol=1e-9)
    far, near = lines.get_colors()[:, 0]
    assert far > near + 0.3
    assert lines.get_linewidths()[0] < lines.get_linewidths()[1]


@pytest.mark.parametrize(("reach", "length"), [(1000.0 / 3.0, 50.0), (1.0 / 3.0, 0.05), (400.0, 100.0), (90.0, 20.0)])
def test_a_scale_bar_is_of_a_quarter_of_the_reach(reach, length) -> None:
    """Also where 0.3 of it lies a rounding below a power of ten."""
    ax = empty_axes()
    ax.set(xlim=(0.0, reach), ylim=(0.0, reach))
    scale_bar(ax, reach)
    assert np.ptp(ax.lines[-1].get_xdata()) == pytest.approx(length)
    assert ax.texts[-1].get_text() == f"{length:g} mm"


def test_each_mark_on_the_near_side_has_one_name_and_names_keep_apart() -> None:
    """Sixty marks on a dome: only the names of near ones, and hardly any two overlap in a picture of 60 mm."""
    scene = dome()
    view = two_views(scene)[0]
    ax = empty_axes()
    draw_body(ax, view, scene, outside_of(scene, N_FACES), 60.0)
    names = [mark.node for mark, near in zip(scene.marks, facing(view, scene), strict=True) if near]
    assert 20 < len(names) < 60
    assert sorted(text.get_text() for text in ax.texts if text.get_text().startswith("S")) == sorted(names)
    dots = [line for line in ax.lines if line.get_marker() == "o"]
    assert len(dots) == 60
    assert sum(line.get_markersize() > 3.0 for line in dots) == len(names)


def test_names_avoid_marks_and_each_other() -> None:
    """Ten marks 4 mm apart in print: no name covers a mark or another name."""
    places = np.column_stack([4.0 * np.arange(10.0), np.zeros(10)])
    names = [f"M{k}" for k in range(10)]
    corners = name_places(places, names, 1.0)
    sizes = np.array([[0.6 + 1.3 * len(name), 2.1] for name in names])
    boxes = np.stack([corners, corners + sizes], axis=1)
    for k, (low, high) in enumerate(boxes):
        for other_low, other_high in np.delete(boxes, k, axis=0):
            assert not ((low < other_high - 1e-9) & (other_low < high - 1e-9)).all()
        assert not ((places > low) & (places < high)).all(axis=1).any()


def test_the_frame_holds_the_body_with_a_bar_of_its_stated_length() -> None:
    ax, view = empty_axes(), view_from(35.0)
    frame(ax, view, 0.1 * CUBE)
    at = view.seen_mm(0.1 * CUBE)
    (left, right), (bottom, top) = ax.get_xlim(), ax.get_ylim()
    assert left < at[:, 0].min() < at[:, 0].max() < right
    assert bottom < at[:, 1].min() < at[:, 1].max() < top
    bar, *axes = (line.get_xydata() for line in ax.lines)
    assert f"{bar[1, 0] - bar[0, 0]:g} mm" == ax.texts[0].get_text() == "20 mm"
    assert [text.get_text() for text in ax.texts[1:]] == ["x", "y", "z"]
    for line, way in zip(axes, view.across.T, strict=True):
        step = line[1] - line[0]
        up = np.linalg.norm(axes[1][1] - axes[1][0]), np.linalg.norm(view.across[:, 1])
        np.testing.assert_allclose(step / up[0], way / up[1])


def test_an_ellipsoid_is_drawn_by_its_outline() -> None:
    """2 sigma of 1, 2 and 3 mm: the outline reaches 2 sqrt(u' P u) to the right and up, for each direction u."""
    ax, view = empty_axes(), view_from(-55.0)
    cov = np.diag([1e-6, 4e-6, 9e-6])
    draw_target(ax, view, np.array([0.01, 0.02, 0.03]), 5e-3, cov)
    _, outline = ax.patches
    points = ax.transData.inverted().transform(outline.get_verts()) - view.seen_mm(np.array([0.01, 0.02, 0.03]))
    for axis in range(2):
        reach = 2e3 * np.sqrt(view.across[axis] @ cov @ view.across[axis])
        assert points[:, axis].max() == pytest.approx(reach, rel=0.01)
