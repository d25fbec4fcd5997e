"""Digests of what was read, the file's form, and files that are written together or not at all."""

import json
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import pytest

from experiments.formats.outputs import write_together
from experiments.formats.provenance import content_digest, provenance_text
from experiments.formats.scene.scene import read_scene, scene_digest, scene_text, with_step
from tests.experiments.rows import complaint

GOOD = Path(__file__).parents[1] / "good_scene.toml"


def test_times_are_utc_and_the_scene_is_there_with_its_steps():
    noon = datetime(2026, 1, 2, 12, 0, 0, 500, tzinfo=timezone(timedelta(hours=2)))
    scene = with_step(read_scene(GOOD), "tune", "9.9", "ab")
    ended = datetime(2026, 1, 2, 10, 0, 3, tzinfo=UTC)
    of = ("track", ("track", "ü"), "cd", (noon, ended), {Path("x"): "ef"})
    found = json.loads(provenance_text(*of, scene))
    assert (found["began"], found["ended"]) == ("2026-01-02T10:00:00.000Z", "2026-01-02T10:00:03.000Z")
    assert found["arguments"] == ["track", "ü"]
    assert found["inputs"] == [{"path": "x", "sha256": "ef"}]
    (step,) = found["scene"]["steps"]
    assert (step["step"], step["program"], step["recording_sha256"]) == ("tune", "9.9", "ab")
    assert "scene" not in json.loads(provenance_text(*of))


def test_steps_are_read_as_they_were_written_and_do_not_change_the_digest(tmp_path: Path):
    scene = read_scene(GOOD)
    done = with_step(with_step(scene, "at-rest", "1", "ab"), "identify", "2", kept=["drag M1", 'damping "x" (9)'])
    (tmp_path / "scene.toml").write_text(scene_text(done), encoding="utf-8")
    again = read_scene(tmp_path / "scene.toml")
    assert again.steps == done.steps
    assert scene_digest(again) == scene_digest(scene) == done.steps[-1].scene_sha256


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("mass_kg = 0.25", "mass_kg = 0.250001"),
        ("stiffness_N_m = 80.0", "stiffness_N_m = 80.0001"),
        ("hue_deg = 120.0", "hue_deg = 121.0"),
        ("radius_mm = 5.0", "radius_mm = 5.5"),
        ("[target]", "[filter]\npoke_m_s2 = 4.9\n[target]"),
        ("[target]", "[uncertainty]\nstiffness = 0.1\n[target]"),
    ],
)
def test_whatever_a_scene_says_is_in_its_digest(tmp_path: Path, old: str, new: str):
    text = GOOD.read_text(encoding="utf-8")
    assert old in text
    (tmp_path / "other.toml").write_text(text.replace(old, new, 1), encoding="utf-8")
    assert scene_digest(read_scene(tmp_path / "other.toml")) != scene_digest(read_scene(GOOD))


def test_an_interrupt_leaves_all_files_as_they_were(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Ctrl-C just after the second was put in its place."""
    files = {tmp_path / name: f"new {name}" for name in ("one", "two", "three")}
    for path in files:
        path.write_text("old")
    replaced = Path.replace

    def interrupted(self: Path, target: Path) -> Path:
        done = replaced(self, target)
        if Path(target).name == "two":
            raise KeyboardInterrupt
        return done

    monkeypatch.setattr(Path, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_together(files)
    assert {path: path.read_text() for path in tmp_path.iterdir()} == dict.fromkeys(files, "old")


def test_two_outputs_are_two_files(tmp_path: Path):
    (tmp_path / "link").symlink_to(tmp_path / "one")
    assert "one: expected a different file for each output, found the same" in complaint(
        write_together, {tmp_path / "one": "a", tmp_path / "link": "b"}
    )
    assert not (tmp_path / "one").exists()


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def refused(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    (tmp_path / "notes.txt").touch()
    monkeypatch.setattr(Path, "open", refused)
    assert "notes.txt: expected a file that can be read, found permission denied" in complaint(content_digest, tmp_path)
