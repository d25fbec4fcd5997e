"""What a run tells those who watch, and what it does when they ask; the run is a real one, the link a list."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import vision
from experiments.formats.needle_file import read_needle
from experiments.log import LOG
from experiments.pipeline.live.control import Control
from experiments.pipeline.live.session import PAUSED, Session
from experiments.servers import publisher
from experiments.servers.commands import read_command
from experiments.servers.message import nis_band
from experiments.servers.publisher import Shows, do
from experiments.simulation.film import draw
from experiments.simulation.simulate import scene_of
from tests.experiments.webcam import coarse_webcam
from vision import Frame

NEEDLE = Path("tests/experiments/needle.toml")
START_S = 100.0


class Link:
    """Takes what a `Link` takes. State: the scene and the states that were published; what clients ask."""

    wants_picture = True

    def __init__(self) -> None:
        self.reported = False
        self.scene: dict = {}
        self.states: list[dict] = []
        self.pictures: list[object] = []
        self.asked: list[dict] = []

    def begin(self, scene: dict) -> None:
        self.scene = scene

    def publish(self, message, image) -> None:
        self.states.append(message())
        self.pictures.append(image)

    def tell(self) -> None:
        self.reported = True

    def requests(self) -> Iterator[dict]:
        while self.asked:
            yield self.asked.pop(0)


@pytest.fixture
def shown(tmp_path, monkeypatch):
    """A link, to which a run at rest is shown; the run's control; and a function that goes on by frames."""
    monkeypatch.setattr(publisher, "ATTENDS_S", np.inf)
    scene = scene_of(coarse_webcam())
    plan = read_needle(NEEDLE, scene.target.radius_m, 2)
    image = draw(scene, scene.network.positions, vision.Lighting(), np.random.default_rng(0), strays=[])
    link, now = Link(), [START_S]
    with Shows(link, scene, plan, "a test") as shows:  # type: ignore[arg-type]
        session = Session(
            scene, tmp_path / "estimates.csv", lambda _: None, needle=plan, publisher=shows, clock=lambda: now[0]
        )
        control = Control(session, tmp_path, source="a test", needle=NEEDLE.read_bytes())

        def go_on(n: int = 1) -> dict:
            for _ in range(n):
                shows.attend(control)
                exposure_s = now[0] + 1 / 30
                now[0] = exposure_s + 0.01
                session.take(Frame(0, exposure_s, image + np.uint8(0)))
                now[0] -= 0.01
            return link.states[-1]

        yield link, control, go_on
        control.finish()
        session.close()


def test_a_state_tells_the_estimate_and_where_all_is_in_the_picture(shown):
    link, control, go_on = shown
    state = go_on(12)
    scene = control.session.line.scene
    node = scene.network.index(scene.target.node)
    truth_px = scene.cameras[0].project(scene.network.positions[[node]])[0]
    np.testing.assert_allclose(state["picture"]["target_px"], truth_px, atol=2.0)
    np.testing.assert_allclose(state["target_mm"], 1e3 * scene.network.positions[node], atol=2.0)
    assert state["status"] == "TRACKING"
    assert state["fault"] is None
    assert state["counters"]["frames"] == 12
    assert set(state["counters"]["stages_ms"]) == {"wait", "predict", "detect", "update", "advise"}
    assert state["needle"]["direction"] == [0.0, -1.0]
    assert link.pictures[-1].shape == (240, 320, 3)
    assert link.scene["picture_px"] == (320, 240)
    assert [node["name"] for node in link.scene["nodes"]] == list(scene.network.names)


def test_where_it_is_served_is_said_with_the_first_frame(shown):
    link, control, go_on = shown
    go_on(1)
    assert not link.reported
    go_on(1)
    assert link.reported
    assert control.session.counters.frames == 2


def test_where_nobody_watches_no_picture_is_made(shown):
    link, _control, go_on = shown
    link.wants_picture = False
    assert go_on(3)["picture"] is None
    assert link.pictures == [None] * 3


def test_many_requests_do_not_keep_the_loop_from_its_frames(shown, monkeypatch):
    """What no time is left for is done at the next turn, in order."""
    link, control, go_on = shown
    monkeypatch.setattr(publisher, "ATTENDS_S", 0.0)
    link.asked = [{"command": "pause", "on": on} for on in (True, False, True)]
    paused = []
    for _ in range(3):
        go_on()
        paused.append(control.session.paused)
    assert paused == [True, False, True]
    assert not link.asked


def test_no_colour_is_learnt_for_a_node_without_a_mark(shown, monkeypatch, caplog):
    """1,500 such requests, each of which searched the picture, kept the estimate STALE for four seconds."""
    link, _control, go_on = shown
    go_on()
    monkeypatch.setattr(vision, "learn_hue", lambda *_: pytest.fail("the picture is searched"))
    link.asked = [{"command": "hue", "node": "nobody", "place_px": [0, 0]}]
    go_on()
    assert "hue: expected a node with a mark, found nobody" in caplog.text


def test_paused_there_is_no_advice_and_the_state_says_why(shown):
    link, control, go_on = shown
    go_on(12)
    control.session.pause(True)
    control.session.coast(START_S + 12 / 30 + 0.05)
    state = link.states[-1]
    assert state["fault"] == PAUSED
    assert state["needle"]["depth_mm"] == 2.0
    assert state["advice"]["advice"] == "ABORT"  # the needle is inside
    assert not state["from_frame"]


def test_without_an_estimate_the_state_is_initialising_and_without_guidance(shown):
    """Before the first frame, and after a reset without a frame, for example during a pause."""
    link, control, go_on = shown
    control.session.coast(START_S)
    before = link.states[-1]
    go_on(12)
    control.session.reset()
    control.session.coast(START_S + 12 / 30 + 0.05)
    after = link.states[-1]
    for state in (before, after):
        assert (state["status"], state["target_mm"], state["cov_mm2"]) == ("INITIALISING", None, None)
        assert state["fault"] == "the estimate is INITIALISING"
    assert before["advice"]["advice"] == "NO_GUIDANCE"
    assert after["advice"]["advice"] == "ABORT"  # the needle is inside


def test_what_clients_ask_for_is_done_between_two_frames(shown, capfd):
    link, _control, go_on = shown
    go_on(10)
    link.asked = [{"command": "record", "on": True}]
    state = go_on()
    assert state["recording"]["frames"] >= 0
    link.asked = [
        {"command": "fix", "place_mm": [0.0, 190.0], "sd_mm": 1.0},
        {"command": "fix", "place_px": [160.0, 120.0], "sd_mm": 2.0},
        {"command": "needle", "tip_mm": [1.0, 220.0], "direction": [0.0, -2.0]},
        {"command": "record", "on": False},
    ]
    state = go_on()
    assert state["needle"] == {"tip_mm": [1.0, 220.0], "direction": [0.0, -1.0], "depth_mm": 0.0}
    assert state["recording"] is None
    link.asked = [{"command": "reset"}]
    assert go_on()["status"] == "INITIALISING"
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"command": "fix"}, "expected place_mm or place_px"),
        ({"command": "fix", "place_mm": [1.0, 2.0, 3.0]}, "expected 2 coordinates"),
        ({"command": "hue", "node": "M9", "place_px": [320.0, 240.0]}, "M9|mark"),
        ({"command": "hue", "node": "M1", "place_px": [3200.0, 240.0]}, "expected one inside"),
        ({"command": "fly"}, "not done"),
    ],
)
def test_what_cannot_be_done_is_said_and_the_run_goes_on(shown, capfd, asked, said):
    link, _control, go_on = shown
    go_on(5)
    link.asked = [asked]
    state = go_on()
    error = capfd.readouterr().err
    assert "not done: " in error
    assert any(part in error for part in said.split("|"))
    assert state["events"][-1]["text"].startswith("not done: ")
    assert state["counters"]["frames"] == 6


@pytest.mark.parametrize(
    "refused",
    [
        {"command": "needle", "tip_mm": [0.0, 0.0, 1.0], "direction": [0.0, 0.0, 1.0]},
        {"command": "needle"},
    ],
    ids=["of another dimension", "no pose"],
)
@pytest.mark.parametrize(("tip_mm", "advice"), [([1.0, 220.0], "NO_GUIDANCE"), ([1.0, 210.0], "ABORT")])
def test_a_needle_whose_pose_is_refused_is_not_seen_until_one_is_taken(shown, refused, tip_mm, advice):
    """No advice outside, ABORT inside, as long as only such poses come."""
    link, _control, go_on = shown
    go_on(3)
    link.asked = [{"command": "needle", "tip_mm": tip_mm, "direction": [0.0, -1.0]}]
    assert "does not see it" not in go_on()["advice"]["reason"]
    for _ in range(2):
        link.asked = [refused]
        found = go_on()["advice"]
        assert found["advice"] == advice
        assert found["reason"].endswith("the needle's tracker does not see it")
    link.asked = [{"command": "needle", "tip_mm": tip_mm, "direction": [0.0, -1.0]}]
    assert "does not see it" not in go_on()["advice"]["reason"]


def test_a_colour_is_learnt_from_the_newest_picture(shown):
    _link, control, go_on = shown
    go_on(5)
    scene = control.session.line.scene
    mark = scene.marks[0]
    place_px = scene.cameras[0].project(scene.network.positions[[scene.network.index(mark.node)]])[0]
    do(read_command({"command": "hue", "node": mark.node, "place_px": place_px.tolist()}), control)
    learnt = control.session.line.scene.marks[0]
    assert abs((learnt.hue_deg - mark.hue_deg + 180) % 360 - 180) < 6
    assert learnt.half_width_deg != mark.half_width_deg
    assert go_on(3)["status"] == "TRACKING"


def test_the_band_of_nis_holds_95_in_100():
    """Chi-square of 6 degrees of freedom: 1.237 and 14.449, as tables have it."""
    assert nis_band(6) == pytest.approx((1.2373, 14.4494), abs=1e-3)
    assert nis_band(0) is None


def test_events_are_kept_while_it_shows_and_no_longer(shown):
    _link, _control, go_on = shown
    for k in range(12):
        LOG.warning("event %d", k)
    texts = [event["text"] for event in go_on()["events"]]
    assert texts == [f"event {k}" for k in range(4, 12)]
