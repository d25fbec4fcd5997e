"""What the tests of faults share."""

import pytest

from experiments.formats.scenario import read_scenario
from tests.experiments.webcam import coarse_webcam


@pytest.fixture(autouse=True)
def _by_a_coarse_webcam(monkeypatch):
    scenarios = {"webcam": coarse_webcam(), "breathing": read_scenario("breathing")}
    monkeypatch.setattr("experiments.studies.faults.world.read_scenario", scenarios.__getitem__)
