"""What a shell completes."""

import pytest

from tests.experiments.command import softaim


@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        ("softaim si", ["simulate"]),
        ("softaim s", ["simulate", "smooth", "sweep"]),
        ("softaim simulate po", ["poked"]),
        ("softaim insert w", ["webcam"]),
        ("softaim simulate my", ["my.toml"]),
        ("softaim simulate in/", ["in/a.toml"]),
        ("softaim tune --mi", ["--minutes"]),
    ],
)
def test_commands_scenarios_files_and_options(typed, offered, tmp_path, monkeypatch, capfd):
    (tmp_path / "in").mkdir()
    for name in ("mine.toml", "my.toml", "my.csv", "in/a.toml"):
        (tmp_path / name).touch()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("_SOFTAIM_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", typed)
    monkeypatch.setenv("COMP_CWORD", str(typed.count(" ")))
    assert softaim() == 0
    assert capfd.readouterr().out.split() == offered
