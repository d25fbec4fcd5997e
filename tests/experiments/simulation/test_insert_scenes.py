"""Needles in user scenes: entries, the filter's scene, and the reliability of advice."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi

from estimators import Advice, Guidance, Hit, Lesion, Needle
from experiments.formats.scenario import read_scenario
from experiments.simulation.advised import AdvisedInsertion, advice_figures, advised, inserted
from experiments.simulation.cases import Case, case_of
from experiments.simulation.closed_loop import attempt, hits
from experiments.simulation.insert import insert, one_run
from experiments.simulation.policies import Ahead, Filtered, Waiting, warmed
from experiments.simulation.world import world_of
from tests.experiments.command import softaim
from tests.experiments.rows import complaint, rows, spoilt

HANGING = (Path(__file__).parents[1] / "hanging.toml").read_text()
SCENARIO = """version = 1
scene = "hanging.toml"
seed = 5
[tremor]
acceleration_m_s2_sqrt_hz = 0.002
"""
NEEDLE = """version = 1
entry_mm = [30.0, -49.905, 0.0]
direction = [-1.0, 0.0, 0.0]
speed_mm_s = 60.0
hit = "TIP"
tip_sd_mm = 1.5
bending_sd_mm_per_mm = 0.0
[forces]
puncture_N = 0.0
cutting_N = 0.0
friction_N_m = 0.0
"""


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    """Two masses hanging in space on springs, on a table that trembles; constants as exact as they are written."""
    exact = HANGING.replace("[uncertainty]\nstiffness = 0.1\n", "")
    (tmp_path / "hanging.toml").write_text(exact.replace("poke_m_s2 = 3.0", "poke_m_s2 = 0.3\nstrain = 0.001"))
    path = tmp_path / "still.toml"
    path.write_text(SCENARIO)
    (tmp_path / "needle.toml").write_text(NEEDLE)
    return path


def case(scenario: Path, **options: object) -> Case:
    return brief(case_of(read_scenario(str(scenario)), **options))


def brief(usual: Case) -> Case:
    """Two seconds of patience, 15 frames a second."""
    return replace(usual, warm_s=1.0, patience_s=2.0, frames_per_s=15.0)


def test_a_needle_without_a_file_comes_from_above(scenario: Path):
    """The target hangs by 0.98 N of both masses on 200 N/m, 45 mm long at rest: 49.9 mm below the anchor at the top."""
    plan = case(scenario).plan
    np.testing.assert_allclose(plan.insertion.entry, [0.0, 0.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(plan.insertion.axis, [0.0, -1.0, 0.0], atol=1e-12)
    assert (plan.insertion.speed_m_s, plan.lesion.radius_m) == (0.05, 0.004)
    assert case(scenario).deepest_m == pytest.approx(0.045 + 0.1 * 9.81 / 200.0 + 0.035, abs=1e-6)


def test_the_needle_s_file_is_used_and_options_count_before_it(scenario: Path, tmp_path: Path):
    needle = tmp_path / "needle.toml"
    plan = case(scenario, needle_path=needle).plan
    np.testing.assert_allclose(plan.insertion.entry, [0.030, -0.049905, 0.0])
    assert (plan.insertion.speed_m_s, plan.needle.tip_sd_m, plan.forces.cutting_N) == (0.06, 1.5e-3, 0.0)
    other = case(scenario, needle_path=needle, speed_m_s=0.1, radius_m=0.002).plan
    assert (other.insertion.speed_m_s, other.lesion.radius_m) == (0.1, 0.002)


FAULTS = """
cutting_N = 0.0 | cutting_N = -1.0 | forces.cutting_N: expected 0 or more, found -1.0
puncture_N = 0.0 | contact_N_m = 0.0 | forces.contact_N_m: expected more than 0, found 0.0
puncture_N = 0.0 | error = 1.0 | forces.error: expected less than 1, found 1.0
puncture_N | punctur_N | forces.punctur_N: expected one of puncture_N, contact_N_m
[30.0, -49.905, 0.0] | [30.0, -49.905] | entry_mm: expected 3 numbers, as the scene has, found 2
"""


@pytest.mark.parametrize(("old", "new", "reported"), rows(FAULTS))
def test_a_fault_of_the_needle_is_reported_in_one_line(scenario, tmp_path, old, new, reported):
    path = tmp_path / "needle.toml"
    assert spoilt(lambda _path: case(scenario, needle_path=path), path, NEEDLE, old, new).startswith(reported)


def test_the_filter_is_given_another_scene_than_the_truth(scenario: Path, tmp_path: Path):
    """Twice as stiff, and a table of its own: the filter's, the tissue keeps its springs; without, both are one."""
    assumed = tmp_path / "assumed.toml"
    assumed.write_text(HANGING.replace("= 200.0", "= 400.0").replace("poke_m_s2 = 3.0", "poke_m_s2 = 1.0"))
    with_own, with_other = (warmed(world_of(case(scenario, scene_path=path)))[2].tissue for path in (None, assumed))
    assert with_own.network.stiffness.tolist() == [200.0, 200.0]
    assert with_other.network.stiffness.tolist() == [400.0, 400.0]
    assert with_other.settings.poked.poke == 1.0
    constants = with_other.process.parts["constants"]
    assert constants.stop - constants.start == 2
    assert world_of(case(scenario, scene_path=assumed)).network.stiffness.tolist() == [200.0, 200.0]


def test_a_scene_of_another_tissue_or_target_is_reported(scenario: Path, tmp_path: Path):
    assumed, line = tmp_path / "assumed.toml", '[target]\nnode = "hidden"'
    assert line in HANGING
    for text, expected in (
        (HANGING.replace('"a"', '"b"'), 'mark[0].node: expected a free node of the scenario\'s scene, found "b"'),
        (HANGING.replace(line, line.replace("hidden", "a")), 'target.node: expected "hidden", as in'),
    ):
        assumed.write_text(text)
        assert f"assumed.toml: {expected}" in complaint(case, scenario, scene_path=assumed)
    flat = Path(__file__).parents[1] / "good_scene.toml"
    assert (
        "good_scene.toml: network: expected a body in space, as in the scenario's scene, found one in the plane"
        in complaint(case, scenario, scene_path=flat)
    )


def test_every_policy_reaches_the_target_of_a_tissue_at_rest(scenario: Path):
    """Nothing but a tremor moves it: tips of 0.5 mm, a lesion of 4 mm; a needle that turns costs no more."""
    tried, of_advice = one_run(case(scenario))
    assert [one.hit for one in tried] == [True] * 5
    assert [one.hit for one in of_advice] == [True] * 2


def test_what_is_lost_is_not_seen(scenario: Path):
    """Of 46 frames 0.4 are lost, to three standard deviations of the count; the policies do without."""
    scenario.write_text(SCENARIO + "[marks]\nlost = 0.4\n")
    world = world_of(case(scenario))
    n_seen = [len(world.marks(k, world.start)) for k in range(world.case.n_frames)]
    assert abs(sum(n_seen) - 0.6 * 46) < 3 * np.sqrt(46 * 0.24)
    state, _, warm = warmed(world)
    assert attempt(world, Filtered(world, warm), state).miss_m < 0.01


class Faulty(Waiting):
    """As `Waiting`, whose estimate is of no use from a time on."""

    from_s = np.inf

    def fault(self, now_s: float) -> str | None:
        return "the estimate is LOST" if now_s >= self.from_s else super().fault(now_s)


def test_a_needle_that_waits_for_go_is_drawn_back_when_the_estimate_fails(scenario: Path):
    """From 0.2 s before it arrives on: then it never does."""
    world = world_of(case(scenario))
    state, _, warm = warmed(world)
    arrived = attempt(world, Faulty(world, warm), state)
    faulty = Faulty(world, warm)
    faulty.from_s = world.case.warm_s + arrived.seconds - 0.2
    failed = attempt(world, faulty, state)
    assert (arrived.insertions, failed.insertions) == (1, 1)
    assert (arrived.miss_m is None, failed.miss_m) == (False, None)


def test_a_filter_of_uncertain_constants_predicts_with_their_errors(scenario: Path, tmp_path: Path):
    """Seven frames ahead its target is less certain than by exact constants, of the same marks."""
    assumed = tmp_path / "assumed.toml"
    text = HANGING.replace("poke_m_s2 = 3.0", "poke_m_s2 = 0.3")
    assumed.write_text(text.replace("stiffness = 0.1", "stiffness = 0.3"))
    spread = []
    for path in (None, assumed):
        world = world_of(case(scenario, scene_path=path))
        _, _, warm = warmed(world)
        ahead = Ahead(world, warm).path(np.zeros((warm.tables.n_times - 1, 2, 3)))
        spread.append(np.sqrt(np.trace(ahead.covs[7])))
    assert spread[1] > 1.02 * spread[0]


def test_needles_hit_as_often_as_their_tips_are_near(scenario: Path, tmp_path: Path):
    """A tissue at rest, a needle that does not push, tip errors of 1.5 mm on a ball of 2 mm: a chi of 3 dimensions.

    P(|N(0, 1.5² I)| < 2) = 0.380 by SciPy; of 400 insertions, to three standard deviations, 7.3 points.
    """
    scenario.write_text(SCENARIO.split("[tremor]", maxsplit=1)[0])
    (tmp_path / "needle.toml").write_text(NEEDLE + "[lesion]\nradius_mm = 2.0\n")
    world, rng = world_of(case(scenario, needle_path=tmp_path / "needle.toml")), np.random.default_rng(0)
    there = Guidance(Advice.GO, "", arrival_s=1.05, probability=0.38, depth_m=0.03)
    found = [inserted(world, there, (1.0, 5.0), world.start, rng.normal(size=3)) for _ in range(400)]
    assert np.mean([one.hit for one in found]) == pytest.approx(chi.cdf(2.0 / 1.5, 3), abs=0.073)
    assert inserted(world, there, (1.0, 1.04), world.start, np.zeros(3)).hit is None


def test_advice_predicts_the_push_of_the_needle(scenario: Path, tmp_path: Path):
    """0.2 N push a hanging mass of 50 g by 10 mm on 20 N/m: needles that know it end within half of that."""
    path = tmp_path / "needle.toml"
    path.write_text(NEEDLE.replace("cutting_N = 0.0", "cutting_N = 0.2"))
    world = world_of(case(scenario, needle_path=path))
    state, _, warm = warmed(world)
    pushed = advised(world, warm, state)
    assert max(one.miss_m for one in pushed) < 5e-3
    assert max(one.probability for one in pushed) < 0.85  # 0.9 without a push: 17 % of it are not known


def test_reliability():
    """Two runs of two insertions, predicted 0.9, 0.7 and 0.5, 0.5; 1, 1 and 0, 1 hit: 0.65 predicted, 0.75 observed.

    Leaving out a run: differences of 0.0 and 0.2 about their mean, a jackknife of sqrt(1/2 · 2 · 0.1²) = 0.1.
    """
    of = [
        [AdvisedInsertion(0.0, Advice.GO, 0.9, True, 0.0), AdvisedInsertion(1.0, Advice.WAIT, 0.7, True, 0.0)],
        [
            AdvisedInsertion(0.0, Advice.WAIT, 0.5, False, 0.1),
            AdvisedInsertion(1.0, Advice.WAIT, 0.5, True, 0.0),
            AdvisedInsertion(2.0, Advice.NO_GUIDANCE),
        ],
    ]
    said = advice_figures(of)
    assert said["advice"] == {"GO": 1, "WAIT": 3, "REALIGN": 0, "ABORT": 0, "NO_GUIDANCE": 1}
    assert (said["insertions"], said["predicted"], said["observed"]) == (4, pytest.approx(0.65), 0.75)
    assert (said["difference"], said["difference_sd"]) == (pytest.approx(0.1), pytest.approx(0.1))
    # R: binom.test(3, 4)
    assert (said["observed_low"], said["observed_high"]) == pytest.approx((0.1941204, 0.9936905))
    assert (said["go_insertions"], said["go_predicted"], said["go_observed"]) == (1, 0.9, 1.0)
    assert said["go_difference_sd"] is None
    assert [row["n"] for row in said["bins"]] == [0, 0, 0, 0, 0, 2, 0, 1, 0, 1]

    nothing = advice_figures([[AdvisedInsertion(0.0, Advice.NO_GUIDANCE)]])
    assert (nothing["insertions"], nothing["predicted"], nothing["go_observed"]) == (0, None, None)


def test_a_core_is_a_hit_by_its_length():
    """A notch of 20 mm through the middle of a ball of 5 mm cuts 10 mm of it; 4.9 mm beside, 2 mm."""
    needle, ball = Needle(hit=Hit.CORE, core_m=5e-3), Lesion.ball(5e-3, 3)
    axis = np.array([0.0, 0.0, 1.0])
    assert hits(needle, ball, np.array([0.0, 0.0, 4e-3]), axis)
    assert not hits(needle, ball, np.array([4.9e-3, 0.0, 0.0]), axis)
    assert hits(Needle(hit=Hit.NOTCH), ball, np.array([4.9e-3, 0.0, 0.0]), axis)


def test_the_notch_is_brought_to_the_target(scenario: Path, tmp_path: Path):
    """The tip goes 15 mm beyond: what is aimed with is the notch's middle."""
    path = tmp_path / "needle.toml"
    path.write_text(NEEDLE.replace('"TIP"', '"NOTCH"').replace("tip_sd_mm = 1.5", "tip_sd_mm = 0.1"))
    done, of_advice = one_run(case(scenario, needle_path=path))
    assert [one.hit for one in done if one.policy == "filter-ahead"] == [True]
    assert all(one.hit for one in of_advice)


def test_nodes_share_forces_over_a_part_of_the_springs_length(scenario: Path):
    """60 mm in the phantom, whose springs are 200 mm long and more; here three tenths of 46 mm."""
    assert world_of(case_of(read_scenario("quiet"))).needle.reach_m == 0.06
    assert world_of(case(scenario)).needle.reach_m == pytest.approx(0.0138)


@pytest.fixture
def briefly(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "experiments.simulation.insert.insert", lambda usual, *args, **keys: insert(brief(usual), *args, **keys)
    )


@pytest.mark.usefixtures("briefly")
@pytest.mark.usefixtures("without_pictures")
def test_the_command_on_a_scene_of_ones_own(scenario: Path, tmp_path: Path, capsys: pytest.CaptureFixture):
    needle, out = tmp_path / "needle.toml", tmp_path / "out"
    needle.write_text(NEEDLE.replace("tip_sd_mm = 1.5", "tip_sd_mm = 0.5"))
    words = ("insert", scenario, "--needle", needle, "--scene", tmp_path / "hanging.toml", "--out", out)
    assert softaim(*words, "--runs", "2", "--seed", "9", "--processes", "1") == 0
    assert "Advice at any time: 4 insertions, predicted 9" in capsys.readouterr().out
    written = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert written["advise"]["insertions"] == 4
    assert written["wait-for-go"]["predicted"] > 0.9
    for policy in ("rest", "open-loop", "filter", "filter-ahead", "wait-for-go"):
        row = written[policy]
        assert row["hit_rate_low"] <= row["hit_rate"] <= row["hit_rate_high"]
        assert {"miss_mm", "seconds_to_hit", "insertions"} <= set(row)
    assert [row["low"] for row in written["calibration"]] == [k / 10 for k in range(10)]
    assert sum(row["n"] for row in written["calibration"]) == 2
    seeds = {line.split(",")[0] for line in (out / "runs.csv").read_text().splitlines()[1:]}
    assert seeds == {"9", "10"}
    assert {path.name for path in out.iterdir()} - {"provenance.json", "softaim.log"} == {
        *("summary.json", "runs.csv", "advised.csv", "hits.png", "misses.png")  # too few for the others
    }
