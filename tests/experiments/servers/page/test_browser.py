"""The page in a browser, by clicking and by keys: what it shows and sends; GO is never shown when it must not be."""

import asyncio
import json
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from estimators import Advice, Status
from tests.experiments.servers.page import messages
from tests.experiments.servers.page.served import Served, served

STALE_S = 3600.0
"""In place of 0.2 s where the page's own clock is not the test's: a busy machine takes long."""


class Fed:
    """A state, 30 a second, until it is silent. State: what is changed in it, how many went."""

    def __init__(self, one: Served) -> None:
        self.one, self.made, self.silent, self.frames = one, {}, threading.Event(), 0
        self._ends, self._publishing = threading.Event(), threading.Lock()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        while not self._ends.wait(1 / 30):
            with self._publishing:
                if not self.silent.is_set():
                    self.publish(messages.state(self.frames + 1, **self.made))

    def publish(self, state: dict[str, Any]) -> None:
        self.frames += 1
        self.one.publish(state, messages.picture())

    def silence(self, browser: Any) -> None:
        """Publish no state of its own any more, and wait until the page has the last one."""
        self.silent.set()
        with self._publishing:
            last = messages.state(self.frames + 1, **self.made)
            self.publish({**last, "counters": {**last["counters"], "memory_mb": self.frames + 1000}})
        self.one.until(lambda: browser.find_element("id", "memory").text == f"{self.frames + 999} MB")

    def end(self) -> None:
        self._ends.set()
        self._thread.join()


@pytest.fixture(scope="module")
def shown(browser: Any) -> Iterator[Fed]:
    """The page, open on a run that goes on."""
    with opened(browser, {**messages.scene(), "stale_ms": 1e3 * STALE_S}) as fed:
        yield fed


@contextmanager
def opened(browser: Any, scene: dict[str, Any]) -> Iterator[Fed]:
    """The page of this scene."""
    with served(scene) as one:
        fed = Fed(one)
        try:
            browser.get(one.address)
            one.until(lambda: word(browser) == "GO")
            yield fed
        finally:
            fed.end()


@pytest.fixture(autouse=True)
def _plain(browser: Any, shown: Fed) -> Iterator[None]:
    shown.one.until(lambda: word(browser) == "GO")  # not what the test before left
    yield
    browser.execute_script("delete performance.now")
    shown.made = {}
    shown.silent.clear()
    shown.one.refusal = None
    shown.one.commands.clear()


def word(browser: Any, of: str = "advice") -> str:
    return str(browser.execute_script(f"return document.getElementById('{of}-word')?.textContent"))


def words(browser: Any) -> list[str]:
    """Advice and health as they are at one time, which two questions may not find."""
    ids = "['advice-word', 'health-word']"
    return list(browser.execute_script(f"return {ids}.map(id => document.getElementById(id)?.textContent)"))


def colour(browser: Any, x: float, y: float) -> list[int]:
    """Of the canvas at a share of its width and height, RGB; read from a copy that is made to be read."""
    return list(
        browser.execute_script(
            "const c = document.getElementById('picture'), [x, y] = arguments;"
            "const copy = new OffscreenCanvas(1, 1).getContext('2d', {willReadFrequently: true});"
            "copy.drawImage(c, -Math.floor(x * c.width), -Math.floor(y * c.height));"
            "return [...copy.getImageData(0, 0, 1, 1).data].slice(0, 3)",
            x,
            y,
        )
    )


def stop_clock(browser: Any, ahead_s: float = 0.0) -> None:
    """Let the page's clock stand, so far ahead of now, and wait until the page has looked at it."""
    browser.execute_async_script(
        "const [ahead_ms, done] = arguments, at = Performance.prototype.now.call(performance) + ahead_ms;"
        "performance.now = () => at;"
        "new MutationObserver((_, observer) => { observer.disconnect(); done(); })"
        ".observe(document.getElementById('view'), {attributeFilter: ['data-old']})",
        1e3 * ahead_s,
    )


def keep_words(browser: Any, name: str) -> None:
    """Keep all texts that an element shows from now on: what it shows for a time may be gone when it is asked for."""
    browser.execute_script(
        "const element = document.getElementById(arguments[0]); window.words = [];"
        "new MutationObserver(() => words.push(element.textContent)).observe(element, {childList: true})",
        name,
    )


def click(browser: Any, name: str) -> None:
    browser.find_element("id", name).click()


def press(browser: Any, *keys: str) -> None:
    from selenium.webdriver.common.action_chains import ActionChains

    ActionChains(browser).send_keys(*keys).perform()


def test_the_picture_appears_and_the_words(browser: Any, shown: Fed) -> None:
    shown.one.until(lambda: all(abs(x - 120) < 6 for x in colour(browser, 0.02, 0.5)))
    assert shown.one.feed.n_watching == 1
    assert word(browser, "health") == "TRACKING"
    assert browser.find_element("id", "percent").text == "92 %"
    shown.one.until(lambda: browser.find_element("id", "seen").text.startswith("marks 1 of 1 found"))
    assert browser.execute_script(
        "return [document.documentElement.scrollWidth, document.documentElement.scrollHeight]"
    ) == [1280, 720]


def test_a_picture_of_which_nothing_is_known_is_shown_alone(browser: Any, shown: Fed) -> None:
    """As while a run is prepared, here one that started again: frames count from zero, and no position is known."""
    shown.silence(browser)
    nothing = {"picture": None, "target_mm": None, "status": "INITIALISING", "fault": "preparing"}
    shown.one.until(
        lambda: (
            shown.one.publish({**messages.state(0), **nothing}, messages.picture(200))
            or all(abs(x - 200) < 6 for x in colour(browser, 0.5, 0.5))
        )
    )
    assert word(browser, "health") == "INITIALISING"
    assert browser.find_element("id", "health").get_attribute("data-kind") == "info"
    assert not browser.find_element("id", "unseen").is_displayed()


def test_silence_is_shown_as_stale_go_is_gone_and_inside_it_says_to_stop(browser: Any, shown: Fed) -> None:
    shown.silence(browser)
    stop_clock(browser, STALE_S - 600.0)
    assert word(browser) == "GO"
    stop_clock(browser, STALE_S + 1.0)
    shown.one.until(lambda: word(browser) == "STALE")
    text = browser.find_element("tag name", "body").text
    assert "STALE" in text
    assert "GO" not in text.split()
    assert browser.find_element("id", "spoken").get_attribute("textContent") == "STALE"
    assert browser.find_element("id", "why").text.endswith("The needle is inside: stop")
    shown.silent.clear()
    shown.one.until(lambda: word(browser) == "GO")


def test_a_state_that_was_long_on_its_way_is_stale_though_it_comes(browser: Any, shown: Fed) -> None:
    shown.silence(browser)
    stop_clock(browser)
    fastest_s = time.time() + 10.0
    for late_s, shows in ((0.0, "GO"), (STALE_S + 1.0, "STALE"), (0.0, "GO")):
        shown.publish({**messages.state(shown.frames + 1), "utc_s": fastest_s - late_s})
        shown.one.until(lambda shows=shows: word(browser) == shows)
        assert word(browser) == shows


@pytest.mark.parametrize(
    ("made", "advice", "health"),
    [
        ({"fault": "the camera is frozen"}, "NO GUIDANCE", "FAULT"),
        ({"paused": True}, "NO GUIDANCE", "PAUSED"),
        ({"status": Status.LOST}, "NO GUIDANCE", "LOST"),
        ({"status": Status.DIVERGED}, "NO GUIDANCE", "DIVERGED"),
        ({"advice": Advice.NO_GUIDANCE}, "NO GUIDANCE", "TRACKING"),
        ({"advice": Advice.WAIT}, "WAIT", "TRACKING"),
        ({"status": Status.INITIALISING, "fault": "preparing"}, "NO GUIDANCE", "INITIALISING"),
        ({"advice": Advice.ABORT}, "ABORT", "TRACKING"),
        ({"advice": Advice.ABORT, "fault": "the camera is frozen"}, "ABORT", "FAULT"),
        ({"advice": Advice.ABORT, "paused": True}, "ABORT", "PAUSED"),
    ],
    ids=str,
)
def test_go_is_not_shown_where_it_does_not_hold(browser, shown, made, advice, health):
    shown.made = made
    shown.one.until(lambda: words(browser) == [advice, health])
    assert "GO" not in browser.find_element("id", "advice").text.split()
    assert browser.find_element("id", "advice").get_attribute("data-kind") != "good"


def test_abort_has_a_colour_and_a_shape_of_its_own_and_is_spoken(browser: Any, shown: Fed) -> None:
    shown.made = {"advice": Advice.ABORT}
    shown.one.until(lambda: word(browser) == "ABORT")
    advice = browser.find_element("id", "advice")
    assert advice.get_attribute("data-kind") == "stop"
    assert advice.find_element("tag name", "use").get_attribute("href") == "#shape-stop"
    assert browser.find_element("id", "turn").text == ""
    assert browser.find_element("id", "spoken").get_attribute("textContent") == "ABORT"


def test_buttons_and_keys_send_their_commands(browser: Any, shown: Fed) -> None:
    one = shown.one
    click(browser, "record")
    press(browser, "p")
    one.until(lambda: len(one.commands) == 2)
    shown.made = {"recording": {"folder": "rec", "frames": 7}}
    one.until(lambda: browser.find_element("id", "record").get_attribute("aria-pressed") == "true")
    click(browser, "record")
    one.until(lambda: len(one.commands) == 3)
    # at once, since a reset is armed only for a time; commands come in the order in which they are sent
    browser.execute_script(
        "const reset = document.getElementById('reset'), x = new KeyboardEvent('keydown', {key: 'x', bubbles: true});"
        "reset.click(); document.getElementById('pause').click(); document.body.dispatchEvent(x)"
    )
    one.until(lambda: len(one.commands) == 5)
    expected = [("record", True), ("pause", True), ("record", False), ("pause", True)]
    assert one.commands == [*({"command": name, "on": on} for name, on in expected), {"command": "reset"}]


def test_a_fix_by_click_and_a_hue_by_keys(browser: Any, shown: Fed) -> None:
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.keys import Keys

    one = shown.one
    click(browser, "zoom")
    click(browser, "fix")
    canvas = browser.find_element("id", "picture")
    scale = min(canvas.size["width"] / 640, canvas.size["height"] / 480)
    ActionChains(browser).move_to_element_with_offset(canvas, round(50 * scale), round(-20 * scale)).click().perform()
    one.until(lambda: len(one.commands) == 1)
    fix = one.commands[0]
    assert (fix["command"], fix["sd_mm"], fix["place_mm"]) == ("fix", 1.0, None)
    assert fix["place_px"] == pytest.approx([319.5 + 50, 239.5 - 20], abs=1.5)
    press(browser, "h", Keys.ARROW_RIGHT)
    ActionChains(browser).key_down(Keys.SHIFT).send_keys(Keys.ARROW_DOWN).key_up(Keys.SHIFT).perform()
    press(browser, Keys.ENTER)
    one.until(lambda: len(one.commands) == 2)
    assert one.commands[1] == {"command": "hue", "node": "M1", "place_px": [320.5, 241.5]}
    press(browser, "f", Keys.ESCAPE)
    assert not browser.find_element("id", "prompt").is_displayed()
    click(browser, "zoom")


def test_what_the_run_refuses_is_reported(browser: Any, shown: Fed) -> None:
    shown.one.refusal = "the disk is full"
    keep_words(browser, "message")
    click(browser, "record")
    shown.one.until(lambda: browser.execute_script("return words.length > 0"))
    assert browser.execute_script("return words[0]") == "record refused: the disk is full"


def test_nothing_is_asked_of_another_address_and_nothing_is_wrong(browser: Any, shown: Fed) -> None:
    events = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
    own = f"127.0.0.1:{shown.one.port}/"
    sent = [event["params"] for event in events if event["method"] == "Network.requestWillBeSent"]
    asked = [one["request"]["url"] for one in sent if own in one["documentURL"]]  # not by the empty tab before
    asked += [event["params"]["url"] for event in events if event["method"] == "Network.webSocketCreated"]
    assert len(asked) > 8
    assert [url for url in asked if not url.startswith(("http://" + own, "ws://" + own))] == []
    assert browser.get_log("browser") == []


def test_a_lost_connection_is_shown_and_found_again(browser: Any, shown: Fed) -> None:
    one = shown.one
    server_side = [task for task in asyncio.all_tasks(one.loop) if "BoundedWebSocket" in repr(task)]
    assert server_side
    keep_words(browser, "advice-word")
    one.loop.call_soon_threadsafe(server_side[0].cancel)
    one.until(lambda: browser.execute_script("return words.at(-1) === 'GO'"))
    assert browser.execute_script("return words[0]") == "NO CONNECTION"


def test_advice_is_covered_though_the_script_hangs(browser: Any) -> None:
    """The animation runs out by itself: without any further call of the page's functions the cover is opaque."""
    opacity = "getComputedStyle(document.getElementById('dead')).opacity"
    with opened(browser, messages.scene()) as fed:
        fed.one.until(lambda: browser.execute_script(f"return {opacity}") == "0")
        fed.silent.set()
        covered = browser.execute_async_script(
            "const [done] = arguments; const ends = performance.now() + 400; while (performance.now() < ends);"
            f"done({opacity})"
        )
    assert covered == "1"
