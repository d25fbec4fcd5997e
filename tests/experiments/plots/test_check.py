"""The picture of a check: names in the plane, marks' names in space, limits that show both shapes."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.patches import Polygon
from matplotlib.text import Annotation

from experiments.formats.scene.scene import write_scene
from experiments.plots import check as check_plot
from experiments.plots.check import check_figure
from experiments.plots.space import facing, two_views
from experiments.projects.check import SceneCheck, checked
from experiments.projects.project import Kind, project
from tests.experiments.plots.printed import check_printed, labels
from tests.experiments.projects.test_check import hanging
from vision import fronto_parallel_camera


def names_in(ax) -> list[str]:
    return [text.get_text() for text in ax.texts if isinstance(text, Annotation)]


def test_a_flat_body_is_shown_with_its_names_and_both_shapes(tmp_path) -> None:
    write_scene(hanging(), tmp_path / "scene.toml")
    done = checked(tmp_path / "scene.toml")
    figure = check_figure(done)
    check_printed(figure)
    body, shares = figure.axes
    assert sorted(names_in(body)) == ["M", "T", "hook"]
    low, high = body.get_ylim()
    assert low < 1e3 * done.rest[:, 1].min()
    assert high > 0.0
    assert "largest difference 7.4 mm (M)" in body.get_title(loc="left")
    assert [label.get_text() for label in shares.get_yticklabels()] == ["M"]


def test_the_edge_of_the_picture_is_drawn_where_the_camera_sees(tmp_path) -> None:
    camera = fronto_parallel_camera("front", (640, 480), (1.0, 1.0), (0.1, -0.1))
    write_scene(replace(hanging(), cameras=(camera,)), tmp_path / "scene.toml")
    body = check_figure(checked(tmp_path / "scene.toml")).axes[0]
    (edge,) = [patch for patch in body.patches if isinstance(patch, Polygon)]
    np.testing.assert_allclose(edge.get_xy()[:2], [[-219.5, 139.5], [419.5, 139.5]])
    assert body.get_xlim()[1] > 419.5


@pytest.fixture(scope="module")
def done(tmp_path_factory) -> SceneCheck:
    """The check of a breast of ten masses, six of them seen."""
    path = tmp_path_factory.mktemp("breast") / "scene.toml"
    write_scene(project(Kind.BREAST, masses=10).assumed, path)
    return checked(path, sd_mm=0.5)


def test_a_body_in_space_is_seen_from_two_sides(done) -> None:
    """Labels are those of measured marks on the near side; the body rests as drawn, so rest is not drawn again."""
    figure = check_figure(done)
    check_printed(figure)
    *bodies, shares = figure.axes
    assert len(bodies) == 2
    for ax, view in zip(bodies, two_views(done.scene), strict=True):
        near = facing(view, done.scene)
        names = {mark.node for mark, is_near in zip(done.scene.marks, near, strict=True) if is_near and mark.measured}
        assert {text.get_text() for text in ax.texts} - {"x", "y", "z", "20 mm"} == names
        assert len(springs_in(ax)) == 1
    assert bodies[0].get_title(loc="left") == "rests as drawn"
    assert "springs at rest" not in labels(figure)
    assert len(shares.patches) == 6
    assert np.isclose(sum(bar.get_width() for bar in shares.patches), 100.0)


def test_bars_of_the_largest_shares_only_are_announced(done, monkeypatch: pytest.MonkeyPatch) -> None:
    assert check_figure(done).axes[-1].get_title(loc="left") == "information by mark"
    monkeypatch.setattr(check_plot, "N_BARS", 4)
    figure = check_figure(done)
    check_printed(figure)
    assert figure.axes[-1].get_title(loc="left") == "information by mark\nlargest 4 of 6"


def springs_in(ax) -> list[LineCollection]:
    return [one for one in ax.collections if isinstance(one, LineCollection)]


def test_a_sag_in_space_is_drawn_beside_the_drawn_shape(done) -> None:
    """All nodes 40 mm lower at rest: springs of both, within the limits, and the difference in the title."""
    rest = done.rest + np.where(done.scene.network.fixed[:, None], 0.0, [0.0, -0.04, 0.0])
    figure = check_figure(replace(done, rest=rest))
    ax, view = figure.axes[0], two_views(done.scene)[0]
    drawn, sagged = springs_in(ax)
    segments = np.array(sagged.get_segments())
    assert len(segments) == len(drawn.get_segments()) == len(done.scene.network.springs)
    expected = view.seen_mm(rest[done.scene.network.springs])
    np.testing.assert_allclose(np.sort(segments, axis=0), np.sort(expected, axis=0), atol=1e-9)
    assert segments[..., 1].min() > ax.get_ylim()[0]
    assert "largest difference 40.0 mm" in ax.get_title(loc="left")
    assert "springs at rest" in labels(figure)
