"""`softaim export` as it is called: what it prints, what it leaves."""

import errno
import json
import os
import re
from pathlib import Path

import pytest
from mcap.reader import make_reader

from experiments.formats.provenance import content_digest
from tests.experiments.command import softaim
from tests.experiments.commands.good_files import tree

CALL = ("export", "film", "--to", "mcap", "--out", "film.mcap", "--estimates", "results")


pytestmark = pytest.mark.usefixtures("here")


def test_it_says_what_is_in_the_file(capfd: pytest.CaptureFixture[str]) -> None:
    assert softaim(*CALL, "--json") == 0
    said = json.loads(capfd.readouterr().out)
    with Path("film.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    counts = summary.statistics.channel_message_counts
    assert said["topics"] == {one.topic: counts[k] for k, one in summary.channels.items()}
    assert said["topics"]["/camera/image/compressed"] == said["frames"] == 3
    assert softaim("export", "film", "--to", "plus", "--out", "film.igs.mha", "--estimates", "results") == 0
    assert capfd.readouterr().out == (
        "3 frames; 1 of them with the target\n"
        "The pictures' affine map to the plane errs by up to 0.00 mm at drawn marks\n"
        "Written to film.igs.mha\n"
    )


def test_its_provenance_stands_beside_it(here: Path) -> None:
    before = tree(here)
    assert softaim(*CALL) == 0
    assert set(tree(here)) - set(before) == {"film.mcap", "film.provenance.json"}
    found = json.loads(Path("film.provenance.json").read_text(encoding="utf-8"))
    assert [one["path"] for one in found["inputs"]] == ["film", "results"]
    assert found["scene"]["steps"] == []


@pytest.mark.parametrize("command", ["track", "live"])
def test_results_of_another_recording_with_the_same_times_are_refused(here: Path, capfd, command: str) -> None:
    """The provenance beside the results names their recording; a live run's frames may come from anywhere."""
    made = {"command": command, "inputs": [{"path": "other", "sha256": content_digest(here / "marks")}]}
    (here / "results" / "provenance.json").write_text(json.dumps(made), encoding="utf-8")
    assert softaim(*CALL) == (2 if command == "track" else 0)
    said = "softaim: results: expected results of the files in film, found results of other\n"
    assert capfd.readouterr().err == (said if command == "track" else "")
    for own in ({"path": "film", "sha256": "of the film before an edit"}, {"sha256": content_digest(here / "film")}):
        made["inputs"] = [{"path": "renamed"} | own]
        (here / "results" / "provenance.json").write_text(json.dumps(made), encoding="utf-8")
        assert softaim(*CALL, "--force") == 0


@pytest.mark.parametrize("call", ["fsync", "replace"])
@pytest.mark.parametrize("nth", [1, 2])
def test_on_a_full_disk_all_stays_as_it_was(here, monkeypatch, capfd, nth, call):
    """Whichever of its two files there is no room for."""
    Path("film.mcap").write_text("old", encoding="utf-8")
    Path("film.provenance.json").write_text("mine", encoding="utf-8")
    before, calls = tree(here), []
    owner = os if call == "fsync" else Path
    real = getattr(owner, call)

    def full(*words: object) -> object:
        calls.append(words)
        if len(calls) == nth:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return real(*words)

    capfd.readouterr()
    with monkeypatch.context() as patch:
        patch.setattr(owner, call, full)
        assert softaim(*CALL, "--force") == 2
    assert re.fullmatch(
        r"softaim: \S+: expected (room to write|a file that can be written), found no space left on device\n",
        capfd.readouterr().err.splitlines(keepends=True)[-1],
    )
    assert tree(here) == before
