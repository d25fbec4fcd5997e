"""docs/scenario.md: its block of keys is a scenario, has every key of every table, and its values are the defaults."""

import tomllib
from pathlib import Path

import pytest
from pydantic import BaseModel

from experiments.formats import scenario as tables
from experiments.formats.scenario import Scenario, shipped

PAGE = (Path(__file__).parents[3] / "docs" / "scenario.md").read_text(encoding="utf-8")
BLOCK = tomllib.loads(PAGE.split("<!-- keys -->")[1].split("```")[1].removeprefix("toml"))
OF_PHANTOM = {"phantom", "camera", "hue_deg", "diameter_mm"}
"""Keys that the text below the block has."""

TABLES = {
    "tremor": tables.Tremor,
    "release": tables.Release,
    "pokes": tables.Pokes,
    "breathing": tables.Breathing,
    "posture": tables.Posture,
    "press": tables.Press,
    "constants": tables.Constants,
    "marks": tables.Marks,
    "video": tables.Video,
}


def of_table(name: str) -> dict[str, object]:
    own = BLOCK[name] if name else BLOCK
    return own[0] if isinstance(own, list) else own


def test_the_block_is_a_scenario():
    assert Scenario.model_validate(BLOCK).scene == "scene.toml"


@pytest.mark.parametrize(("name", "model"), [("", Scenario), *TABLES.items()])
def test_every_key_is_in_the_block_and_defaults_are_those_of_the_program(name: str, model: type[BaseModel]):
    own = of_table(name)
    assert set(own) == set(model.model_fields) - OF_PHANTOM
    for key, field in model.model_fields.items():
        if key in own and not isinstance(own[key], dict | list) and not field.is_required() and key != "scene":
            default = tables.NEAR_SD_MM if key == "sd_mm" else field.default
            assert own[key] == (pytest.approx(default, rel=1e-8) if isinstance(default, float) else default), key


def test_every_shipped_scenario_is_on_the_page():
    assert all(f"- `{name}`: " in PAGE for name in shipped())
    assert all(f"`{key}`" in PAGE for key in (OF_PHANTOM - {"phantom", "camera"}) | set(tables.Camera.model_fields))
