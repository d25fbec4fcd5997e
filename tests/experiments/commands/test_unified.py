"""Whole commands on a recording whose scene asks for the unified filter."""

import json
from pathlib import Path

import pandas as pd
import pytest

from estimators import UnifiedFilter
from experiments.formats.needle_file import read_needle
from experiments.formats.recording import read_recording
from experiments.formats.scene.scene import read_scene
from experiments.pipeline.line import Line
from experiments.pipeline.live.session import Session
from experiments.pipeline.warm_up import warm_up
from tests.experiments.command import softaim
from tests.experiments.commands.test_smooth import SCENARIO

NEEDLE = Path(__file__).parents[1] / "needle.toml"


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("unified")
    (folder / "short.toml").write_text(SCENARIO, encoding="utf-8")
    assert softaim("simulate", folder / "short.toml", "--no-film", "--out", folder / "rec") == 0
    assert read_recording(folder / "rec").scene.settings.unified
    return folder / "rec"


def last_line(capsys: pytest.CaptureFixture[str]) -> str:
    return capsys.readouterr().err.strip().splitlines()[-1]


@pytest.mark.parametrize("words", [(), ("--check",)])
def test_track_writes_its_tables_and_pictures(recorded: Path, tmp_path: Path, words: tuple[str, ...]) -> None:
    """Another estimate than the usual filter's, and one that covers the truth."""
    out = tmp_path / "out"
    assert softaim("track", recorded, "--out", out, *words) == 0
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert summary["filter"]["mae_mm"] < 0.5 * summary["open-loop"]["mae_mm"]
    rows = pd.read_csv(out / "estimates.csv")
    assert set(rows["status"]) <= {"INITIALISING", "TRACKING"}
    assert any(path.read_bytes().startswith(b"\x89PNG") for path in out.glob("*.png"))
    line = Line(read_recording(recorded).scene, check=bool(words))
    assert isinstance(line.filter, UnifiedFilter)


def test_advise_and_compare_run(recorded: Path, tmp_path: Path) -> None:
    assert softaim("advise", recorded, "--needle", NEEDLE, "--out", tmp_path / "advice") == 0
    rows = pd.read_csv(tmp_path / "advice" / "advice.csv")
    assert len(rows) > 15
    assert softaim("compare", recorded, "--methods", "ekf", "--out", tmp_path / "others") == 0


def test_check_runs(recorded: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert softaim("check", recorded / "scene.toml") == 0
    assert "Traceback" not in capsys.readouterr().err


def test_smoothing_lowers_the_error(recorded: Path, tmp_path: Path) -> None:
    assert softaim("smooth", recorded, "--out", tmp_path / "out") == 0
    summary = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    assert summary["smoother"]["rmse_mm"] < summary["filter"]["rmse_mm"]


@pytest.mark.parametrize(("is_truth", "least"), [(True, 0.002), (False, 0.003)])
def test_tuning_writes_the_level_that_tracking_uses(
    recorded: Path, tmp_path: Path, capsys, is_truth: bool, least: float
) -> None:
    """Levels below 0.003 are for constants that were found from the tissue."""
    text, scene, out = (recorded / "scene.toml").read_text(), tmp_path / "scene.toml", tmp_path / "tuned.toml"
    scene.write_text(text.replace("strain = 0.001\n", "") if is_truth else text.partition("[[provenance]]")[0])
    assert softaim("tune", recorded, "--scene", scene, "--out", out, "--json") == 0
    report = json.loads(capsys.readouterr().out)
    assert set(report["levels"]) == {"strain"}
    tuned = read_scene(out)
    assert tuned.settings.discrepancy == report["strain"] >= least
    assert tuned.settings.unified
    assert tuned.steps[-1].name == "tune"
    assert Line(tuned).filter.settings == tuned.settings


@pytest.mark.parametrize("key", ["white_m_s2_sqrt_hz = 0.05", "adapt_marks = true"])
def test_levels_of_the_usual_filter_are_refused_beside_it(recorded: Path, tmp_path: Path, capsys, key: str) -> None:
    scene = tmp_path / "scene.toml"
    text = (recorded / "scene.toml").read_text(encoding="utf-8")
    scene.write_text(text.replace("[filter]\n", f"[filter]\n{key}\n"), encoding="utf-8")
    assert softaim("check", scene) == 2
    assert f"expected no levels of the usual filter with unified, found {key.partition(' ')[0]}" in last_line(capsys)


def test_a_live_session_advises_by_it(recorded: Path, tmp_path: Path) -> None:
    scene, now = read_recording(recorded).scene, [0.0]
    plan = read_needle(NEEDLE, 5e-3, 2)
    session = Session(scene, tmp_path / "e.csv", lambda _: None, needle=plan, clock=lambda: now[0])
    assert isinstance(session.line.filter, UnifiedFilter)
    session.close()


def test_a_rehearsal_is_by_the_filter_that_the_scene_asks_for(recorded: Path, monkeypatch) -> None:
    """Every entrance of the filter that frames use is called, so that its kernels are loaded."""
    called = set()
    for name in ("predict", "update", "fix", "predict_at", "snapshot", "restore", "expected"):
        own = getattr(UnifiedFilter, name)
        monkeypatch.setattr(
            UnifiedFilter, name, lambda self, *a, _own=own, _name=name, **k: called.add(_name) or _own(self, *a, **k)
        )
    scene = read_recording(recorded).scene
    warm_up(scene)
    assert called >= {"predict", "update", "fix", "predict_at", "snapshot"}
