"""The line format: what a line states, and that what it cannot be is refused by place, expected and found."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynamics import build_network
from experiments.errors import InputError
from experiments.formats.marks.rows import cov_entries_mm2
from experiments.formats.scenario import read_scenario
from experiments.formats.scene.marks import Mark
from experiments.formats.scene.scene import Scene
from experiments.formats.scene.target import Target
from experiments.pipeline.live.marks.lines import LONGEST_LINE, read_line
from experiments.pipeline.track import measurement
from experiments.simulation.simulate import scene_of

FLAT = scene_of(read_scenario("webcam"))
PAGE = Path(__file__).parents[5] / "docs" / "live-marks.md"
M1 = '{"node": "M1", "x_mm": -200.5, "y_mm": 195, "sd_mm": 0.5}'


def in_space() -> Scene:
    places = [[-0.1, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]]
    edges = [(0, 3), (1, 3), (2, 3)]
    network = build_network(
        list("ABCD"), places, edges, stiffness=100.0, masses=0.1, gravity=np.zeros(3), fixed=list("ABC")
    )
    return Scene(network, (Mark("D", 0.0, 0.01),), Target("D", 0.005), ())


def test_a_line_states_a_time_and_marks() -> None:
    frame = read_line(f'{{"time_s": 12.25, "marks": [{M1}]}}\r'.encode(), FLAT)
    assert frame.time_s == 12.25
    assert [mark.node for mark in frame.marks] == ["M1"]
    np.testing.assert_allclose(frame.marks[0].position_m, [-0.2005, 0.195], rtol=1e-15)
    assert frame.marks[0].sd_m == pytest.approx(5e-4, rel=1e-15)


def test_in_space_a_mark_has_a_z() -> None:
    scene = in_space()
    line = '{"time_s": 0, "marks": [{"node": "D", "x_mm": 1, "y_mm": 2, %s"sd_mm": 1}]}'
    np.testing.assert_allclose(
        read_line((line % '"z_mm": 3, ').encode(), scene).marks[0].position_m, [1e-3, 2e-3, 3e-3]
    )
    with pytest.raises(InputError, match=r"^marks\[0\]: expected 3 numbers, as the scene has, found 2$"):
        read_line((line % "").encode(), scene)


def test_a_full_covariance_stands_for_a_deviation() -> None:
    line = '{"time_s": 0, "marks": [{"node": "D", "x_mm": 1, "y_mm": 2, "z_mm": 3, "cov_mm2": [4, 1, 5, 0.5, -1, 9]}]}'
    (mark,) = read_line(line.encode(), in_space()).marks
    np.testing.assert_allclose(mark.cov, 1e-6 * np.array([[4, 1, 0.5], [1, 5, -1], [0.5, -1, 9]]), rtol=1e-12)
    (mark,) = read_line(one(sd_mm="", cov_mm2="[0.25, 0.1, 1]").encode(), FLAT).marks
    np.testing.assert_allclose(mark.cov, 1e-6 * np.array([[0.25, 0.1], [0.1, 1.0]]), rtol=1e-12)


def one(**changes: str) -> str:
    """A line whose mark has other values, as JSON texts; None leaves a key out."""
    keys = {"node": '"M1"', "x_mm": "1", "y_mm": "2", "sd_mm": "0.5", **changes}
    return f'{{"time_s": 1, "marks": [{{{", ".join(f"{json.dumps(k)}: {v}" for k, v in keys.items() if v)}}}]}}'


FAULTS = [
    ("garbage", 'expected a line of JSON, found "garbage"'),
    ("[" * 60_000, "expected a line of JSON, found"),
    (f'{{"time_s": {"9" * 5000}, "marks": []}}', "expected a line of JSON, found"),
    (" " * (LONGEST_LINE + 1), f"expected up to {LONGEST_LINE} bytes, found more"),
    ("[]", "the line: expected a table, found []"),
    ('{"marks": []}', "time_s: expected this key, found none"),
    ('{"time_s": 1, "marks": [], "frame": 3}', "expected the keys time_s, marks, node, x_mm, y_mm, z_mm, sd"),
    ('{"time_s": 1, "marks": [], "node": 3}', "node: expected one of time_s, marks, found an unknown key"),
    (r'{"time_s": 1, "marks": [], "\ud800": 3}', "expected the keys time_s,"),
    (r'{"time_s": 1, "marks": [], "a\nb": 3}', "expected the keys time_s,"),
    (f'{{"time_s": 1, "marks": [], "{"a" * 60_000}": 3}}', "expected the keys time_s,"),
    ('{"time_s": "1", "marks": []}', 'time_s: expected a number, found "1"'),
    ('{"time_s": NaN, "marks": []}', "expected finite numbers, found NaN"),
    ('{"time_s": 1e999, "marks": []}', "time_s: expected a finite number, found inf"),
    (f'{{"time_s": {"9" * 400}, "marks": []}}', "time_s: expected a number, found"),
    ('{"time_s": 1, "time_s": 2, "marks": []}', 'expected each key once, found ["time_s", "time_s", "marks"]'),
    ('{"time_s": 1, "marks": {}}', "marks: expected a list, found a table"),
    ('{"time_s": 1, "marks": ["M1"]}', 'marks[0]: expected a table, found "M1"'),
    (f'{{"time_s": 1, "marks": [{M1}, {M1}]}}', 'marks[1].node: expected each node once, found "M1" again'),
    (one(node='"M9"'), 'marks[0].node: expected a node with a mark in the scene, found "M9"'),
    (one(z_mm="0"), "marks[0]: expected 2 numbers, as the scene has, found 3"),
    (one(x_mm="1e7"), "marks[0].x_mm: expected 1e+06 or less, found 10000000.0"),
    (one(y_mm="-1e7"), "marks[0].y_mm: expected -1e+06 or more, found"),
    (one(sd_mm="0"), "marks[0].sd_mm: expected 1e-06 or more, found 0"),
    (one(sd_mm=""), "marks[0]: expected either sd_mm or cov_mm2, found neither"),
    (one(cov_mm2="[1, 0, 1]"), "marks[0]: expected either sd_mm or cov_mm2, found both"),
    (one(sd_mm="", cov_mm2="[1, 0]"), "marks[0].cov_mm2: expected xx, xy, yy in a list, found [1.0, 0.0]"),
    (one(sd_mm="", cov_mm2="[1, 2, 1]"), "marks[0].cov_mm2: expected a positive definite covariance, found [1.0,"),
    (
        one(sd_mm="", cov_mm2="[1e-14, 0, 1e-14]"),
        "marks[0].cov_mm2: expected a positive definite covariance, found [1e-14",
    ),
    (one(sd_mm="", cov_mm2="[1e13, 0, 1e13]"), "marks[0].cov_mm2[0]: expected 1e+12 or less, found 1"),
]


@pytest.mark.parametrize("sd_mm", ["1e-6", "1e6"])
def test_the_limits_of_sd_mm_are_accepted_as_a_covariance(sd_mm: str) -> None:
    """A recording of a live run has covariances."""
    sent = read_line(one(sd_mm=sd_mm).encode(), FLAT).marks[0]
    xx, xy, yy = cov_entries_mm2(measurement(sent).cov)
    (mark,) = read_line(one(sd_mm="", cov_mm2=f"[{xx}, {xy}, {yy}]").encode(), FLAT).marks
    assert measurement(mark).cov == pytest.approx(measurement(sent).cov)


@pytest.mark.parametrize(("line", "message"), FAULTS, ids=[f"{i}-{line[:30]}" for i, (line, _) in enumerate(FAULTS)])
def test_what_is_no_frame_is_refused_in_one_line(line: str, message: str) -> None:
    with pytest.raises(InputError) as error:
        read_line(line.encode(), FLAT)
    assert str(error.value).startswith(message)
    assert str(error.value).isprintable()
    assert len(str(error.value)) < 160


JSON = st.recursive(
    st.none()
    | st.booleans()
    | st.floats()
    | st.integers()
    | st.sampled_from(["M1", "M2", "x_mm"])
    | st.text(max_size=4),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.sampled_from(["time_s", "marks", "node", "x_mm", "y_mm", "sd_mm"]), inner, max_size=6)
    ),
    max_leaves=12,
)


@given(st.binary(max_size=200) | JSON.map(lambda value: json.dumps(value).encode()))
def test_whatever_comes_is_a_frame_or_refused(line: bytes) -> None:
    try:
        stated = str(read_line(line, FLAT).time_s)
    except InputError as error:
        stated = str(error)
    assert stated.isprintable()
    assert stated not in ("nan", "inf", "-inf")


def test_the_lines_of_the_page_are_frames() -> None:
    lines = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith('{"time_s"')]
    assert len(lines) >= 2
    assert {len(read_line(line.encode(), FLAT).marks) for line in lines} == {0, 2}
