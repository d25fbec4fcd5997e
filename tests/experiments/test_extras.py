"""What a plain installation leaves out: a command that needs it says so in one line, with pip's command."""

import tomllib
from pathlib import Path

import pytest

from experiments import extras
from tests.experiments.command import softaim

ROOT = Path(__file__).parents[2]


def test_the_extras_are_those_of_the_project_and_named_in_the_readme() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    for extra, packages in extras.EXTRAS.items():
        assert [line.partition(">=")[0] for line in project["optional-dependencies"][extra]] == list(packages)
        assert f"`{extra}`" in readme


def test_what_the_readme_installs_is_all_that_its_commands_need() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert f'pip install -c constraints.txt ".[{",".join(extras.EXTRAS)}]"' in readme


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize(
    ("call", "asked_by", "extra"),
    [
        ("live --source film --page 127.0.0.1:0 --out out", "--page", "live"),
        ("export film --to mcap --out f.mcap", "--to mcap", "export"),
        ("sweep sweep.toml --out out", "sweep", "cluster"),
        ("faults --out out", "faults", "cluster"),
        ("insert scenario.toml --out out --runs 1 --processes 2", "--processes", "cluster"),
    ],
)
def test_without_an_extra_it_is_one_line(monkeypatch, capfd, call, asked_by, extra):
    monkeypatch.setattr(extras, "find_spec", lambda _name: None)
    assert softaim(*call.split()) == 2
    shown = capfd.readouterr().err
    said = f'expected the extra {extra} (pip install "softaim[{extra}]"), found no {extras.EXTRAS[extra][0]}'
    assert f"softaim: {asked_by}: {said}\n" in shown
    assert "Traceback" not in shown


def test_a_live_run_without_the_page_goes_on(capfd, monkeypatch):
    from experiments.servers.opening import served

    monkeypatch.setattr(extras, "find_spec", lambda _name: None)
    with served(None, None) as link:
        assert link is None
    assert 'no page: it needs the extra live (pip install "softaim[live]")' in capfd.readouterr().err
