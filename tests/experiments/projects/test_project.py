"""`softaim new`: projects whose files are read by what they are for, say the truth, and lead from nothing to advice."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import Delaunay

from dynamics import KINDS, NetworkError, parameter_value, parameters, rest_shape
from estimators import Insertion, NeedlePush
from experiments.formats.needle_file import FORCES, read_needle
from experiments.formats.scenario import read_scenario
from experiments.formats.scene.scene import Scene, read_scene
from experiments.projects.project import Kind, project, write_project
from experiments.projects.steps_text import READ_TRUTH
from experiments.projects.template import GROUP_SD, OWN_SD
from tests.experiments.command import softaim
from tests.experiments.rows import complaint
from tests.test_words import findings

PAGES = ("scene.toml", "scenario.toml", "calibration.toml", "still.toml", "needle.toml", "STEPS.md")
TRUE = ("truth/scene.toml", "truth/all_marks.toml")
KINDS_OF_PROJECTS = [(Kind.PLANE, 4), (Kind.PLANE, 12), (Kind.BREAST, 10)]


def written(folder: Path, *args, **options) -> Path:
    folder.mkdir()
    seed = options.get("seed", 0)
    write_project(project(*args, **options), folder, seed=seed)
    return folder


def pushed(scene: Scene, entry: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Where a needle from here pushes the target of a scene at rest [m], (dim,)."""
    network, node = scene.network, scene.target.node
    push = NeedlePush(network, node, FORCES.planned(network))
    return network.positions[network.index(node)] + push.shift(Insertion(entry, axis, 1.0))


@pytest.fixture(scope="module", params=KINDS_OF_PROJECTS, ids=lambda one: f"{one[0]} {one[1]}")
def made(request, tmp_path_factory) -> Path:
    """A project, to be read only."""
    kind, masses = request.param
    return written(tmp_path_factory.mktemp("project") / "made", kind, masses=masses)


def test_the_scene_rests_where_it_is_drawn_and_hides_its_target(made: Path) -> None:
    scene = read_scene(made / "scene.toml")
    network = scene.network
    np.testing.assert_allclose(rest_shape(network), network.positions, atol=1e-8)
    assert scene.target.node not in scene.measured_nodes
    assert {mark.node for mark in scene.marks} == {network.names[i] for i in network.free}
    assert bool(scene.cameras) == (network.dim == 2)
    assert all(scene.spring_groups)


def test_what_the_simulation_has_exactly_is_stated_so(made: Path) -> None:
    """Else the usual uncertainty of a real camera would have most of the target's variance."""
    text = (made / "scene.toml").read_text(encoding="utf-8")
    scene = read_scene(made / "scene.toml")
    assert scene.target.position_sd_m == scene.reference.drift_sd_m == 0.0
    assert all(camera.scale_sd == 0.0 for camera in scene.cameras)
    exact = [line for line in text.splitlines() if "# 0 for the simulated" in line]
    assert len(exact) == 2 + len(scene.cameras)


def test_the_simulated_tissue_is_off_as_the_page_says_and_rests_where_it_is_drawn(made: Path) -> None:
    """By some 10 % in stiffness, some 20 % in the rest; 3.5 standard deviations at most of what is drawn."""
    assumed, truth = read_scene(made / "scene.toml").network, read_scene(made / "truth" / "scene.toml").network
    np.testing.assert_allclose(rest_shape(truth), truth.positions, atol=1e-8)
    assert 1e-4 < np.abs(truth.positions - assumed.positions).max() < 0.05
    for kind in KINDS:
        which = parameters(assumed, (kind,))
        off = np.log([parameter_value(truth, one) / parameter_value(assumed, one) for one in which])
        if len(off):
            assert 0.2 * OWN_SD[kind] < np.abs(off).max() < 3.5 * np.hypot(GROUP_SD[kind], OWN_SD[kind])


def test_marks_of_the_calibration_are_all_measured_and_nothing_else_differs(made: Path) -> None:
    truth, all_marks = (read_scene(made / name) for name in TRUE)
    assert set(all_marks.measured_nodes) == {mark.node for mark in truth.marks} > set(truth.measured_nodes)
    np.testing.assert_array_equal(truth.network.positions, all_marks.network.positions)
    assert truth.measured_nodes == read_scene(made / "scene.toml").measured_nodes


def test_scenarios_are_read_with_their_scene_and_differ_by_seed(made: Path) -> None:
    read = [read_scenario(str(made / name)) for name in ("still.toml", "calibration.toml", "scenario.toml")]
    assert [one.seed for one in read] == [1, 2, 3]
    assert [Path(str(one.scene)).name for one in read] == ["all_marks.toml", "all_marks.toml", "scene.toml"]
    assert [one.pokes is None for one in read] == [True, False, False]


def test_the_needle_points_at_the_target_from_outside(made: Path) -> None:
    """Its line passes where it pushes the target, to 0.1 mm for rounding; the entry is on the hull: ahead is tissue."""
    scene = read_scene(made / "scene.toml")
    plan = read_needle(made / "needle.toml", scene.target.radius_m, scene.network.dim)
    u = plan.insertion.axis
    way = pushed(scene, plan.insertion.entry, u) - plan.insertion.entry
    assert np.linalg.norm(way - (way @ u) * u) < 1e-4
    assert 0.01 < way @ u < 0.2
    x = scene.network.positions
    beyond = (x - plan.insertion.entry) @ u
    assert (beyond > 0.0).any()


@pytest.mark.parametrize(("kind", "fewest", "most"), [(Kind.PLANE, 4, 60), (Kind.BREAST, 6, 60)])
def test_the_needle_enters_outside_of_bodies_of_all_sizes(kind, fewest, most, monkeypatch) -> None:
    """0.1 mm before the entry no simplex of nodes is; the target, which may lie on the outline, 20 mm ahead or more."""
    monkeypatch.setattr("experiments.projects.template.rest_shape", lambda network: network.positions)
    for masses in (fewest, 13, most):
        of = project(kind, masses=masses)
        x = of.assumed.network.positions
        way = pushed(of.assumed, of.entry_m, of.direction) - of.entry_m
        assert Delaunay(x).find_simplex(of.entry_m - 1e-4 * of.direction) == -1, masses
        assert 0.02 - 1e-9 < way @ of.direction < 0.35, masses
        np.testing.assert_allclose(way, (way @ of.direction) * of.direction, atol=1e-5)


def test_comments_name_the_unit_or_meaning_of_every_key_once(made: Path) -> None:
    """Each key of the assumed scene has a comment where it stands first, and files without comments mean the same."""
    text = (made / "scene.toml").read_text(encoding="utf-8")
    seen = {line.split(" = ")[0] for line in text.splitlines() if " = " in line and not line.startswith("#")}
    bare = {"name", "between", "node", "min_saturation", "min_value", "even"}
    for key in seen - bare:
        first = next(line for line in text.splitlines() if line.startswith((f"{key} = ", f"# {key}: ")))
        assert "#" in first, key


def test_comments_say_what_is_assumed(made: Path) -> None:
    for page in made.rglob("*.toml"):
        assert list(findings(page.read_text(encoding="utf-8"))) == [], page


def test_all_pages_say_the_same_about_who_reads_the_truth(made: Path) -> None:
    tutorial = Path(__file__).parents[3] / "docs" / "tutorial.md"
    pages = (made / "STEPS.md", made / "truth" / "scene.toml", made / "truth" / "all_marks.toml", tutorial)
    assert all(READ_TRUTH in " ".join(page.read_text(encoding="utf-8").split()) for page in pages)


def test_steps_name_files_that_are_there_or_made_before(made: Path) -> None:
    there = {str(path.relative_to(made)) for path in made.rglob("*")}
    assert {*PAGES, *TRUE} <= there
    for command in commands_of(made):
        words = command.split()
        for option in ("--scene", "--needle"):
            if option in words:
                assert words[words.index(option) + 1] in there, command
        assert words[2] in there or words[1] == "new", command
        there.add(words[words.index("--out") + 1])


def commands_of(folder: Path) -> list[str]:
    """What STEPS.md has the user type; films of a real phantom, in the section after the simulated ones, left out."""
    text = (folder / "STEPS.md").read_text(encoding="utf-8")
    found = re.findall(r"^softaim .+$", text, flags=re.MULTILINE)
    return [line for line in found if not line.startswith("softaim record")]


def test_the_same_seed_gives_the_same_files_and_another_other_tissue(tmp_path: Path) -> None:
    one, same, other = (
        written(tmp_path / name, Kind.PLANE, seed=seed) for name, seed in (("a", 1), ("b", 1), ("c", 2))
    )
    for name in (*PAGES, *TRUE):
        assert (one / name).read_bytes() == (same / name).read_bytes()
    assert (one / "scene.toml").read_bytes() == (other / "scene.toml").read_bytes()
    assert (one / "truth" / "scene.toml").read_bytes() != (other / "truth" / "scene.toml").read_bytes()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--kind", "plane", "--young-kpa", "3"], "--kind plane: expected no --young-kpa, found 3"),
        (["--kind", "plane", "--nodes", "n.csv"], "--kind plane: expected no --nodes, found n.csv"),
        (["--kind", "mesh"], "--kind mesh: expected --mesh FILE or --nodes NODES.csv, found none"),
        (["--kind", "mesh", "--masses", "4"], "--kind mesh: expected no --masses, found 4"),
        (["--masses", "3"], "--kind plane: masses: expected 4 to 60 of a planar phantom, found 3"),
        (["--kind", "breast", "--young-kpa", "0.5"], "expected to rest where it was seen with a change below 50 %"),
    ],
)
def test_choices_that_do_not_belong_together_are_one_line(words, message, tmp_path, capsys) -> None:
    assert softaim("new", tmp_path / "made", *words) == 2
    err = capsys.readouterr().err
    assert message in err
    assert err.count("\n") == 1
    assert not (tmp_path / "made").exists()


def test_the_command_says_what_to_type_next(tmp_path, capsys) -> None:
    assert softaim("new", tmp_path / "mine", "--masses", 6, "--seed", 4) == 0
    assert f"cd {tmp_path / 'mine'}; softaim check scene.toml" in capsys.readouterr().out
    assert read_scenario(str(tmp_path / "mine" / "still.toml")).seed == 5


def test_tissue_that_would_fall_is_refused(monkeypatch) -> None:
    """A template whose simulated tissue finds no rest says so by its seed."""

    def nowhere(_network):
        raise NetworkError("rest shape: expected a stable equilibrium near the drawn shape, found none")

    monkeypatch.setattr("experiments.projects.template.rest_shape", nowhere)
    assert "--seed 7: simulated tissue: rest shape" in complaint(project, Kind.PLANE, seed=7)


def test_a_simulated_recording_names_its_next_step(tmp_path, capsys) -> None:
    """That of the project for its own scenarios, `track` with the project's scene for others beside them."""
    folder = tmp_path / "made"
    assert softaim("new", folder, "--kind", "breast", "--masses", 6) == 0
    track = f"softaim track {tmp_path / 'ill.toml'} --scene {folder / 'scene.toml'} --out"
    text = re.sub(r"duration_s = [\d.]+", "duration_s = 0.1", (folder / "still.toml").read_text(encoding="utf-8"))
    for name, step in (("still.toml", "the following step in"), ("ill.toml", track)):
        (folder / name).write_text(text, encoding="utf-8")
        capsys.readouterr()
        assert softaim("simulate", folder / name, "--out", tmp_path / name) == 0
        assert f"next: {step}" in capsys.readouterr().out
