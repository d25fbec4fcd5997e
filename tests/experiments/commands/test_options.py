"""Every option of every command has an effect: on files, or on what a function is given. Slow functions only note it.

Rejected options are in bad_input.toml.
"""

import shutil
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import meshio
import numpy as np
import pytest
import typer

from experiments.commands.app import app
from experiments.formats.scene.scene import Scene, read_scene, scene_text
from tests.experiments.command import softaim
from tests.experiments.commands.good_files import NODES, SEVERAL, SPRINGS, tree
from tests.experiments.formats.mesh.shapes import box
from tests.experiments.rows import rows

OF_ALL = {"--json", "--verbose", "--help"}  # of every command: test_run.py

EFFECTS = """
new out | --kind breast | out/scene.toml
new out | --masses 4 | out/scene.toml
new out --kind breast | --young-kpa 9 | out/scene.toml
new out --kind mesh | --nodes nodes.csv | code
new out --kind mesh --nodes nodes.csv | --springs springs.csv | out/scene.toml
new out --kind mesh | --mesh body.vtu --unit mm --fixed x<1 --marks 4 | code
new out --kind mesh --mesh body.vtu --unit mm --fixed x<1 --marks 4 | --size-mm 12 | out/mesh.npz
new out --kind mesh --mesh body.vtu --unit mm --fixed x<1 --marks 4 | --target 12,8,9 | out/scene.toml
new out --kind mesh --mesh body.vtu --unit mm --fixed x<1 --marks 4 | --target-sd-mm 2 | out/scene.toml
new out --kind mesh --mesh body.vtu --unit mm --fixed x<1 --marks 4 | --field share | out/scene.toml
new out --kind mesh --mesh body.vtu --unit mm --fixed x<1 --marks 4 | --still | out/scene.toml
new out --kind mesh --mesh body.vtu --unit mm --fixed x<1 --marks 4 | --region 1=muscle | out/scene.toml
new out | --seed 3 | out/truth/scene.toml
new notes | --force | code
check scene.toml | --out out | write_picture
check scene.toml --out out | --fps 50 | checked.frames_per_s
check scene.toml --out out | --sd-mm 0.1 | checked.sd_mm
check scene.toml --out out | --vector pdf | write_picture.2
check scene.toml --out notes | --force | code
simulate scenario.toml --out out | --seed 9 | out/video.avi
simulate scenario.toml --out out --no-film | --runs 2 | out/seed-5/truth.csv
simulate scenario.toml --out out | --film --no-film | out/marks.csv
track marks --out out | --scene other.toml | track.0.scene
track marks --out out | --check | track.check
track film --out out | --film | track.watch
track marks --out out | --vector svg | write_track_plots.2
smooth marks --out out | --scene other.toml | compare.0.scene
smooth marks --out out | --vector svg | write_picture.2
compare marks --out out | --scene other.toml | compare.0.scene
compare marks --out out | --methods ekf | compare.1
compare marks --out out | --vector pdf | write_picture.2
calibrate boards --square-mm 25 --out camera.toml | --board 9x6 | code
calibrate boards --board 9x6 --out camera.toml | --square-mm 25 | code
calibrate boards --board 9x6 --square-mm 25 | --out camera.toml | code
calibrate --board 9x6 --square-mm 25 --out rig | --camera left=boards | command.1
calibrate boards --board 9x6 --square-mm 25 --out camera.toml | --charuco 4X4_50 --marker-mm 9 | command.2
calibrate boards --board 9x6 --square-mm 25 --out camera.toml --charuco 4X4_50 | --marker-mm 9 | code
calibrate boards --board 9x6 --square-mm 25 --out camera.toml | --plane boards/blank.png | command.plane
calibrate boards --board 9x6 --square-mm 25 --out camera.toml | --opencv-yaml a.yaml | command.opencv_yaml
calibrate boards --board 9x6 --square-mm 25 --out camera.toml | --ros-yaml a.yaml | command.ros_yaml
calibrate boards --board 9x6 --square-mm 25 --out camera.toml | --vector svg | command.vector
calibrate boards --board 9x6 --square-mm 25 --out camera.toml | --force | command.force
register scene.toml --out out.toml | --points marks | code
register scene.toml --points marks | --out out.toml | code
register scene.toml --points marks --out out.toml | --seconds 0 | out.toml
register scene.toml --points marks --out scene.toml | --force | code
advise film --out out | --needle needle.toml | code
advise film --needle needle.toml --out out | --scene other.toml | advise.0.scene
advise film --needle needle.toml --out out | --film | advise.watch
advise film --needle needle.toml --out out | --vector svg | write_picture.2
identify marks | --out out.toml | code
identify marks --out out.toml | --scene other.toml | identified_scene.0.scene
identify marks --out out.toml | --at-rest | resting_scene
identify marks --out out.toml | --minutes 2 | identified_scene.2
identify marks --out scene.toml | --force | code
tune marks | --out out.toml | code
tune marks --out out.toml | --scene other.toml | tuned_scene.0.scene
tune marks --out out.toml | --minutes 2 | tuned_scene.2
tune marks --out scene.toml | --force | code
plan scene.toml --out out | --plan plan.toml | code
plan marks --plan plan.toml --out out | --scene other.toml | planned.2
plan scene.toml --plan plan.toml --out out | --vector pdf | write_picture.2
insert scenario.toml --out out | --runs 3 | insert.1
insert scenario.toml --out out | --scene other.toml | insert.0.given
insert scenario.toml --out out | --needle needle.toml | insert.0.plan.needle
insert scenario.toml --out out | --seed 7 | insert.0.seed
insert scenario.toml --out out | --speed-mm-s 30 | insert.0.plan.insertion.speed_m_s
insert scenario.toml --out out | --radius-mm 3 | insert.0.plan.lesion
insert scenario.toml --out out | --advice --no-advice | insert.0.advice
insert scenario.toml --out out | --strength 2 | insert.0.strength
insert scenario.toml --out out | --processes 2 | insert.workers
insert scenario.toml --out out | --scheduler tcp://127.0.0.1:1 | insert.workers
insert scenario.toml --out out | --vector pdf | write_insertion_plots.2
demo | --out notes | code
demo --out out | --vector pdf | demo.vector
demo --out notes | --force | code
live --no-page | --source film | live.0
live --source film --no-page | --scene other.toml | live.1
live --source film --no-page | --out notes | code
live --source boards --scene scene.toml --no-page | --fps 9 | live.fps
live --source film --no-page | --duration 1 | live.duration_s
live --source film --no-page | --needle needle.toml | live.needle_path
live --source film --no-page | --film | live.film
live --source film --no-page | --record | live.record
live --source film | --page 127.0.0.1:0 | served.0
live --source film | --no-page | served.with_page
live --source film --no-page | --openigtlink 127.0.0.1:0 | served.1
live --source film --no-page --out notes | --force | code
record film/video.avi --out out | --scene scene.toml | out/scene.toml
record film/video.avi --out out | --codec MJPG | out/video.mkv
record film/video.avi --out out | --seconds 0.15 | out/frames.csv
record film/video.avi --out out | --fps 240 | out/frames.csv
record | --recover killed | killed/video.mkv
hue colours | --at 3,3 | code
hue colours --at 3,3 | --frame 1 | shown
hue colours --out out --scene scene.toml | --fps 9 | out/hue.csv
hue colours | --scene scene.toml | code
hue colours --scene scene.toml | --out out | out/hue.csv
hue colours --scene scene.toml --out out | --film | out/film.avi
hue colours --scene scene.toml --out notes | --force | code
export film --out film.igs.mha | --to plus | code
export film --to plus | --out film.igs.mha | code
export film --to plus --out film.igs.mha | --estimates results | film.igs.mha
export film --to plus --out film.igs.mha | --start 2026-01-31T09:00:00Z | film.igs.mha
export film --to plus --out film.igs.mha --estimates results | --scene other.toml | film.igs.mha
export film --to plus --out taken.igs.mha | --force | code
import sleap.csv --out out --fps 30 | --scene scene.toml | code
import sleap.csv --scene scene.toml --out out | --fps 30 | code
import sleap.csv --scene scene.toml --out out | --frames marks/frames.csv | code
import deeplabcut.csv --scene scene.toml --out out --fps 30 --rename tail= | --least 0.1 | out/marks.csv
import sleap.csv --scene scene.toml --out out --fps 30 | --sd-px 3 | out/marks.csv
import deeplabcut.csv --scene scene.toml --out out --fps 30 | --rename tail=M4 | code
import sleap.csv --scene scene.toml --out out --fps 30 | --mm-per-px 9 --origin-px 1,2 | out/marks.csv
import sleap.csv --scene scene.toml --out out --fps 30 --mm-per-px 9 | --origin-px 1,2 | code
import several.csv --scene scene.toml --out out --fps 30 | --individual rat | code
sweep sweep.toml | --out out | code
sweep sweep.toml --out out | --processes 2 | run_sweep.2
sweep sweep.toml --out out | --scheduler tcp://127.0.0.1:1 | run_sweep.2
sweep sweep.toml --out out | --force | run_sweep.force
faults | --out out | code
faults --out out | --only dark | faults_study.0
faults --out out | --seeds 3 | faults_study.1
faults --out out | --first-seed 1 | faults_study.1
faults --out out | --processes 2 | faults_study.3
faults --out out | --scheduler tcp://127.0.0.1:1 | faults_study.3
faults --out out | --force | faults_study.force
faults --out out | --page | rewrite_page
"""
"""A call, what is added to it, and where that is seen: a file, the exit code, what is printed, what a function gets."""

PICTURE = "plots.style.write_picture!"
WORK = {
    "check": ("projects.check.checked", "plots.check.check_figure", PICTURE, "projects.report.check_report!"),
    "track": ("pipeline.track.track", "pipeline.track.write_tables", "plots.track.write_track_plots!"),
    "smooth": (
        "pipeline.compare.compare",
        "pipeline.compare.write_smoothed",
        "plots.compare.comparison_figure",
        PICTURE,
    ),
    "compare": (
        *("pipeline.compare.compare", "pipeline.compare.write_comparison"),
        *("plots.compare.comparison_figure", PICTURE),
    ),
    "replay": ("pipeline.live.replaying.replay!",),
    "calibrate": ("pipeline.calibrate.command!",),
    "advise": ("pipeline.advise.advise", "pipeline.advise.write_advice", "plots.advice.advice_figure", PICTURE),
    "identify": (
        *("engine.spare.spare_cores", "pipeline.identify.marks_in"),
        *("pipeline.identify.identified_scene!", "pipeline.identify.resting_scene!"),
    ),
    "tune": ("engine.spare.spare_cores", "pipeline.identify.marks_in", "pipeline.identify.tuned_scene!"),
    "plan": ("pipeline.plan.planned", "pipeline.plan.write_plan", "plots.plan.plan_figure", PICTURE),
    "insert": (
        *("simulation.insert.insert", "simulation.insert.write_insertions"),
        "plots.insertion.write_insertion_plots!",
    ),
    "demo": ("studies.demo.demo!",),
    "live": ("servers.opening.served", "simulation.phantom_process.PhantomProcess", "pipeline.live.following.live!"),
    "sweep": ("pipeline.sweep.run_sweep!",),
    "faults": (
        *("studies.faults.study.faults_study", "studies.faults.study.markdown"),
        *("formats.page.rewrite_page", "errors.read_text", "commands.run.Run.finish!"),
    ),
}
"""By command the functions of `experiments` that are replaced; those with ! end the run when they are reached."""


class ReachedError(Exception):
    """The last function of a run was called."""


@dataclass
class Seen:
    """What a call did: its exit code, what it printed, what functions were given, the files that were there then."""

    code: str = ""
    shown: str = ""
    given: dict[str, Any] = field(default_factory=dict)
    files: dict[str, bytes | None] = field(default_factory=dict)

    def at(self, where: str) -> str | bytes | None:
        """What is seen in one place."""
        if where in ("code", "shown"):
            return str(getattr(self, where))
        if "/" in where or where.endswith((".mha", ".toml")):
            return self.files.get(where)
        name, *parts = where.split(".")
        if name not in self.given:
            return None
        args, options = self.given[name]
        value: Any = True
        for k, part in enumerate(parts):
            given = args[int(part)] if k == 0 and part.isdecimal() else options.get(part)
            value = getattr(value, part) if k else given
        if isinstance(value, Scene):
            return scene_text(value)
        return type(value).__name__ if " at 0x" in repr(value) else repr(value)


@pytest.fixture(scope="module")
def files(good: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Good files, and those that only options need."""
    import cv2

    from experiments.pipeline.recorder import Recorder
    from vision import Frame

    folder = tmp_path_factory.mktemp("options") / "files"
    shutil.copytree(good, folder)
    (folder / "nodes.csv").write_text(NODES, encoding="utf-8")
    (folder / "springs.csv").write_text(SPRINGS, encoding="utf-8")
    nodes, elements = box((3, 3, 3), 10.0)
    labels = {"label": [np.ones(len(elements), dtype=int)]}
    share = {"share": nodes[:, 0] / 30.0}
    meshio.write_points_cells(folder / "body.vtu", nodes, {"tetra": elements}, point_data=share, cell_data=labels)
    (folder / "several.csv").write_text(SEVERAL, encoding="utf-8")
    (folder / "taken.igs.mha").write_text("mine", encoding="utf-8")
    text = (folder / "scene.toml").read_text(encoding="utf-8")
    other = text.replace("stiffness_N_m = ", "stiffness_N_m = 1").replace("0.0, 31.5]", "0.0, 30.5]")
    (folder / "other.toml").write_text(other, encoding="utf-8")
    (folder / "colours").mkdir()
    for k, hue in enumerate((0, 90)):
        hsv = np.zeros((48, 64, 3), dtype=np.uint8)
        hsv[:12, :12] = (hue, 255, 255)
        cv2.imwrite(str(folder / "colours" / f"{k}.png"), cv2.cvtColor(hsv, cv2.COLOR_HSV2BGR))
    recorder = Recorder(folder / "killed", (64, 48))
    recorder.take(Frame(0, 0.0, np.zeros((48, 64, 3), dtype=np.uint8)))
    recorder.finish_piece()
    return folder


@pytest.fixture(scope="module")
def known() -> dict[str, Seen]:
    """What calls did: many rows add to the same one."""
    return {}


@pytest.fixture
def seen(
    files: Path,
    known: dict[str, Seen],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> Any:
    """A call to where the good files are."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path.parent / "cache"))

    def call(words: str) -> Seen:
        if words in known:
            return known[words]
        known[words] = found = Seen()
        folder = tmp_path / f"{len(list(tmp_path.iterdir()))}"
        shutil.copytree(files, folder)
        monkeypatch.chdir(folder)
        with monkeypatch.context() as patched:
            for name in WORK.get(words.split(maxsplit=1)[0], ()):
                patched.setattr(f"experiments.{name.rstrip('!')}", noting(found, name))
            try:
                found.code = str(softaim(*words.split()))
            except ReachedError:
                found.code = "reached"
        found.shown, found.files = capsys.readouterr().out, tree(folder)
        return found

    return call


def noting(found: Seen, name: str) -> Any:
    """A function that notes what it is given, in place of one of this name."""
    key = name.rstrip("!").split(".")[-1]

    def note(*args: Any, **options: Any) -> Any:
        found.given[key] = args, options
        if key == "live":
            scene = read_scene(args[1] or "film/scene.toml")
            with args[2](scene):  # opens the folder
                raise ReachedError
        if name.endswith("!"):
            raise ReachedError
        if key in ("served", "spare_cores"):
            return nullcontext()
        return SimpleNamespace(scene=read_scene("scene.toml"), steps=(), release=lambda: None)

    @contextmanager
    def noting_context(*args: Any, **options: Any) -> Any:
        note(*args, **options)
        yield None

    return noting_context if key in ("served", "spare_cores") else note


TO_FOLDERS = (
    *("simulate scenario.toml", "track marks", "smooth marks", "replay film", "compare marks", "insert scenario.toml"),
    *("advise film --needle needle.toml", "plan scene.toml --plan plan.toml", "record film/video.avi"),
    "import sleap.csv --scene scene.toml --fps 30",
)
ROWS = [
    *rows(EFFECTS),
    *((call, "--out out", "code") for call in TO_FOLDERS),
    *((f"{call} --out notes", "--force", "code") for call in TO_FOLDERS),
]


@pytest.mark.parametrize(("call", "added", "where"), ROWS, ids=[f"{row[0].split()[0]} {row[1]}" for row in ROWS])
def test_an_option_has_an_effect(seen: Any, call: str, added: str, where: str) -> None:
    plain, changed = seen(call), seen(f"{call} {added}")
    if where == "code" and not added.endswith(" notes"):
        assert changed.code in ("0", "reached")
    assert plain.at(where) != changed.at(where)


def test_every_option_of_every_command_is_in_the_table() -> None:
    listed = {(call.split()[0], word) for call, added, _ in ROWS for word in added.split() if word.startswith("--")}
    there = {
        (name, word)
        for name, command in typer.main.get_command(app).commands.items()  # type: ignore[attr-defined]
        for one in command.params
        for word in (*one.opts, *one.secondary_opts)
        if word.startswith("--") and word not in OF_ALL
    }
    assert listed == there
