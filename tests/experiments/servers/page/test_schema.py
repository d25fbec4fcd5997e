"""Real messages are what the schema says, key for key; and the schema tells others from them."""

import json
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter

from estimators import Advice, Status
from experiments.formats.scene.reference import Reference, ReferenceMark
from experiments.formats.scene.scene import read_scene
from experiments.servers.commands import Command
from experiments.servers.message import scene_message
from experiments.servers.page.application import STATIC
from tests.experiments.servers.page import messages

SCHEMA = json.loads((STATIC / "schema.json").read_text(encoding="utf-8"))
KINDS = {"object": dict, "array": list, "string": str, "boolean": bool, "null": type(None)}
KINDS |= {"number": (int, float), "integer": int}


def faults(found: Any, schema: dict[str, Any], at: str = "$") -> Iterator[str]:
    """A line for each part of a document that is not as a schema says, by the words of JSON Schema that ours uses."""
    if "$ref" in schema:
        yield from faults(found, SCHEMA["$defs"][schema["$ref"].removeprefix("#/$defs/")], at)
    for word in {"anyOf", "oneOf"} & schema.keys():
        if all(any(True for _ in faults(found, one, at)) for one in schema[word]):
            yield f"{at}: none of {word}"
    allowed = schema.get("enum", [schema["const"]] if "const" in schema else [found])
    if found not in allowed:
        yield f"{at}: expected one of {allowed}"
    kind = schema.get("type")
    if kind and (not isinstance(found, KINDS[kind]) or (kind != "boolean" and isinstance(found, bool))):
        yield f"{at}: expected {kind}"
    elif kind == "array":
        if not schema.get("minItems", 0) <= len(found) <= schema.get("maxItems", len(found)):
            yield f"{at}: {len(found)} items"
        for k, one in enumerate(found):
            yield from faults(one, schema["items"], f"{at}[{k}]")
    elif kind == "object":
        yield from faults_of_object(found, schema, at)


def faults_of_object(found: dict[str, Any], schema: dict[str, Any], at: str) -> Iterator[str]:
    """Keys that are missing or not known, and the faults of the others."""
    known, other = schema.get("properties", {}), schema.get("additionalProperties", True)
    yield from (f"{at}.{name}: missing" for name in schema.get("required", ()) if name not in found)
    for name, one in found.items():
        if name in known:
            yield from faults(one, known[name], f"{at}.{name}")
        elif other is False:
            yield f"{at}.{name}: unknown"
        elif other is not True:
            yield from faults(one, other, f"{at}.{name}")


def as_sent(message: Any) -> Any:
    return json.loads(json.dumps(message, allow_nan=False))


def test_the_scene_is_as_described() -> None:
    message = as_sent({**messages.scene(), "may_write": True})
    assert list(faults(message, SCHEMA["$defs"]["scene"])) == []
    assert list(faults(message, SCHEMA)) == []


def test_a_body_in_space_is_as_described() -> None:
    scene, state = as_sent({**messages.breast_scene(), "may_write": True}), as_sent(messages.breast_state())
    assert list(faults(scene, SCHEMA["$defs"]["scene"])) == []
    assert list(faults(state, SCHEMA["$defs"]["state"])) == []
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
    assert list(faults(message, SCHEMA["$defs"]["state"])) == []


def test_a_state_without_picture_needle_and_covariance_is_as_described() -> None:
    message = as_sent(messages.state(picture=None, advice=None, cov_mm2=None, sigma_mm=None, nis=None, nis_band=None))
    assert list(faults(message, SCHEMA["$defs"]["state"])) == []


@pytest.mark.parametrize(
    ("changed", "at"),
    [
        ({"status": "FINE"}, "$.status"),
        ({"marks_used": 1.5}, "$.marks_used"),
        ({"more": 1}, "$.more"),
        ({"paused": None}, "$.paused"),
    ],
)
def test_what_is_otherwise_is_found(changed: dict[str, Any], at: str) -> None:
    found = list(faults(as_sent(messages.state(**changed)), SCHEMA["$defs"]["state"]))
    assert [line.split(": ")[0] for line in found] == [at]


def test_commands_are_those_that_are_read() -> None:
    made = TypeAdapter(Command).json_schema(ref_template="#/$defs/{model}")
    for name, one in made.pop("$defs").items():
        assert SCHEMA["$defs"][name] == one
    reported = {key: value for key, value in SCHEMA["$defs"]["command"].items() if key != "description"}
    assert reported == made
