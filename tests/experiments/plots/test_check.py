"""The picture of a check: every node named in the plane, hidden ones of a view not, limits that show both shapes."""

import numpy as np
from matplotlib.text import Annotation

from experiments.formats.scene.scene import write_scene
from experiments.plots.check import check_figure
from experiments.projects.check import checked
from experiments.projects.project import Kind, project
from tests.experiments.plots.printed import check_printed
from tests.experiments.projects.test_check import hanging


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


def test_a_body_in_space_is_seen_obliquely_too(tmp_path) -> None:
    """Of nodes behind each other one is named from the front; from aside more are."""
    write_scene(project(Kind.BREAST, masses=20).assumed, tmp_path / "scene.toml")
    figure = check_figure(checked(tmp_path / "scene.toml", sd_mm=0.5))
    check_printed(figure)
    front, oblique, shares = figure.axes
    assert len(names_in(oblique)) >= len(names_in(front)) >= 20
    assert len(shares.patches) == 12
    assert np.isclose(sum(bar.get_width() for bar in shares.patches), 100.0)
