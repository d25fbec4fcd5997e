"""A scene that no body can be made of is one line that names file and key, whichever command reads it."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.experiments.command import softaim
from tests.experiments.commands.good_files import tree, write_good_files

Change = Callable[[str], str]

NODE = 'name = "{}"\nposition_mm = [{}, {}]\nmass_kg = 0.1\n'
SPRING = 'between = ["{}", "{}"]\nstiffness_N_m = 100.0\nrest_length_mm = 50.0\n'
M1_MM = (-204.033367472, 192.013390138)


def scaled(key: str, factor: float) -> Change:
    return lambda text: re.sub(rf"(?<={key} = )[\d.e+-]+", lambda found: repr(factor * float(found[0])), text)


def instead(old: str, new: str, count: int = 0) -> Change:
    """Another text wherever the pattern is found."""
    return lambda text: re.sub(old, new, text, count=count)


def with_node(name: str, x: float, y: float) -> Change:
    return instead(r"\[\[network\.node\]\]", f"[[network.node]]\n{NODE.format(name, x, y)}\n[[network.node]]", 1)


def with_spring(one: str, other: str) -> Change:
    new = f"[[network.spring]]\n{SPRING.format(one, other)}\n[[network.spring]]"
    return instead(r"\[\[network\.spring\]\]", new, 1)


def both(*changes: Change) -> Change:
    def changed(text: str) -> str:
        for change in changes:
            text = change(text)
        return text

    return changed


def without(table: str) -> Change:
    """The scene without any such table."""
    return instead(rf"\[\[{re.escape(table)}\]\]\n(?:[^\[\n][^\n]*\n)*\n?", "")


def table(key: str, text: str) -> Change:
    return lambda scene: f"{scene}\n[{key}]\n{text}\n"


def placed(name: str, x: float, y: float) -> Change:
    return instead(rf'(name = "{name}"\nposition_mm = )\[[^\]]*\]', rf"\g<1>[{x!r}, {y!r}]")


BROKEN: dict[str, tuple[Change, str]] = {
    "empty": (lambda _text: "", "version: expected 1, found none"),
    "another version": (instead("version = 1", "version = 7"), "version: expected 1, found 7"),
    "no node": (without("network.node"), "network.node: expected this key, found none"),
    "no spring": (without("network.spring"), "network.spring: expected this key, found none"),
    "no mark": (without("mark"), "mark: expected one or more measured marks, found none"),
    "no measured mark": (instead("measured = true", "measured = false"), "mark: expected one or more measured marks"),
    "all fixed": (
        instead("fixed = false", "fixed = true"),
        "network.node: expected one or more free nodes, found none",
    ),
    "loose node": (with_node("N", 0, 90), 'network.node[0]: expected one or more springs to "N", found none'),
    "loose part": (
        both(with_node("N", 0, 90), with_node("O", 50, 90), with_spring("N", "O")),
        'network.node[0]: expected springs that lead to an anchor, found none from "O"',
    ),
    "two nodes at one place": (placed("M3", *M1_MM), "between: expected nodes at different places, found both at"),
    "two nodes 1 nm apart": (
        placed("M3", M1_MM[0] + 1e-6, M1_MM[1]),
        "network.spring[3].between: expected nodes at different places, found both at [-204.033",
    ),
    "two nodes 1 µm apart": (
        placed("M3", M1_MM[0] + 1e-3, M1_MM[1]),
        "network.spring[3].rest_length_mm: expected about the distance drawn, 0.001 mm, found 282.8",
    ),
    "two nodes of one name": (with_node("M1", 0, 90), 'network.node[1].name: expected a name of its own, found "M1"'),
    "spring to itself": (with_spring("M1", "M1"), "network.spring[0].between: expected two different nodes, found"),
    "spring to nobody": (with_spring("M1", "M9"), 'network.spring[0].between: no node named "M9"'),
    "three ends": (
        instead(r'between = \["M1", ', 'between = ["M1", "M2", ', 1),
        "network.spring[0].between: expected 2 entries or fewer, found 3",
    ),
    "negative mass": (scaled("mass_kg", -1.0), "network.node[0].mass_kg: expected more than 0, found -0.2"),
    "no mass": (scaled("mass_kg", 0.0), "network.node[0].mass_kg: expected more than 0, found 0.0"),
    "mass that is no number": (
        instead("mass_kg = 0.2", "mass_kg = nan"),
        "mass_kg: expected a finite number, found nan",
    ),
    "infinite stiffness": (
        instead(r"stiffness_N_m = .*", "stiffness_N_m = inf"),
        "network.spring[0].stiffness_N_m: expected a finite number, found inf",
    ),
    "no stiffness": (scaled("stiffness_N_m", 0.0), "network.spring[0].stiffness_N_m: expected more than 0, found 0.0"),
    "huge stiffness": (scaled("stiffness_N_m", 1e100), "network.spring[0].stiffness_N_m: expected springs that carry"),
    "tiny stiffness": (scaled("stiffness_N_m", 1e-100), "network.spring[0].stiffness_N_m: expected springs that carry"),
    "huge mass": (scaled("mass_kg", 1e300), "network.node[0].mass_kg: expected springs that carry the weight"),
    "huge mass, drawn without weight": (
        both(scaled("mass_kg", 1e300), instead(r"rest_length_mm = 200\.0", "rest_length_mm = 203.0")),
        "network: rest shape: expected",
    ),
    "masses in g": (scaled("mass_kg", 1e3), "network.node[0].mass_kg: expected springs that carry the weight"),
    "stiffness in N/mm": (
        scaled("stiffness_N_m", 1e-3),
        "network.spring[0].stiffness_N_m: expected springs that carry",
    ),
    "stiffness in another unit": (
        scaled("stiffness_N_m", 1e4),
        "network.spring[0].stiffness_N_m: expected springs that",
    ),
    "rest lengths in m": (
        scaled("rest_length_mm", 1e-3),
        "network.spring[0].rest_length_mm: expected about the distance",
    ),
    "negative rest length": (scaled("rest_length_mm", -1.0), "network.spring[0].rest_length_mm: expected more than 0"),
    "negative drag": (scaled("drag_N_s_m", -1.0), "network.node[0].drag_N_s_m: expected 0 or more, found -0.2"),
    "gravity in mm/s²": (instead(r"-9\.81\]", "-9810.0]"), "network.gravity_m_s2: expected springs that carry"),
    "gravity in space": (
        instead(r"gravity_m_s2 = \[0\.0, ", "gravity_m_s2 = [0.0, 0.0, "),
        "network.node[0].position_mm: expected 3 numbers, as network.gravity_m_s2 has, found 2",
    ),
    "target on an anchor": (
        instead(r'\[target\]\nnode = "M2"', '[target]\nnode = "In1"'),
        "target.node: expected a free node (a hidden target), found the anchor",
    ),
    "target nowhere": (instead(r'\[target\]\nnode = "M2"', '[target]\nnode = "M9"'), 'target.node: no node named "M9"'),
    "target off in space": (
        instead(r"(\[target\]\nnode = .*)", r"\1\noffset_mm = [0.0, 0.0, 1.0]"),
        "target.offset_mm: expected 2 numbers, as network.gravity_m_s2 has, found 3",
    ),
    "target of no size": (
        instead("radius_mm = .*", "radius_mm = 0.0"),
        "target.radius_mm: expected more than 0, found 0.0",
    ),
    "mark on an anchor": (
        instead(r'\[\[mark\]\]\nnode = "M1"', '[[mark]]\nnode = "In1"'),
        "mark[0].node: expected a free node (a mark tells of a free node), found the anchor",
    ),
    "two marks on a node": (
        instead(r'\[\[mark\]\]\nnode = "M3"', '[[mark]]\nnode = "M1"'),
        "mark[2].node: expected one mark for a node, found a second one",
    ),
    "camera without a view": (
        instead(
            r"plane_to_px = \[\n[^\]]*\],\n[^\]]*\],\n[^\]]*\],\n\]", "plane_to_px = [[0, 0, 0], [0, 0, 0], [0, 0, 0]]"
        ),
        "camera[0].plane_to_px: expected",
    ),
    "uncertain beyond numbers": (
        table("uncertainty", "stiffness = 1e9"),
        "uncertainty.stiffness: expected 700 or less",
    ),
    "uncertain of nothing": (
        table("uncertainty", 'parameters = ["stiffness M1-M9"]\ndirections = [[0.1]]'),
        "uncertainty.parameters[0]: no positive constant named",
    ),
    "uncertain of it all": (
        table("uncertainty", 'parameters = ["stiffness M1-M2"]\ndirections = [[1e4]]'),
        "uncertainty.directions: expected the log of stiffness 0",
    ),
    "led without a mark": (
        table("filter", 'led_nodes = ["M2"]'),
        "filter.led_nodes[0]: expected a node with a measured",
    ),
    "noise of nothing": (table("filter", "poke_m_s2 = 0.0"), "filter.poke_m_s2: expected more than 0, found 0.0"),
}


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("files")
    write_good_files(folder)
    return folder


@pytest.mark.parametrize("kind", BROKEN)
def test_a_broken_scene_is_one_line_that_names_file_and_key(
    files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], kind: str
) -> None:
    change, said = BROKEN[kind]
    good = (files / "scene.toml").read_text(encoding="utf-8")
    broken = change(good)
    assert broken != good
    monkeypatch.chdir(tmp_path)
    Path("marks").mkdir()
    for path in (Path("scene.toml"), Path("marks/scene.toml")):
        path.write_text(broken, encoding="utf-8")
    for name in ("frames.csv", "marks.csv"):
        Path("marks", name).write_bytes((files / "marks" / name).read_bytes())
    before = tree(tmp_path)
    calls = {
        "scene.toml": ["check", "scene.toml", "--out", "out"],
        "marks/scene.toml": ["track", "marks", "--out", "out"],
    }
    for path, words in calls.items():
        code, shown = softaim(*words), capfd.readouterr()
        assert re.fullmatch(rf"softaim: {path}: .*\n", shown.err), shown.err
        assert said in shown.err
        assert "found" in shown.err or "no " in shown.err
        assert (code, shown.out) == (2, "")
        assert tree(tmp_path) == before


def test_a_scene_that_is_no_text_is_one_line(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "scene.toml"
    path.write_bytes(bytes(range(256)))
    assert softaim("check", path) == 2
    assert capfd.readouterr().err == f"softaim: {path}: line 2: expected UTF-8 text, found byte 0x80\n"
