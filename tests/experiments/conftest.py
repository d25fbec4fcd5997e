"""What the tests of commands share."""

import pytest


@pytest.fixture
def without_pictures(monkeypatch):
    """No pictures of a track are drawn: for tests of its numbers."""
    monkeypatch.setattr("experiments.plots.track.write_track_plots", lambda *_, **__: [])
