"""A scene that no body can be made of is one line that names file and key, whichever command reads it."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.experiments.command import softaim
from tests.experiments.commands.good_files import tree

Change = Callable[[str], str]

NODE = '[[network.node]]\nname = "{}"\nposition_mm = [{}, 90.0]\nmass_kg = 0.1\n\n'
M1_MM = (-204.033367472, 192.013390138)


def scaled(key: str, factor: float) -> Change:
    return lambda text: re.sub(rf"(?<={key} = )[\d.e+-]+", lambda found: repr(factor * float(found[0])), text)


def instead(old: str, new: str, count: int = 0) -> Change:
    """Another text wherever the pattern is found."""
    return lambda text: re.sub(old, new, text, count=count)


def without(table: str) -> Change:
    """The scene without any such table."""
    return instead(rf"\[\[{re.escape(table)}\]\]\n(?:[^\[\n][^\n]*\n)*\n?", "")


def table(key: str, text: str) -> Change:
    return lambda scene: f"{scene}\n[{key}]\n{text}\n"


def beside_m1(off_mm: float) -> Change:
    return instead(r'(name = "M3"\nposition_mm = )\[[^\]]*\]', rf"\g<1>[{M1_MM[0] + off_mm!r}, {M1_MM[1]!r}]")


def with_loose_part(text: str) -> str:
    spring = '[[network.spring]]\nbetween = ["N", "O"]\nstiffness_N_m = 100.0\nrest_length_mm = 50.0\n\n'
    text = text.replace("[[network.node]]", f"{NODE.format('O', 50)}{NODE.format('N', 0)}[[network.node]]", 1)
    return text.replace("[[network.spring]]", f"{spring}[[network.spring]]", 1)


CARRY = "expected springs that balance"
BROKEN: list[tuple[Change, str]] = [
    (lambda _text: "", "version: expected 1, found none"),
    (without("network.node"), "network.node: expected this key, found none"),
    (without("network.spring"), "network.spring: expected this key, found none"),
    (without("mark"), "mark: expected one or more measured marks, found none"),
    (with_loose_part, 'network.node[0]: expected springs that lead to an anchor, found none from "O"'),
    (beside_m1(1e-6), "network.spring[3].between: expected nodes at different places, found both at [-204.033"),
    (beside_m1(1e-3), "spring[3].rest_length_mm: expected about the distance drawn, 0.001 mm, found 282.8"),
    (instead(r"stiffness_N_m = .*", "stiffness_N_m = inf"), "stiffness_N_m: expected a finite number, found inf"),
    (scaled("stiffness_N_m", 1e100), f"network.spring[0].stiffness_N_m: {CARRY}"),
    (scaled("stiffness_N_m", 1e-100), f"network.spring[0].stiffness_N_m: {CARRY}"),
    (scaled("mass_kg", 1e300), f"network.node[0].mass_kg: {CARRY}"),
    (
        lambda text: scaled("mass_kg", 1e300)(text.replace("rest_length_mm = 200.0", "rest_length_mm = 203.0")),
        "network: rest shape: expected",
    ),
    (scaled("mass_kg", 1e3), f"network.node[0].mass_kg: {CARRY} the weight"),
    (scaled("rest_length_mm", 1e-3), "network.spring[0].rest_length_mm: expected about the distance"),
    (scaled("rest_length_mm", -1.0), "network.spring[0].rest_length_mm: expected more than 0"),
    (
        instead(r"(\[target\]\nnode = .*)", r"\1\noffset_mm = [0.0, 0.0, 1.0]"),
        "target.offset_mm: expected 2 numbers, as network.gravity_m_s2 has, found 3",
    ),
    (table("uncertainty", "stiffness = 1e9"), "uncertainty.stiffness: expected 700 or less"),
    (
        table("uncertainty", 'parameters = ["stiffness M1-M2"]\ndirections = [[1e4]]'),
        "uncertainty.directions: expected the log of stiffness 0",
    ),
]
"""What no test of `formats` has; of those all commands read a scene by the same function."""


@pytest.mark.parametrize(("change", "said"), BROKEN, ids=[said for _, said in BROKEN])
def test_a_broken_scene_is_one_line_that_names_file_and_key(here, capfd, change, said):
    good = Path("scene.toml").read_text(encoding="utf-8")
    broken = change(good)
    assert broken != good
    for name in ("scene.toml", "marks/scene.toml"):
        Path(name).write_text(broken, encoding="utf-8")
    before = tree(here)
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
        assert tree(here) == before
