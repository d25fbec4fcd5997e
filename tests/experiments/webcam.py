"""The program's webcam with a quarter of its pixels, for tests of other things than how fine its picture is."""

from experiments.formats.scenario import Scenario, read_scenario


def coarse_webcam() -> Scenario:
    """320 by 240 pixels of 2.5 mm: the same view."""
    usual = read_scenario("webcam")
    assert usual.camera is not None
    camera = usual.camera.model_copy(update={"size_px": [320, 240], "mm_per_px": [2.5, 2.5]})
    return usual.model_copy(update={"camera": camera})
