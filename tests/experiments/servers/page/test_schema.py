"""Real messages are what the schema says, key for key; and the schema tells others from them."""

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from jsonschema import Draft202012Validator
from pydantic import TypeAdapter

from estimators import Advice, Status
from experiments.formats.scene.reference import Reference, ReferenceMark
from experiments.formats.scene.scene import read_scene
from experiments.servers.commands import Command
from experiments.servers.message import scene_message
from experiments.servers.page.serving import STATIC
from tests.experiments.servers.page import messages

SCHEMA = json.loads((STATIC / "schema.json").read_text(encoding="utf-8"))


def faults(found: Any, name: str) -> list[str]:
    """Where a document is not as the definition of this name says."""
    one = {**SCHEMA["$defs"][name], "$defs": SCHEMA["$defs"]}
    return [error.json_path for error in Draft202012Validator(one).iter_errors(found)]


def as_sent(message: Any) -> Any:
    return json.loads(json.dumps(message, allow_nan=False))


def test_the_scene_is_as_described() -> None:
    message = as_sent({**messages.scene(), "may_write": True})
    assert faults(message, "scene") == []
    Draft202012Validator.check_schema(SCHEMA)
    assert Draft202012Validator(SCHEMA).is_valid(message)


def test_a_body_in_space_is_as_described() -> None:
    scene, state = as_sent({**messages.breast_scene(), "may_write": True}), as_sent(messages.breast_state())
    assert faults(scene, "scene") == []
    assert faults(state, "state") == []
    corners, faces = np.array(scene["surface"]["corners_mm"]), np.array(scene["surface"]["faces"])
    places = np.array([node["drawn_mm"] for node in scene["nodes"]])
    assert np.linalg.norm(corners[:, None] - places, axis=2).min(axis=1).max() < 0.02
    np.testing.assert_array_equal(np.unique(faces), np.arange(len(corners)))


def test_that_a_moved_camera_cannot_be_noticed_is_noted_where_no_reference_mark_stands() -> None:
    plain = read_scene(messages.GIVEN / "good_scene.toml")
    marked = replace(plain, cameras=(), reference=Reference((ReferenceMark("R", "In1"),)))
    notes = [scene_message(scene, "phantom", None, None)["notes"] for scene in (plain, marked)]
    assert notes == [["a move of the camera or tracker cannot be detected: no reference marks"], []]


@pytest.mark.parametrize("status", Status)
@pytest.mark.parametrize("advice", Advice)
def test_states_are_as_reported(status: Status, advice: Advice) -> None:
    message = as_sent(messages.state(status=status, advice=advice, recording={"folder": "rec", "frames": 3}))
    assert faults(message, "state") == []


def test_a_state_without_picture_needle_and_covariance_is_as_described() -> None:
    message = as_sent(messages.state(picture=None, advice=None, cov_mm2=None, sigma_mm=None, nis=None, nis_band=None))
    assert faults(message, "state") == []


@pytest.mark.parametrize(
    ("changed", "at"),
    [
        ({"status": "FINE"}, "$.status"),
        ({"marks_used": 1.5}, "$.marks_used"),
        ({"more": 1}, "$"),
        ({"paused": None}, "$.paused"),
    ],
)
def test_what_is_otherwise_is_found(changed: dict[str, Any], at: str) -> None:
    assert faults(as_sent(messages.state(**changed)), "state") == [at]


def test_commands_are_those_that_are_read() -> None:
    made = TypeAdapter(Command).json_schema(ref_template="#/$defs/{model}")
    for name, one in made.pop("$defs").items():
        assert SCHEMA["$defs"][name] == one
    reported = {key: value for key, value in SCHEMA["$defs"]["command"].items() if key != "description"}
    assert reported == made
