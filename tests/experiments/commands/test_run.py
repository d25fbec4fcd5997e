"""What every run of a command leaves: provenance, log, one JSON object, and what was left out before it."""

import errno
import hashlib
import json
import os
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from unittest.mock import Mock

import pytest
import typer

from experiments.commands.app import COMMANDS
from experiments.commands.run import Answer, Run, public, subcommand
from experiments.formats.scene.scene import read_scene
from experiments.pipeline.live.outputs import LiveTable
from tests.experiments.command import softaim

pytestmark = pytest.mark.usefixtures("here", "without_pictures")


def provenance(path: str) -> dict:
    return json.loads(Path(path).read_text(encoding="utf-8"))


def sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def test_an_output_folder_says_where_it_comes_from() -> None:
    """Digests as sha256sum prints them, of a folder those of its files and their names, in the order of names."""
    began = datetime.now(UTC)
    words = ["advise", "film", "--needle", "needle.toml", "--out", "out"]
    assert softaim(*words) == 0
    found = provenance("out/provenance.json")
    assert found["program"]["version"] == version("softaim")
    assert found["command"] == "advise"
    assert found["arguments"] == words
    times = [datetime.fromisoformat(found[key]) for key in ("began", "ended")]
    assert began.replace(microsecond=began.microsecond // 1000 * 1000) <= times[0] <= times[1] <= datetime.now(UTC)
    files = sorted(path for path in Path("film").iterdir())
    lines = "".join(f"{sha256(path.read_bytes())}  {path.name}\n" for path in files)
    digests = {"film": sha256(lines.encode()), "needle.toml": sha256(Path("needle.toml").read_bytes())}
    assert found["inputs"] == [{"path": path, "sha256": digest} for path, digest in digests.items()]
    assert found["scene"]["steps"] == []
    assert found["scene"]["left_out"] == ["identify", "tune"]
    log = Path("out/softaim.log").read_text(encoding="utf-8")
    assert "read film: 3 frames of video.avi" in log
    assert "WARNING noise levels were not tuned (softaim tune)" in log
    assert "advise: " in log.splitlines()[-1]


def test_steps_follow_the_scene_from_file_to_file(capfd: pytest.CaptureFixture[str]) -> None:
    """At rest, tuned, tracked: the track's provenance has both steps, and only identify is said to be left out."""
    with Path("marks/marks.csv").open("a", encoding="utf-8") as marks:
        marks.writelines(f"{t},M2,0.0,188.1,1.0\n" for t in ("0.2",))
    assert softaim("identify", "marks", "--at-rest", "--out", "rest.toml") == 0
    assert softaim("tune", "marks", "--scene", "rest.toml", "--out", "tuned.toml") == 0
    capfd.readouterr()
    assert softaim("track", "marks", "--scene", "tuned.toml", "--out", "out") == 0
    (line,) = capfd.readouterr().err.splitlines()
    assert line.split(":")[1].split(" (")[0].strip() == "constants were not identified"
    found = provenance("out/provenance.json")["scene"]
    assert [step["step"] for step in found["steps"]] == ["at-rest", "tune"]
    assert found["left_out"] == ["identify"]
    assert found["sha256"] == found["steps"][-1]["scene_sha256"]
    beside = provenance("tuned.provenance.json")
    assert beside["command"] == "tune"
    assert beside["scene"] == {**found, "left_out": ["identify"]}
    assert [one["path"] for one in beside["inputs"]] == ["marks", "rest.toml"]
    recording = found["steps"][0]["recording_sha256"]
    assert recording == beside["inputs"][0]["sha256"] == found["steps"][1]["recording_sha256"]


def test_a_simulated_scene_knows_that_its_constants_are_the_truths_and_stays_the_same() -> None:
    for name in ("a", "b"):
        assert softaim("simulate", "scenario.toml", "--out", name) == 0
    assert Path("a/scene.toml").read_bytes() == Path("b/scene.toml").read_bytes()
    (step,) = read_scene(Path("a/scene.toml")).steps
    assert (step.step, step.recording_sha256) == ("simulate", None)
    digest = sha256(Path("scenario.toml").read_bytes())
    assert provenance("a/provenance.json")["inputs"] == [{"path": "scenario.toml", "sha256": digest}]
    # the digest of a recording leaves out when it was made
    for name in ("a", "b"):
        assert softaim("smooth", name, "--out", f"{name}-smooth") == 0
    inputs = [provenance(f"{name}-smooth/provenance.json")["inputs"][0]["sha256"] for name in ("a", "b")]
    assert inputs[0] == inputs[1]


@pytest.mark.parametrize(
    "words",
    [
        "advise film --needle needle.toml --out out",
        "plan scene.toml --plan plan.toml --out out",
        "record film/video.avi --out out",
        "simulate scenario.toml --out out",
        "smooth marks --out out",
        "sweep sweep.toml --out out --processes 1",
    ],
)
def test_json_is_all_that_is_on_standard_output(words: str, capfd: pytest.CaptureFixture[str]) -> None:
    assert softaim(*words.split(), "--json", "--verbose") == 0
    shown = capfd.readouterr()
    answer = json.loads(shown.out)
    assert isinstance(answer, dict)
    assert Path(answer["out"]).exists()
    assert f"softaim: softaim {version('softaim')}: {words.split(maxsplit=1)[0]}" in shown.err


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.__name__)
def test_every_command_has_what_all_have(command, capfd: pytest.CaptureFixture[str]) -> None:
    assert softaim(command.__name__, "--help") == 0
    options = capfd.readouterr().out
    for option in ("--json", "--verbose", "-v,", "--help"):
        assert option in options
    if "--out" in options and command.__name__ != "bench":
        assert "--force" in options


def test_the_version_is_that_of_the_package(capfd: pytest.CaptureFixture[str]) -> None:
    assert softaim("--version") == 0
    assert capfd.readouterr().out == f"softaim {version('softaim')}\n"


def test_passwords_of_streams_are_not_kept() -> None:
    assert public(["live", "--source", "rtsp://me:secret@host/x", "a@b"]) == (
        *("live", "--source", "rtsp://host/x", "a@b"),
    )
    assert public(["rtsp://me:se@cret@host/x@y"]) == ("rtsp://host/x@y",)


def test_a_sweep_says_what_it_read_and_which_runs_failed(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise FloatingPointError("overflow")

    monkeypatch.setattr("experiments.pipeline.sweep.motion_of", broken)
    text = Path("sweep.toml").read_text(encoding="utf-8").replace('"quiet"', '"scenario.toml"\nscene = "scene.toml"')
    Path("sweep.toml").write_text(text, encoding="utf-8")
    assert softaim("sweep", "sweep.toml", "--out", "out", "--processes", "1") == 1
    read = [one["path"] for one in provenance("out/provenance.json")["inputs"]]
    assert read == ["sweep.toml", "scenario.toml", "scene.toml"]
    assert "WARNING 1 of 1 runs failed" in Path("out/softaim.log").read_text(encoding="utf-8")


def test_a_live_film_grows_beside_the_folder_that_it_is_called_in(monkeypatch: pytest.MonkeyPatch) -> None:
    Path("empty").mkdir()
    monkeypatch.chdir("empty")
    assert softaim("live", "--source", "../film", "--out", ".", "--film", "--no-page") == 0
    assert Path("film.avi").is_file()
    assert not Path("../empty-film").exists()


def test_a_live_run_goes_on_without_a_table_that_cannot_be_written(monkeypatch, capfd) -> None:
    """As on a full disk: it is said, the film is followed to its end, and the exit code is 2."""
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    monkeypatch.setattr(LiveTable, "_add", Mock(side_effect=full))
    assert softaim("live", "--source", "film", "--out", "out", "--no-page") == 2
    shown = capfd.readouterr()
    assert "3 frames, " in shown.out
    assert shown.err.endswith("estimates.csv: expected a table that can be written, found no space left on device\n")


def test_a_print_of_a_command_does_not_mix_with_its_json(capfd: pytest.CaptureFixture[str]) -> None:
    def chatty(run: Run) -> Answer:
        """Print."""
        print("busy")
        return Answer({"x": 1}, ["done"])

    one = typer.Typer()
    one.command()(subcommand(chatty))
    one(["--json"], standalone_mode=False)
    shown = capfd.readouterr()
    assert json.loads(shown.out) == {"x": 1}
    assert shown.err == "busy\n"
    one([], standalone_mode=False)
    assert capfd.readouterr().out == "busy\ndone\n"
