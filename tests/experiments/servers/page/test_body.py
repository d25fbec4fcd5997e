"""The page of a body in space, in a browser: shaded, turned by dragging and keys, stale shown over it, no overflow."""

from base64 import b64decode
from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
import pytest

from estimators import Advice
from tests.experiments.servers.page import messages
from tests.experiments.servers.page.served import Served, served
from tests.experiments.servers.page.test_browser import STALE_S, colour, press, stop_clock, word

GROUND = [26, 35, 45]


@pytest.fixture(scope="module")
def shown(browser: Any) -> Iterator[Served]:
    """The page, open on a breast that rests."""
    with served({**messages.breast_scene(), "stale_ms": 1e3 * STALE_S}) as one:
        browser.get(one.address)
        one.until(lambda: one.feed.n_watching == 1)
        publish(one, browser, 1)
        yield one


def publish(one: Served, browser: Any, frames: int, **changed: Any) -> None:
    """Publish a state, and wait until the page has drawn it."""
    state = messages.breast_state(frames, **changed)
    one.publish({**state, "counters": {**state["counters"], "memory_mb": 1000 + frames}})
    one.until(lambda: browser.find_element("id", "memory").text == f"{1000 + frames} MB")


def picture(browser: Any) -> np.ndarray:
    """What the canvas shows, (height, width, 3)."""
    url = browser.execute_script("return document.getElementById('picture').toDataURL()")
    return cv2.imdecode(np.frombuffer(b64decode(url.split(",")[1]), np.uint8), cv2.IMREAD_COLOR)


def same(one: np.ndarray, other: np.ndarray) -> bool:
    """But for rounding along edges."""
    return bool(np.mean(np.abs(one.astype(float) - other).max(axis=2) > 20.0) < 2e-4)


def size(browser: Any, width: int, height: int) -> None:
    browser.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride",
        {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False},
    )


def test_the_body_is_shaded_and_its_marks_counted(browser: Any, shown: Served) -> None:
    """Of grey with blue in the middle, where the breast is; the ground at the upper corner."""
    shown.until(lambda: browser.find_element("id", "seen").text == "marks 12 of 12 used")
    assert word(browser) == "GO"
    assert colour(browser, 0.98, 0.02) == GROUND
    found = [colour(browser, 0.01 * x, 0.5) for x in range(30, 70)]
    shaded = [one for one in found if 40 < one[0] < one[1] < one[2] < 200]
    assert len(shaded) > 15


def test_it_is_turned_by_dragging_and_by_keys_and_back(browser: Any, shown: Served) -> None:
    """Right and left by the same angle is the same picture, and so is Home after a drag."""
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.keys import Keys

    canvas, before = browser.find_element("id", "picture"), picture(browser)
    canvas.click()
    press(browser, Keys.ARROW_RIGHT)
    turned = picture(browser)
    assert not same(turned, before)
    press(browser, Keys.ARROW_LEFT)
    assert same(picture(browser), before)
    ActionChains(browser).drag_and_drop_by_offset(canvas, 120, 40).perform()
    dragged = picture(browser)
    assert not same(dragged, before)
    assert not same(dragged, turned)
    press(browser, Keys.HOME)
    assert same(picture(browser), before)


def test_the_surface_follows_the_nodes(browser: Any, shown: Served) -> None:
    before = picture(browser)
    publish(shown, browser, 2, moved_mm=15.0)
    shown.until(lambda: not same(picture(browser), before))
    publish(shown, browser, 3)
    shown.until(lambda: same(picture(browser), before))
    assert same(picture(browser), before)


@pytest.mark.parametrize(("width", "height"), [(1280, 720), (1024, 768), (768, 1024)])
def test_nothing_overflows(browser: Any, shown: Served, width: int, height: int) -> None:
    try:
        size(browser, width, height)
        whole = "[document.documentElement.scrollWidth, document.documentElement.scrollHeight]"
        for frames, advice in enumerate(Advice, start=10):
            publish(shown, browser, frames, advice={**messages.breast_state()["advice"], "advice": str(advice)})
            shown.until(lambda advice=advice: word(browser) == str(advice).replace("_", " "))
            assert browser.execute_script(f"return {whole}") == [width, height]
            box = "document.getElementById('outlook')"
            assert browser.execute_script(f"return {box}.scrollWidth - {box}.clientWidth") == 0, advice
        box = browser.execute_script("return document.getElementById('picture').getBoundingClientRect().toJSON()")
        assert box["width"] > 300
        assert box["height"] > 300
    finally:
        size(browser, 1280, 720)


def test_a_stale_state_is_shown_over_the_body(browser: Any, shown: Served) -> None:
    publish(shown, browser, 19)  # drawn at the present size of the window
    before = picture(browser)
    try:
        stop_clock(browser, 2.0 * STALE_S)
        shown.until(lambda: word(browser) == "STALE")
        over = "getComputedStyle(document.getElementById('view'), '::after')"
        assert browser.execute_script(f"return [{over}.content, {over}.display]") == ['"STALE"', "grid"]
        assert not same(picture(browser), before)  # the target is dashed and faint
    finally:
        browser.execute_script("delete performance.now")
    publish(shown, browser, 20)
    shown.until(lambda: word(browser) == "GO")
    assert browser.get_log("browser") == []
